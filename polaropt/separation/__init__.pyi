__all__ = [
    "Case",
    "FrameMemory",
    "Separation",
    "estimate",
    "scene_case",
    "scene_options",
    "separate",
    "separate_at_once",
    "separate_frame",
]

from .case import Case as Case
from .frames import FrameMemory as FrameMemory
from .frames import separate_frame as separate_frame
from .pipeline import estimate as estimate
from .pipeline import scene_case as scene_case
from .pipeline import scene_options as scene_options
from .pipeline import separate as separate
from .pipeline import separate_at_once as separate_at_once
from .result import Separation as Separation
