__all__ = [
    "DARKEST_TINT",
    "FARTHEST_SHIFT_PX",
    "FIELDS",
    "FLAT",
    "FOCAL_RANGE_PX",
    "GHOST_SHIFT_SEARCH_PX",
    "GHOST_STEPS",
    "GLASS_INDEX",
    "INCIDENCE_LIMITS_DEG",
    "INCIDENCE_SEARCH_DEG",
    "MOST_PANES",
    "PSE",
    "SEARCHED",
    "WATER_INDEX",
    "Analyzer",
    "Bend",
    "Calibration",
    "Component",
    "Displacements",
    "Field",
    "GhostSeries",
    "GhostSum",
    "Pane",
    "Plate",
    "Rival",
    "SampledPSE",
    "Sampling",
    "SceneErrors",
    "SceneParameters",
    "VaryingPSE",
    "analyzer_matrix",
    "bent_normal",
    "brewster_angle_deg",
    "calibrate",
    "change_basis",
    "dolp_aolp",
    "engine_for",
    "frame_matrix",
    "ghost_step",
    "ghost_sum",
    "ghosts_that_matter",
    "in_place_correction",
    "in_place_reflectance",
    "in_place_weights",
    "incidence_trace",
    "interface",
    "largest_search_shift",
    "largest_turn",
    "orders_of_windows",
    "pixel_grid",
    "plane_normal",
    "plate_at",
    "plate_of",
    "scale_between",
    "scene_angles",
    "scene_pane",
    "shown_stokes",
    "stokes_from_intensities",
    "stokes_vector",
    "twice_the_azimuth",
    "vertical_reach",
    "viewing_angles",
    "widened",
    "window_orders",
]

from .analyzer import Analyzer as Analyzer
from .analyzer import Calibration as Calibration
from .analyzer import calibrate as calibrate
from .engine import PSE as PSE
from .engine import Displacements as Displacements
from .engine import VaryingPSE as VaryingPSE
from .engine import engine_for as engine_for
from .engine import shown_stokes as shown_stokes
from .engine import vertical_reach as vertical_reach
from .fresnel import brewster_angle_deg as brewster_angle_deg
from .fresnel import interface as interface
from .geometry import FLAT as FLAT
from .geometry import Bend as Bend
from .geometry import Pane as Pane
from .geometry import bent_normal as bent_normal
from .geometry import incidence_trace as incidence_trace
from .geometry import largest_turn as largest_turn
from .geometry import pixel_grid as pixel_grid
from .geometry import plane_normal as plane_normal
from .geometry import scene_angles as scene_angles
from .geometry import scene_pane as scene_pane
from .geometry import twice_the_azimuth as twice_the_azimuth
from .geometry import viewing_angles as viewing_angles
from .plate import GhostSeries as GhostSeries
from .plate import GhostSum as GhostSum
from .plate import Plate as Plate
from .plate import ghost_sum as ghost_sum
from .plate import ghosts_that_matter as ghosts_that_matter
from .plate import in_place_correction as in_place_correction
from .plate import in_place_reflectance as in_place_reflectance
from .plate import in_place_weights as in_place_weights
from .plate import orders_of_windows as orders_of_windows
from .plate import plate_at as plate_at
from .plate import plate_of as plate_of
from .plate import window_orders as window_orders
from .rivals import Rival as Rival
from .rivals import widened as widened
from .sampling import SampledPSE as SampledPSE
from .sampling import Sampling as Sampling
from .scene import DARKEST_TINT as DARKEST_TINT
from .scene import FARTHEST_SHIFT_PX as FARTHEST_SHIFT_PX
from .scene import FIELDS as FIELDS
from .scene import FOCAL_RANGE_PX as FOCAL_RANGE_PX
from .scene import GHOST_SHIFT_SEARCH_PX as GHOST_SHIFT_SEARCH_PX
from .scene import GHOST_STEPS as GHOST_STEPS
from .scene import GLASS_INDEX as GLASS_INDEX
from .scene import INCIDENCE_LIMITS_DEG as INCIDENCE_LIMITS_DEG
from .scene import INCIDENCE_SEARCH_DEG as INCIDENCE_SEARCH_DEG
from .scene import MOST_PANES as MOST_PANES
from .scene import SEARCHED as SEARCHED
from .scene import WATER_INDEX as WATER_INDEX
from .scene import Component as Component
from .scene import Field as Field
from .scene import SceneErrors as SceneErrors
from .scene import SceneParameters as SceneParameters
from .scene import ghost_step as ghost_step
from .scene import largest_search_shift as largest_search_shift
from .scene import scale_between as scale_between
from .stokes import analyzer_matrix as analyzer_matrix
from .stokes import change_basis as change_basis
from .stokes import dolp_aolp as dolp_aolp
from .stokes import frame_matrix as frame_matrix
from .stokes import stokes_from_intensities as stokes_from_intensities
from .stokes import stokes_vector as stokes_vector
