"""How long a lens is, in pixels: from the angle of view, or from what a camera writes into its files."""

from __future__ import annotations

import io
import math
import warnings
from collections.abc import Mapping
from typing import Any

from polaropt.errors import InputError

# Tags of EXIF 2.3 (CIPA DC-008): a rational is a number here.
_FOCAL_MM, _FOCAL_35MM = 0x920A, 0xA405
_PLANE_X, _PLANE_UNIT = 0xA20E, 0xA210
_WIDTH, _HEIGHT = 0xA002, 0xA003
_NAMES = {
    "FocalLength": _FOCAL_MM,
    "FocalLengthIn35mmFilm": _FOCAL_35MM,
    "FocalPlaneXResolution": _PLANE_X,
    "FocalPlaneResolutionUnit": _PLANE_UNIT,
    "PixelXDimension": _WIDTH,
    "PixelYDimension": _HEIGHT,
}
_EXIF_DIRECTORY = 0x8769
_MM_PER_UNIT = {2: 25.4, 3: 10.0, 4: 1.0, 5: 1e-3}
"""Millimetres of EXIF's units of resolution: inch and centimetre; 4 and 5 are in use though not in the standard."""
_DIAGONAL_35MM = math.hypot(36, 24)
"""Diagonal of a frame of 35 mm film in millimetres, to which equivalent focal lengths refer (CIPA DCG-001)."""
_SAME_SHAPE = 0.01
"""Logarithm of the ratio of sides up to which a picture was not cropped: rounding of a small copy; set by hand."""
_AGREE = 0.1
"""Logarithm of the ratio of two focal lengths that do not contradict each other: whole millimetres; set by hand."""

VIEW_RANGE_DEG = (0.001, 179.0)
"""Angles of view: from a telescope's to more than any lens has that keeps straight lines. Set by hand."""

Size = tuple[int, int]


def focal_from_view(field_of_view_deg: float, longer_side: int) -> float:
    """Focal length in pixels of a pinhole camera that sees an angle along the picture's longer side.

    Parameters
    ----------
    field_of_view_deg : float
        From 0.001 to 179.
    longer_side : int
        Pixels.

    Raises
    ------
    InputError
        An angle outside its range.
    """
    check_view(field_of_view_deg)
    return longer_side / 2 / math.tan(math.radians(field_of_view_deg) / 2)


def check_view(field_of_view_deg: float) -> None:
    """InputError where an angle cannot be one of view."""
    narrowest, widest = VIEW_RANGE_DEG
    if not narrowest <= field_of_view_deg <= widest:
        raise InputError(
            f"the field of view is {field_of_view_deg:g} degrees; it must lie between {narrowest:g} and {widest:g}"
        )


def focal_from_exif(tags: Mapping[int, Any], size: Size) -> float | None:
    """Focal length in pixels from EXIF, None where it does not tell.

    `FocalPlaneXResolution` gives it exactly where it is there, the equivalent for 35 mm film to about a whole
    millimetre; where the two contradict each other the latter counts, which fewer cameras get wrong. A picture that was
    made smaller is scaled. Of one that was cropped since nothing can be told, for its axis is not in its middle.

    Parameters
    ----------
    tags : mapping
        Numbers of EXIF tags to their values.
    size : (int, int)
        Width and height of the picture.
    """
    original = int(_number(tags, _WIDTH) or size[0]), int(_number(tags, _HEIGHT) or size[1])
    scale = _scale(original, size)
    if scale is None:
        return None
    film, lens = _number(tags, _FOCAL_35MM), _number(tags, _FOCAL_MM)
    resolution, unit = _number(tags, _PLANE_X), _MM_PER_UNIT.get(int(_number(tags, _PLANE_UNIT) or 2))
    from_film = film * math.hypot(*original) / _DIAGONAL_35MM if film else None
    from_plane = lens * resolution / unit if lens and resolution and unit else None
    if from_film and from_plane and abs(math.log(from_film / from_plane)) > _AGREE:
        from_plane = None
    focal = from_plane or from_film
    return scale * focal if focal else None


def exif_of_picture(data: bytes) -> Mapping[int, Any]:
    """EXIF tags of a JPEG or PNG; none where there are none or they cannot be read."""
    if b"Exif\0\0" not in data[:65536] and b"eXIf" not in data:
        return {}
    from PIL import Image

    try:
        with warnings.catch_warnings():
            # Only the header is read; how large the picture is does not matter.
            warnings.simplefilter("ignore")
            with Image.open(io.BytesIO(data)) as picture:
                return dict(picture.getexif().get_ifd(_EXIF_DIRECTORY))
    except Exception:  # damaged tags are no reason to refuse a picture
        return {}


def exif_of_names(named: Any) -> Mapping[int, Any]:
    """The same tags by number where a library gives them by name, rationals as pairs (tifffile)."""
    if not isinstance(named, Mapping):
        return {}
    return {_NAMES[name]: value for name, value in named.items() if name in _NAMES}


def _number(tags: Mapping[int, Any], tag: int) -> float | None:
    """A tag's value, None where it is absent or no positive number."""
    value = tags.get(tag)
    try:
        number = float(value[0]) / float(value[1]) if isinstance(value, tuple) else float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, ZeroDivisionError, IndexError):
        return None
    return number if 0 < number < math.inf else None


def _scale(original: Size, size: Size) -> float | None:
    """Size of a picture relative to the one that was taken, which may have been turned; None if their shapes differ."""
    for width, height in (original, original[::-1]):
        across, down = size[0] / width, size[1] / height
        if abs(math.log(across / down)) < _SAME_SHAPE:
            return math.sqrt(across * down)
    return None
