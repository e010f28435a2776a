__version__: str
__all__ = [
    "PSE",
    "Capture",
    "FrameReader",
    "Initializer",
    "InputError",
    "ResultWarning",
    "SceneParameters",
    "Separation",
    "SeparationWarning",
    "StoppingRule",
    "Weights",
    "align",
    "estimate",
    "find_start_angle",
    "ghost_step",
    "initializers",
    "inspect",
    "read_capture",
    "separate",
    "separate_many",
    "separate_sequence",
    "simulate",
]

from .api import Separation as Separation
from .api import estimate as estimate
from .api import inspect as inspect
from .api import separate as separate
from .api import separate_many as separate_many
from .api import separate_sequence as separate_sequence
from .capture import Capture as Capture
from .capture import FrameReader as FrameReader
from .capture import align as align
from .capture import read_capture as read_capture
from .errors import InputError as InputError
from .errors import ResultWarning as ResultWarning
from .estimation import find_start_angle as find_start_angle
from .judging import SeparationWarning as SeparationWarning
from .optics import PSE as PSE
from .optics import SceneParameters as SceneParameters
from .optics import ghost_step as ghost_step
from .simulation import simulate as simulate
from .solving import Initializer as Initializer
from .solving import StoppingRule as StoppingRule
from .solving import Weights as Weights
from .solving import initializers as initializers
