"""The files that say how well the layers are known."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from polaropt.image_io import linearize, write_png, write_tiff
from polaropt.simulation import planes_last
from polaropt.view import side_by_side

if TYPE_CHECKING:
    from polaropt.separation import Separation

Image = NDArray[np.float32]

FADED = 0.2
"""Where less than this share of its detail is told, the reflection shows slow changes only."""
_WHITE = 0.99
_LARGEST_PANEL = 800


def write_uncertainty(folder: Path, result: Separation) -> dict[str, Any]:
    """Write standard errors and the reflection's told share: linear, and one picture of all three to look at.

    Parameters
    ----------
    folder : Path
        Gets ``transmission_error.tiff``, ``reflection_error.tiff``, ``reflection_known.tiff`` and ``uncertainty.png``.
    result : Separation

    Returns
    -------
    dict
        What the report tells of them.
    """
    errors = dict(zip(("transmission", "reflection"), map(planes_last, result.uncertainty), strict=True))
    for name, error in errors.items():
        write_tiff(folder / f"{name}_error.tiff", error)
    known = result.reflection_known
    write_tiff(folder / "reflection_known.tiff", known)
    shown = uncertainty_panels(result)
    white = shown.white
    panels: list[tuple[str, Image | None]] = [
        (f"{name}: error, white = {white[name]:.2g}", error / np.float32(white[name]))
        for name, error in shown.errors.items()
    ]
    panels.append((f"reflection: detail told, below {FADED:g} red", shown.known))
    # Values of the picture are in proportion to the errors.
    straight = [(title, None if panel is None else linearize(np.clip(panel, 0, 1), "srgb")) for title, panel in panels]
    write_png(folder / "uncertainty.png", side_by_side([straight]))
    return {
        "typical_error": {name: float(np.sqrt(np.mean(np.square(error)))) for name, error in errors.items()},
        "reflection_faded": {"share_of_pixels": float(np.mean(known < FADED)), "told_below": FADED},
        "white_in_png": white,
    }


@dataclass(frozen=True)
class UncertaintyPanels:
    """What is known of the layers, of a size to look at.

    Attributes
    ----------
    errors : dict of str to ndarray
        Standard errors of transmission and reflection, (h, w) or (h, w, channel), linear.
    white : dict of str to float
        The error to show as white.
    known : ndarray, shape (h, w, 3)
        Told share of the reflection's detail, red below `faded`.
    faded : float
    """

    errors: dict[str, Image]
    white: dict[str, float]
    known: Image
    faded: float


def uncertainty_panels(result: Separation) -> UncertaintyPanels:
    """Panels of ``uncertainty.png``; of large images pixels are left out."""
    errors = dict(zip(("transmission", "reflection"), map(planes_last, result.uncertainty), strict=True))
    white = {name: max(float(np.quantile(error, _WHITE)), 1e-6) for name, error in errors.items()}
    shown = {name: _panel(error) for name, error in errors.items()}
    return UncertaintyPanels(shown, white, _marked(_panel(result.reflection_known)), FADED)


def _panel(image: Image) -> Image:
    """A large image with pixels left out."""
    step = -(-max(image.shape[:2]) // _LARGEST_PANEL)
    return image[::step, ::step]


def _marked(known: Image) -> Image:
    """Grey where the reflection is known, red where it has faded, (h, w, 3)."""
    red = np.array([1.0, 0.25, 0.2], dtype=np.float32)
    return np.where((known < FADED)[..., None], (0.3 + known[..., None]) * red, known[..., None])
