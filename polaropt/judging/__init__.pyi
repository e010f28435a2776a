__all__ = [
    "Diagnostics",
    "SceneLoss",
    "SeparationWarning",
    "Uncertainty",
    "UncertaintyStrip",
    "assembled",
    "diagnose",
    "estimate_uncertainty",
    "noise_share",
    "scene_loss",
    "uncertainty_without_polarization",
]

from .loss import SceneLoss as SceneLoss
from .loss import scene_loss as scene_loss
from .uncertainty import Uncertainty as Uncertainty
from .uncertainty import UncertaintyStrip as UncertaintyStrip
from .uncertainty import assembled as assembled
from .uncertainty import estimate_uncertainty as estimate_uncertainty
from .uncertainty import uncertainty_without_polarization as uncertainty_without_polarization
from .warnings import Diagnostics as Diagnostics
from .warnings import SeparationWarning as SeparationWarning
from .warnings import diagnose as diagnose
from .warnings import noise_share as noise_share
