"""Numerics that know nothing of panes or captures: blocks, spectra, minima, errors by leaving out."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
