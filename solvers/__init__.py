"""Minimizers behind one interface; they know nothing of images."""
