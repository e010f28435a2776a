__all__ = [
    "BatchPanes",
    "ComponentStrip",
    "Coordinates",
    "Frame",
    "FusedMisfit",
    "FusedPenalties",
    "Initializer",
    "Memory",
    "Misfit",
    "Mosaic",
    "Piece",
    "Problem",
    "Settings",
    "Solution",
    "StoppingRule",
    "Term",
    "Tile",
    "Weights",
    "build_objective",
    "check_device",
    "check_given_start",
    "check_start",
    "component_strips",
    "conditioned_observation",
    "edges_of_layers",
    "energies",
    "initializers",
    "inpainted",
    "kinds_of_pixels",
    "n_at_once",
    "n_values",
    "observed_photographs",
    "observed_samples",
    "placed",
    "plain_observation",
    "plate_views",
    "plugged_names",
    "solve",
    "solve_at_once",
    "start_names",
    "take_start",
    "term_names",
    "whole",
]

from .compiled import FusedMisfit as FusedMisfit
from .compiled import FusedPenalties as FusedPenalties
from .compiled import kinds_of_pixels as kinds_of_pixels
from .inpainting import inpainted as inpainted
from .kernels.penalties import Frame as Frame
from .kernels.penalties import energies as energies
from .layer_edges import edges_of_layers as edges_of_layers
from .objective import Misfit as Misfit
from .objective import Term as Term
from .objective import Weights as Weights
from .objective import build_objective as build_objective
from .objective import plugged_names as plugged_names
from .objective import term_names as term_names
from .observation import conditioned_observation as conditioned_observation
from .observation import plain_observation as plain_observation
from .observation import plate_views as plate_views
from .problem import ComponentStrip as ComponentStrip
from .problem import Coordinates as Coordinates
from .problem import Memory as Memory
from .problem import Problem as Problem
from .problem import component_strips as component_strips
from .solution import Piece as Piece
from .solution import Settings as Settings
from .solution import Solution as Solution
from .solution import StoppingRule as StoppingRule
from .solution import Tile as Tile
from .solution import check_device as check_device
from .solution import n_at_once as n_at_once
from .solution import n_values as n_values
from .solution import solve as solve
from .solution import solve_at_once as solve_at_once
from .solution import whole as whole
from .starts import Initializer as Initializer
from .starts import check_given_start as check_given_start
from .starts import check_start as check_start
from .starts import initializers as initializers
from .starts import start_names as start_names
from .starts import take_start as take_start
from .tensors import BatchPanes as BatchPanes
from .tensors import Mosaic as Mosaic
from .tensors import observed_photographs as observed_photographs
from .tensors import observed_samples as observed_samples
from .tensors import placed as placed
