"""Photographs of known layers, pictures to make them of, and how near a result comes."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
