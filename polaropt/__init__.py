"""Separate what is behind glass from what it mirrors, in photographs taken through a polarizer."""

import lazy_loader

# Names are resolved when first used, so that importing the package stays cheap; `__init__.pyi` says where they live.
__getattr__, _public_names, __all__ = lazy_loader.attach_stub(__name__, __file__)
__version__ = "0.2.0"


def __dir__() -> list[str]:
    return [*_public_names(), "__doc__", "__file__", "__version__"]
