"""Which colours a file's numbers stand for, as its ICC profile tells, and how they are shown in sRGB."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Matrix = tuple[float, ...]
"""Nine numbers of a 3x3 matrix, row by row."""

# Middle of 16 bits, at which an encoding is measured, and how near to 1 its exponent is that of linear values. Set by
# hand.
_MIDDLE, _LINEAR = 32768, 0.02
_FULL = 65535
# Change of the matrix from which on colours are other ones: below it is rounding of the profile. Set by hand.
_SAME = 2e-3


@dataclass(frozen=True)
class ColorProfile:
    """What an ICC profile says.

    Attributes
    ----------
    name : str
        What it calls itself; empty for sRGB, in which pictures are written.
    to_srgb : tuple of 9 floats, or None
        Matrix that takes linear values to those of sRGB's primaries; None where they are these, or where the profile is
        no matrix, as those of printers and scanners may be.
    exponent : float or None
        Of values over light, at the middle: 1 where values are linear, 2.2 for most; None where it tells none.
    """

    name: str = ""
    to_srgb: Matrix | None = None
    exponent: float | None = None


def color_profile(profile: bytes | None) -> ColorProfile:
    """Read a file's profile; one without a word where there is none."""
    if not profile:
        return ColorProfile()
    from PIL import ImageCms

    try:
        core = ImageCms.ImageCmsProfile(io.BytesIO(profile)).profile
        name = (core.profile_description or "").strip() or "a profile without a name"
        if "srgb" in name.lower().replace(" ", ""):
            name = ""
        if core.xcolor_space.strip() != "RGB" or not core.is_matrix_shaper:
            return ColorProfile(name)
        matrix = np.linalg.solve(_primaries(_srgb()), _primaries(core))
        same = bool(np.abs(matrix - np.eye(3)).max() < _SAME)
        return ColorProfile(name, None if same else tuple(matrix.ravel().tolist()), _exponent(profile))
    except Exception:  # a damaged profile is no reason to refuse a picture
        return ColorProfile("a profile that cannot be read")


def _srgb() -> Any:
    from PIL import ImageCms

    return ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).profile


def _primaries(core: Any) -> NDArray[np.float64]:
    """XYZ of the three primaries before the profile's white, D50, in columns."""
    return np.array([core.red_colorant[0], core.green_colorant[0], core.blue_colorant[0]]).T


def _exponent(profile: bytes) -> float | None:
    """Of the encoding, from what the colour engine makes of a middle grey."""
    import imagecodecs

    grey = np.full((1, 1, 3), _MIDDLE, np.uint16)
    light = imagecodecs.cms_transform(grey, profile, linear_profile(None), colorspace="rgb", outcolorspace="rgb")
    level = float(light.mean()) / _FULL
    return math.log(level) / math.log(_MIDDLE / _FULL) if 0 < level < 1 else None


def encodes(profile: ColorProfile) -> bool:
    """Whether a profile says that values are not in proportion to light."""
    return profile.exponent is not None and abs(profile.exponent - 1) > _LINEAR


# CIE x, y and share of the white D65, and of the primaries that sRGB has (IEC 61966-2-1).
_D65 = (0.3127, 0.3290, 1.0)
_OF_SRGB = ((0.64, 0.33), (0.30, 0.60), (0.15, 0.06))


def colors_of_primaries(name: str, primaries: Sequence[tuple[float, float]]) -> ColorProfile:
    """Colours of a file without a profile that tells CIE x, y of its red, green and blue; its white is D65."""
    matrix = np.linalg.solve(_at_white(_OF_SRGB), _at_white(primaries))
    return ColorProfile(name, tuple(matrix.ravel().tolist()))


def _at_white(primaries: Sequence[tuple[float, float]]) -> NDArray[np.float64]:
    """XYZ of primaries that add up to D65, in columns."""
    columns, white = (np.array([(x / y, 1.0, (1 - x - y) / y) for x, y in of]).T for of in (primaries, [_D65[:2]]))
    return np.asarray(columns * np.linalg.solve(columns, white).T)


def linear_profile(to_srgb: Matrix | None) -> bytes:
    """ICC profile of linear values in the primaries of `ColorProfile.to_srgb`; None: in those of sRGB."""
    import imagecodecs

    # Columns that add up to the white, in which a colour's matrix is exact.
    xyz = _at_white(_OF_SRGB)
    if to_srgb is not None:
        xyz = xyz @ np.reshape(to_srgb, (3, 3))
    chromaticities = [value for X, Y, Z in xyz.T for value in (X / (X + Y + Z), Y / (X + Y + Z), Y)]
    made = imagecodecs.cms_profile("rgb", whitepoint=list(_D65), primaries=chromaticities, gamma=1.0)
    return bytes(made)


def in_srgb(linear: NDArray[Any], to_srgb: Matrix | None) -> NDArray[Any]:
    """Linear values (..., 3) as those of sRGB's primaries; others stay as they are."""
    if to_srgb is None or linear.shape[-1] != 3:
        return linear
    return linear @ np.reshape(to_srgb, (3, 3)).T.astype(np.float32)
