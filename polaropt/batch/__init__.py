"""Many captures: found in folders and tables, separated on several processes or a cluster, summed up."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
