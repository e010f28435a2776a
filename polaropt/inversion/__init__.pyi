__all__ = [
    "BAND_INERTIA",
    "COLORS_BLUR_PX",
    "DETAIL_CUT",
    "DETAIL_PX",
    "FEWEST_TOLD",
    "LEAST_COLOR_SHARE",
    "LEAST_EDGE_POWER",
    "LEAST_INTENSITY",
    "LEAST_LEFT_OPEN",
    "MEAN_SPREAD",
    "RESOLUTION",
    "SAMPLED_ALIASES",
    "SCALES",
    "SCORING_INERTIA",
    "SCORING_LEAST_TOLD",
    "SCORING_LONGEST_STEP",
    "SCORING_TURNS_LAW",
    "SCORING_TURNS_NODES",
    "TURNS_BANDS",
    "TURNS_POWER_LAW",
    "AssumedHessian",
    "Canvas",
    "ClosedForm",
    "DirectionalBands",
    "FourierPreconditioner",
    "FrequencyBands",
    "FusedPreconditioner",
    "Knowledge",
    "applied",
    "at_least_a_trifle",
    "canvas_for",
    "closed_form_of",
    "detail_power",
    "filled",
    "filled_by_layers",
    "filled_smoothly",
    "flat_means",
    "ghost_layers",
    "ghost_transfer",
    "ghost_transfer_at",
    "images_that_tell",
    "layers_in_place",
    "left_open",
    "mosaic_layers",
    "most_likely_layers",
    "natural_image_layers",
    "open_part",
    "per_pixel_layers",
    "plate_entries",
    "roots_of",
    "separable",
    "thinned",
    "two_layers",
    "unknown_share",
    "variance_table",
    "varying_layers",
    "varying_pixel_layers",
    "worth_filling",
]

from .canvas import Canvas as Canvas
from .canvas import canvas_for as canvas_for
from .closed_form import LEAST_COLOR_SHARE as LEAST_COLOR_SHARE
from .closed_form import LEAST_EDGE_POWER as LEAST_EDGE_POWER
from .closed_form import LEAST_INTENSITY as LEAST_INTENSITY
from .closed_form import MEAN_SPREAD as MEAN_SPREAD
from .closed_form import ClosedForm as ClosedForm
from .closed_form import at_least_a_trifle as at_least_a_trifle
from .closed_form import closed_form_of as closed_form_of
from .closed_form import flat_means as flat_means
from .closed_form import natural_image_layers as natural_image_layers
from .closed_form import per_pixel_layers as per_pixel_layers
from .closed_form import plate_entries as plate_entries
from .compiled_whitening import FusedPreconditioner as FusedPreconditioner
from .directional_spectra import SCORING_INERTIA as SCORING_INERTIA
from .directional_spectra import SCORING_LEAST_TOLD as SCORING_LEAST_TOLD
from .directional_spectra import SCORING_LONGEST_STEP as SCORING_LONGEST_STEP
from .directional_spectra import SCORING_TURNS_LAW as SCORING_TURNS_LAW
from .directional_spectra import SCORING_TURNS_NODES as SCORING_TURNS_NODES
from .directional_spectra import DirectionalBands as DirectionalBands
from .filling import FEWEST_TOLD as FEWEST_TOLD
from .filling import filled as filled
from .filling import filled_by_layers as filled_by_layers
from .filling import filled_smoothly as filled_smoothly
from .filling import layers_in_place as layers_in_place
from .filling import worth_filling as worth_filling
from .mosaic_closed_form import COLORS_BLUR_PX as COLORS_BLUR_PX
from .mosaic_closed_form import LEAST_LEFT_OPEN as LEAST_LEFT_OPEN
from .mosaic_closed_form import SAMPLED_ALIASES as SAMPLED_ALIASES
from .mosaic_closed_form import mosaic_layers as mosaic_layers
from .most_likely import most_likely_layers as most_likely_layers
from .spectra import BAND_INERTIA as BAND_INERTIA
from .spectra import RESOLUTION as RESOLUTION
from .spectra import TURNS_BANDS as TURNS_BANDS
from .spectra import TURNS_POWER_LAW as TURNS_POWER_LAW
from .spectra import FrequencyBands as FrequencyBands
from .spectra import left_open as left_open
from .spectra import two_layers as two_layers
from .transfer import ghost_transfer as ghost_transfer
from .transfer import ghost_transfer_at as ghost_transfer_at
from .transfer import images_that_tell as images_that_tell
from .transfer import separable as separable
from .variance import DETAIL_CUT as DETAIL_CUT
from .variance import DETAIL_PX as DETAIL_PX
from .variance import SCALES as SCALES
from .variance import Knowledge as Knowledge
from .variance import detail_power as detail_power
from .variance import open_part as open_part
from .variance import thinned as thinned
from .variance import unknown_share as unknown_share
from .variance import variance_table as variance_table
from .varying_closed_form import ghost_layers as ghost_layers
from .varying_closed_form import varying_layers as varying_layers
from .varying_closed_form import varying_pixel_layers as varying_pixel_layers
from .whitening import AssumedHessian as AssumedHessian
from .whitening import FourierPreconditioner as FourierPreconditioner
from .whitening import applied as applied
from .whitening import roots_of as roots_of
