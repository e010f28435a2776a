"""Separate what is behind glass from what it mirrors, in photographs taken through a polarizer."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from polaropt.alignment import align as align
    from polaropt.angle_frame import find_start_angle as find_start_angle
    from polaropt.capture import Capture as Capture
    from polaropt.diagnostics import Warning as Warning
    from polaropt.errors import InputError as InputError
    from polaropt.forward import PSE as PSE
    from polaropt.objective import Weights as Weights
    from polaropt.reader import read_capture as read_capture
    from polaropt.scene import SceneParameters as SceneParameters
    from polaropt.scene import ghost_step as ghost_step
    from polaropt.separation import Separation as Separation
    from polaropt.separation import separate as separate
    from polaropt.simulation import simulate as simulate
    from polaropt.starts import Initializer as Initializer
    from polaropt.starts import initializers as initializers
    from solvers.base import StoppingRule as StoppingRule

__version__ = "0.1.0"

# Names are resolved when first used, so that importing the package stays cheap.
_HOMES = {
    "Capture": "polaropt.capture",
    "Initializer": "polaropt.starts",
    "InputError": "polaropt.errors",
    "PSE": "polaropt.forward",
    "SceneParameters": "polaropt.scene",
    "Separation": "polaropt.separation",
    "StoppingRule": "solvers.base",
    "Warning": "polaropt.diagnostics",
    "Weights": "polaropt.objective",
    "align": "polaropt.alignment",
    "find_start_angle": "polaropt.angle_frame",
    "ghost_step": "polaropt.scene",
    "initializers": "polaropt.starts",
    "read_capture": "polaropt.reader",
    "separate": "polaropt.separation",
    "simulate": "polaropt.simulation",
}
__all__ = [
    "PSE",
    "Capture",
    "Initializer",
    "InputError",
    "SceneParameters",
    "Separation",
    "StoppingRule",
    "Warning",
    "Weights",
    "align",
    "find_start_angle",
    "ghost_step",
    "initializers",
    "read_capture",
    "separate",
    "simulate",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'polaropt' has no attribute {name!r}")
    value = getattr(import_module(_HOMES[name]), name)
    globals()[name] = value
    return value
