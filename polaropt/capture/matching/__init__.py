"""Photographs made to agree: in place, with both layers in place, and equally sharp."""
