"""Kinds of files: bytes to pixels as stored."""
