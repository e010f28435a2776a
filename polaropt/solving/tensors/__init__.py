"""The separation on a device: closed form, what windows expect, objective and solve of several captures at once."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
