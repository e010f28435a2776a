"""One separation of the peers' study."""

from __future__ import annotations

import math
from dataclasses import dataclass

PROTOCOL, SPECIAL_CASES, MEASURED = "paper protocol", "special cases", "measured layers"


@dataclass(frozen=True)
class Row:
    """How one method did on one scene; not a number is what it does not show or was not run.

    Attributes
    ----------
    group, scene, pair
        The set, its column and the pair's number.
    method : str
    transmission, reflection : float
        PSNR in dB over pixels that no photograph clips, 16 px at the border left out.
    transmission_ssim, reflection_ssim : float
    transmission_fitted, reflection_fitted : float
        PSNR in dB where each layer gets the gain and offset that suit the true one best.
    seconds : float
    not_run : str
        Why; empty if it was.
    """

    group: str
    scene: str
    pair: int
    method: str
    transmission: float = math.nan
    reflection: float = math.nan
    transmission_ssim: float = math.nan
    reflection_ssim: float = math.nan
    transmission_fitted: float = math.nan
    reflection_fitted: float = math.nan
    seconds: float = math.nan
    not_run: str = ""
