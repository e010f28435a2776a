"""Seconds against accuracy of every way to separate."""
