"""What a camera wrote beside the pixels: how it was held, how it exposed, which colours it means, and its name."""

from __future__ import annotations

import io
import math
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.capture.files.colors import ColorProfile, color_profile

# Tags of EXIF 2.3 (CIPA DC-008) and TIFF 6.
_MAKE, _MODEL, _ORIENTATION, _DATE = 0x010F, 0x0110, 0x0112, 0x0132
FACTS = (_MAKE, _MODEL, _ORIENTATION, _DATE)
"""Tags of a picture that are read beside its EXIF directory."""
_SECONDS, _F_NUMBER, _SPEED = 0x829A, 0x829D, 0x8827
_EXIF_DIRECTORY, _PROFILE = 0x8769, 0x8773
_THUMBNAIL = (0x0201, 0x0202)
_NAMES = {"ExposureTime": _SECONDS, "FNumber": _F_NUMBER, "ISOSpeedRatings": _SPEED, "PhotographicSensitivity": _SPEED}
BASE_ISO = 100
"""Speed that exposures are told for."""
UPRIGHT = 1
# Of each orientation: quarter turns counter-clockwise, and whether it is mirrored left to right before.
_TURNS = {
    1: (0, False),
    2: (0, True),
    3: (2, False),
    4: (2, True),
    5: (1, True),
    6: (3, False),
    7: (3, True),
    8: (1, False),
}


@dataclass(frozen=True)
class CameraFacts:
    """What a file tells of how it was taken.

    Attributes
    ----------
    orientation : int
        As EXIF has it: 1 upright, 3 upside down, 6 and 8 on its side, others mirrored.
    exposure : float or None
        Seconds times the speed over ISO 100, as far as it tells them; None where it tells no seconds.
    aperture : float or None
        The f-number.
    make, model, taken : str
        Empty where nothing is told.
    colors : ColorProfile
        What the numbers stand for.
    exif : bytes
        All tags, as results may carry them on: upright, without thumbnail.
    """

    orientation: int = UPRIGHT
    exposure: float | None = None
    aperture: float | None = None
    make: str = ""
    model: str = ""
    taken: str = ""
    colors: ColorProfile = field(default_factory=ColorProfile)
    exif: bytes = field(default=b"", repr=False)


def facts_of_picture(data: bytes) -> CameraFacts:
    """Those of a JPEG or PNG; empty ones where it tells nothing, or nothing that can be read."""
    if b"Exif\0\0" not in data[:65536] and b"eXIf" not in data and not _has_profile(data):
        return CameraFacts()
    from PIL import Image

    try:
        with warnings.catch_warnings():
            # Only the header is read; how large the picture is does not matter.
            warnings.simplefilter("ignore")
            with Image.open(io.BytesIO(data)) as picture:
                return _facts_of_exif(picture.getexif(), color_profile(picture.info.get("icc_profile")))
    except Exception:  # damaged tags are no reason to refuse a picture
        return CameraFacts()


def facts_of_exif(data: bytes, colors: ColorProfile) -> tuple[Mapping[int, Any], CameraFacts]:
    """The EXIF directory, and facts of a picture that was turned upright, from all its tags as a file has them."""
    from PIL import Image

    tags = Image.Exif()
    try:
        tags.load(data)
        tags[_ORIENTATION] = UPRIGHT
        return dict(tags.get_ifd(_EXIF_DIRECTORY)), _facts_of_exif(tags, colors)
    except Exception:  # damaged tags are no reason to refuse a picture
        return {}, CameraFacts(colors=colors)


def _facts_of_exif(tags: Any, colors: ColorProfile) -> CameraFacts:
    facts = facts_of_tags(tags, tags.get_ifd(_EXIF_DIRECTORY), colors)
    if not len(tags):
        return facts
    tags[_ORIENTATION] = UPRIGHT
    for tag in _THUMBNAIL:
        tags.pop(tag, None)
    return CameraFacts(**{**vars(facts), "exif": tags.tobytes().removeprefix(b"Exif\0\0")})


def _has_profile(data: bytes) -> bool:
    return b"iCCP" in data[:4096] or b"ICC_PROFILE\0" in data[:65536]


def facts_of_tags(
    tags: Mapping[int, Any],
    exif: Mapping[int, Any] | Mapping[str, Any] | None,
    colors: ColorProfile = ColorProfile(),  # noqa: B008 (frozen)
) -> CameraFacts:
    """Facts from the tags of a picture and of its EXIF directory, by number or by name."""
    by_number = {_NAMES.get(tag, tag) if isinstance(tag, str) else tag: value for tag, value in (exif or {}).items()}
    orientation = int(_positive(tags.get(_ORIENTATION)) or UPRIGHT)
    seconds, speed = _positive(by_number.get(_SECONDS)), _positive(by_number.get(_SPEED))
    return CameraFacts(
        orientation=orientation if orientation in _TURNS else UPRIGHT,
        exposure=None if seconds is None else seconds * (speed or BASE_ISO) / BASE_ISO,
        aperture=_positive(by_number.get(_F_NUMBER)),
        make=_text(tags.get(_MAKE)),
        model=_text(tags.get(_MODEL)),
        taken=_text(tags.get(_DATE)),
        colors=colors,
    )


def _positive(value: Any) -> float | None:
    """A tag's value, None where it is absent or no positive number."""
    try:
        if isinstance(value, tuple | list):
            value = value[0] / value[1] if len(value) > 1 else value[0]
        number = float(value)
    except (TypeError, ValueError, ZeroDivisionError, IndexError):
        return None
    return number if 0 < number < math.inf else None


def _text(value: Any) -> str:
    return value.strip("\0 ") if isinstance(value, str) else ""


def upright(pixels: NDArray[Any], orientation: int, axes: tuple[int, int] = (0, 1)) -> NDArray[Any]:
    """Pixels as they are to be looked at, with rows and columns along two axes."""
    turns, mirrored = _TURNS[orientation]
    if mirrored:
        pixels = np.flip(pixels, axes[1])
    return np.rot90(pixels, turns, axes) if turns else pixels


def relative_exposures(facts: list[CameraFacts]) -> tuple[float, ...]:
    """Exposures of photographs in seconds at ISO 100 and the first one's aperture; empty where one does not tell it."""
    seconds = [fact.exposure for fact in facts]
    if not facts or any(value is None for value in seconds):
        return ()
    numbers = [fact.aperture for fact in facts]
    opened = [1.0 if None in numbers else float(numbers[0] or 1) / float(number or 1) for number in numbers]
    return tuple(float(value or 0) * ratio**2 for value, ratio in zip(seconds, opened, strict=True))
