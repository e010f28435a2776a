"""From a capture to its scene: the rungs of scene models, and the ladder that chooses one."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
