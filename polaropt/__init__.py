"""Separate what is behind glass from what it mirrors, in photographs taken through a polarizer."""

import lazy_loader

# Names are resolved when first used, so that importing the package stays cheap; `__init__.pyi` says where they live.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__version__ = "0.1.0"
