"""Settings for the whole suite."""

from __future__ import annotations

from hypothesis import settings

# The machines that run this are slow at times; a deadline would fail for no reason. The same examples every time.
settings.register_profile("polaropt", deadline=None, derandomize=True, max_examples=60, database=None)
settings.load_profile("polaropt")
