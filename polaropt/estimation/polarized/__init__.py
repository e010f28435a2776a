"""Panes before light that arrives polarized."""
