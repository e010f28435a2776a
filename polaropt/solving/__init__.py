"""From a capture and its scene to the layers: the problem, its starts, its objective, its solution."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
