"""Commands for many captures and for sequences."""
