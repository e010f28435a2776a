"""The optics of a pane: Stokes vectors, Fresnel, the series of bounces, the scene and its simulation engine."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
