"""Sequences: frames of a camera behind one pane, which is found once and followed."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
