"""A page on the loopback address: photographs are dropped on it, separated, looked at and downloaded."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
