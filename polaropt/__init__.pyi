__version__: str
__all__ = [
    "PSE",
    "Capture",
    "Initializer",
    "InputError",
    "SceneParameters",
    "Separation",
    "SeparationWarning",
    "StoppingRule",
    "Weights",
    "align",
    "find_start_angle",
    "ghost_step",
    "initializers",
    "read_capture",
    "separate",
    "simulate",
]

from .capture import Capture as Capture
from .capture import align as align
from .capture import read_capture as read_capture
from .errors import InputError as InputError
from .estimation import find_start_angle as find_start_angle
from .judging import SeparationWarning as SeparationWarning
from .optics import PSE as PSE
from .optics import SceneParameters as SceneParameters
from .optics import ghost_step as ghost_step
from .separation import Separation as Separation
from .separation import separate as separate
from .simulation import simulate as simulate
from .solving import Initializer as Initializer
from .solving import StoppingRule as StoppingRule
from .solving import Weights as Weights
from .solving import initializers as initializers
