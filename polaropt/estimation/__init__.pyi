__all__ = [
    "NOTABLE_CHANCE",
    "NOTABLE_CHANCE_OF_MOSAIC",
    "AngleMistake",
    "Exposures",
    "IndexFit",
    "LadderResult",
    "LikelierIndex",
    "RungReport",
    "SceneEstimate",
    "StillPhotographs",
    "agreeing_photographs",
    "angle_mistake",
    "check_model",
    "clear_pane",
    "estimate_scene",
    "find_scene",
    "find_start_angle",
    "in_full",
    "left_alone",
    "likelier_index",
    "likelier_index_of_mosaic",
    "model_names",
    "motion_shows",
    "moving_pixels",
    "scene_source",
    "still_photographs",
    "surely_unglazed",
    "tiles_of_mosaic",
    "uneven_exposures",
    "unglazed_pixels",
    "with_incidence_checked",
    "with_index",
    "with_likelier_side",
]

from .angles import AngleMistake as AngleMistake
from .angles import angle_mistake as angle_mistake
from .angles import find_start_angle as find_start_angle
from .exposures import Exposures as Exposures
from .exposures import uneven_exposures as uneven_exposures
from .flat.azimuth import NOTABLE_CHANCE as NOTABLE_CHANCE
from .flat.azimuth import NOTABLE_CHANCE_OF_MOSAIC as NOTABLE_CHANCE_OF_MOSAIC
from .flat.estimate import SceneEstimate as SceneEstimate
from .flat.estimate import estimate_scene as estimate_scene
from .flat.samples.tiles import tiles_of_mosaic as tiles_of_mosaic
from .ghost_side import with_likelier_side as with_likelier_side
from .index_by_tiles import LikelierIndex as LikelierIndex
from .index_by_tiles import likelier_index_of_mosaic as likelier_index_of_mosaic
from .ladder import LadderResult as LadderResult
from .ladder import RungReport as RungReport
from .ladder import check_model as check_model
from .ladder import find_scene as find_scene
from .ladder import in_full as in_full
from .ladder import model_names as model_names
from .motion import StillPhotographs as StillPhotographs
from .motion import agreeing_photographs as agreeing_photographs
from .motion import motion_shows as motion_shows
from .motion import moving_pixels as moving_pixels
from .motion import still_photographs as still_photographs
from .refractive_index import IndexFit as IndexFit
from .refractive_index import clear_pane as clear_pane
from .refractive_index import likelier_index as likelier_index
from .refractive_index import with_index as with_index
from .safeguard import left_alone as left_alone
from .safeguard import scene_source as scene_source
from .safeguard import with_incidence_checked as with_incidence_checked
from .unglazed import surely_unglazed as surely_unglazed
from .unglazed import unglazed_pixels as unglazed_pixels
