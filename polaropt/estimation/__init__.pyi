__all__ = [
    "NOTABLE_STAKE",
    "AngleMistake",
    "LadderResult",
    "RungReport",
    "SceneEstimate",
    "angle_mistake",
    "estimate_scene",
    "find_scene",
    "find_start_angle",
    "in_full",
    "left_alone",
    "model_names",
    "scene_source",
    "with_incidence_checked",
]

from .angles import AngleMistake as AngleMistake
from .angles import angle_mistake as angle_mistake
from .angles import find_start_angle as find_start_angle
from .flat.azimuth import NOTABLE_STAKE as NOTABLE_STAKE
from .flat.estimate import SceneEstimate as SceneEstimate
from .flat.estimate import estimate_scene as estimate_scene
from .ladder import LadderResult as LadderResult
from .ladder import RungReport as RungReport
from .ladder import find_scene as find_scene
from .ladder import in_full as in_full
from .ladder import model_names as model_names
from .safeguard import left_alone as left_alone
from .safeguard import scene_source as scene_source
from .safeguard import with_incidence_checked as with_incidence_checked
