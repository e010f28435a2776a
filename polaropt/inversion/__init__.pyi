__all__ = [
    "RESOLUTION",
    "SCALES",
    "AssumedHessian",
    "Canvas",
    "ClosedForm",
    "FourierPreconditioner",
    "FusedPreconditioner",
    "Knowledge",
    "canvas_for",
    "ghost_layers",
    "ghost_transfer_at",
    "mosaic_layers",
    "natural_image_layers",
    "per_pixel_layers",
    "thinned",
    "unknown_share",
    "variance_table",
    "varying_layers",
    "varying_pixel_layers",
]

from .canvas import Canvas as Canvas
from .canvas import canvas_for as canvas_for
from .closed_form import ClosedForm as ClosedForm
from .closed_form import natural_image_layers as natural_image_layers
from .closed_form import per_pixel_layers as per_pixel_layers
from .compiled_whitening import FusedPreconditioner as FusedPreconditioner
from .mosaic_closed_form import mosaic_layers as mosaic_layers
from .spectra import RESOLUTION as RESOLUTION
from .transfer import ghost_transfer_at as ghost_transfer_at
from .variance import SCALES as SCALES
from .variance import Knowledge as Knowledge
from .variance import thinned as thinned
from .variance import unknown_share as unknown_share
from .variance import variance_table as variance_table
from .varying_closed_form import ghost_layers as ghost_layers
from .varying_closed_form import varying_layers as varying_layers
from .varying_closed_form import varying_pixel_layers as varying_pixel_layers
from .whitening import AssumedHessian as AssumedHessian
from .whitening import FourierPreconditioner as FourierPreconditioner
