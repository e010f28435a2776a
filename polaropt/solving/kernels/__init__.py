"""Compiled passes of the objective."""
