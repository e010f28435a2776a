__all__ = [
    "Picture",
    "error_of",
    "inspect_capture",
    "inspection_picture",
    "pane_sentence",
    "plain",
    "scene_report",
    "side_by_side",
    "viewing_exposure",
    "write_separation",
]

from .files import write_separation as write_separation
from .inspection import inspect_capture as inspect_capture
from .pictures import Picture as Picture
from .pictures import inspection_picture as inspection_picture
from .pictures import side_by_side as side_by_side
from .pictures import viewing_exposure as viewing_exposure
from .report import plain as plain
from .report import scene_report as scene_report
from .words import error_of as error_of
from .words import pane_sentence as pane_sentence
