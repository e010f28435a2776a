"""Penalties on the two layers, each with value and gradient; they know nothing of panes."""
