__all__ = [
    "EVERY",
    "FIRST",
    "SEQUENCE_FILES",
    "Frames",
    "SequenceFiles",
    "averaged",
    "check_packages",
    "flicker",
    "open_frames",
    "separate_sequence",
]

from .averaging import averaged as averaged
from .files import SEQUENCE_FILES as SEQUENCE_FILES
from .files import SequenceFiles as SequenceFiles
from .files import check_packages as check_packages
from .follow import EVERY as EVERY
from .follow import FIRST as FIRST
from .follow import flicker as flicker
from .follow import separate_sequence as separate_sequence
from .frames import Frames as Frames
from .frames import open_frames as open_frames
