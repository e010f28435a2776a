__all__ = [
    "DARKEST",
    "MARGIN",
    "Camera",
    "Panes",
    "Photographs",
    "common_middle",
    "cut",
    "dead_leaves",
    "digitized",
    "exact_engine",
    "exact_photographs",
    "photograph_mosaic",
    "photograph_pair",
    "photographs_in",
    "psnr_db",
    "read_photograph",
    "sensor_image",
    "shipped_photograph",
    "similarity_map",
    "simulate",
    "simulated_mosaic",
    "stack_layers",
    "whole_patterns",
    "without_margin",
    "write_dataset",
]

from .dataset import Panes as Panes
from .dataset import Photographs as Photographs
from .dataset import write_dataset as write_dataset
from .leaves import dead_leaves as dead_leaves
from .metrics import psnr_db as psnr_db
from .metrics import similarity_map as similarity_map
from .pictures import common_middle as common_middle
from .pictures import cut as cut
from .pictures import photographs_in as photographs_in
from .pictures import read_photograph as read_photograph
from .pictures import shipped_photograph as shipped_photograph
from .simulator import DARKEST as DARKEST
from .simulator import MARGIN as MARGIN
from .simulator import Camera as Camera
from .simulator import digitized as digitized
from .simulator import exact_engine as exact_engine
from .simulator import exact_photographs as exact_photographs
from .simulator import photograph_mosaic as photograph_mosaic
from .simulator import photograph_pair as photograph_pair
from .simulator import sensor_image as sensor_image
from .simulator import simulate as simulate
from .simulator import simulated_mosaic as simulated_mosaic
from .simulator import stack_layers as stack_layers
from .simulator import whole_patterns as whole_patterns
from .simulator import without_margin as without_margin
