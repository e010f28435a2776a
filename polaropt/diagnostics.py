"""What a capture cannot tell, and what went against the model: an enumeration with a sentence for each."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np

from polaropt.capture import Capture
from polaropt.capture_checks import fit_gamma
from polaropt.scene_estimation import SceneEstimate

_UNKNOWN_REFLECTION = 0.9
_MUCH_CLIPPED = 0.01
_BAD_FIT = 4.0


class Warning(Enum):
    """What a user should know before trusting a result; the value is the sentence."""

    NO_POLARIZATION = (
        "The photographs show no polarization: nothing can be separated, and the intensity is returned as transmission."
    )
    REFLECTION_NOT_IDENTIFIABLE = (
        "The photographs hardly tell the reflection (glass seen too frontally, or too much noise): "
        "trust its slow changes at most. The transmission does not suffer from this."
    )
    SATURATED = "More than 1 % of the pixels are clipped at white; they were left out and filled in from the others."
    GAMMA_ENCODED = (
        "The photographs look gamma-encoded: pairs do not add up. Give linear files, or tell the encoding (gamma)."
    )
    MODEL_DOES_NOT_EXPLAIN = (
        "The pane with these parameters does not explain the photographs down to their noise: "
        "a wide lens, a bent pane, polarized light or movement may be the reason."
    )
    SOLVER_FAILED = "The solver met values that are not finite; the best point before is returned."


@dataclass(frozen=True)
class Diagnostics:
    """What is known of a separation's trustworthiness.

    Attributes
    ----------
    warnings : tuple of Warning
    noise : float
        Standard deviation of one photograph's noise (white = 1).
    clipped : float
        Share of pixels that were not trusted.
    misfit_ratio : float
        Mean squared residual of the photographs in units of the noise; 1 where the model explains them.
    reflection_unknown : float
        Share of the reflection's gradient energy that the photographs do not tell, 0..1.
    estimate : SceneEstimate or None
        How the scene was found; None where nothing was estimated.
    """

    warnings: tuple[Warning, ...]
    noise: float
    clipped: float
    misfit_ratio: float
    reflection_unknown: float
    estimate: SceneEstimate | None


def diagnose(
    capture: Capture,
    noise: float,
    *,
    misfit_ratio: float,
    reflection_unknown: float,
    estimate: SceneEstimate | None,
    finite: bool = True,
) -> Diagnostics:
    """Collect the warnings that a capture and its solution deserve (arguments as `Diagnostics`' attributes)."""
    clipped = 1 - float(capture.valid.mean())
    polarized = estimate is None or estimate.polarized
    deserved = {
        Warning.NO_POLARIZATION: not polarized,
        Warning.REFLECTION_NOT_IDENTIFIABLE: not polarized or reflection_unknown > _UNKNOWN_REFLECTION,
        Warning.SATURATED: clipped > _MUCH_CLIPPED,
        Warning.GAMMA_ENCODED: _looks_encoded(capture),
        Warning.MODEL_DOES_NOT_EXPLAIN: polarized and misfit_ratio > _BAD_FIT,
        Warning.SOLVER_FAILED: not finite,
    }
    return Diagnostics(
        warnings=tuple(warning for warning, given in deserved.items() if given),
        noise=noise,
        clipped=clipped,
        misfit_ratio=misfit_ratio,
        reflection_unknown=reflection_unknown,
        estimate=estimate,
    )


def _looks_encoded(capture: Capture) -> bool:
    fit = fit_gamma(capture)
    return fit is not None and bool(np.isfinite(fit.exponent)) and fit.encoded
