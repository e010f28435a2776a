"""From pixels as stored to a capture."""
