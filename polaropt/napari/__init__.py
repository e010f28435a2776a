"""Photographs, polarization, layers and errors in napari: the reader and the widget that `napari.yaml` names."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
