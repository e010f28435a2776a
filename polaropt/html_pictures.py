"""Pictures of a separation for a page: reduced, compressed, as text that stands in the page itself."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture
from polaropt.image_io import encode_srgb
from polaropt.inspection_picture import aolp_colors, dolp_colors, polarization_panels
from polaropt.misfit_map import MISFIT_WHITE
from polaropt.pair_gain import block_means
from polaropt.simulation import planes_last
from polaropt.uncertainty_files import uncertainty_panels
from polaropt.view import viewing_exposure

if TYPE_CHECKING:
    from polaropt.separation import Separation

Pixels = NDArray[np.uint8]
Image = NDArray[np.float32]

_LONG_SIDE = 1000
_QUALITY = 88
_STOPS = 13
_GREYS = "linear-gradient(to right, #000, #fff)"


@dataclass(frozen=True)
class Key:
    """What the colours of a picture mean: a gradient as CSS has it, and the values along it."""

    gradient: str
    ticks: tuple[str, ...]


@dataclass(frozen=True)
class PagePicture:
    """A picture in a page.

    Attributes
    ----------
    name : str
        Of its element.
    title, caption : str
    alt : str
        What there is to see, for who does not see it.
    uri : str
        The picture itself.
    width, height : int
    key : Key or None
    comparable : bool
        Whether it shows the scene as a photograph does, so that two of them can be laid over each other.
    """

    name: str
    title: str
    caption: str
    alt: str
    uri: str
    width: int
    height: int
    key: Key | None = None
    comparable: bool = False


def page_pictures(
    result: Separation, capture: Capture, exposures: Mapping[str, float], misfit: Image | None = None
) -> list[PagePicture]:
    """Photograph and layers, their errors, polarization and misfit, in the order of the page.

    Parameters
    ----------
    result : Separation
    capture : Capture
    exposures : mapping of str to float
        What "transmission" and "reflection" are multiplied by.
    misfit : ndarray, shape (h, w), optional
        Standard deviations of the noise.
    """
    last = [] if misfit is None else [_misfit(misfit)]
    return [*_layers(result, capture, exposures), *_errors(result), *_polarization(capture), *last]


def _layers(result: Separation, capture: Capture, exposures: Mapping[str, float]) -> list[PagePicture]:
    shown = (
        ("photograph", "Photograph", "light of all polarizations, as without a filter", capture.stokes[0]),
        ("transmission", "Transmission", "what is behind the glass", result.layers[0]),
        ("reflection", "Reflection", "what the glass mirrors", result.layers[1]),
    )
    pictures = []
    for name, title, what, planes in shown:
        image = _reduced(planes)
        exposure = exposures.get(name) or viewing_exposure(image)
        caption = f"{what[0].upper()}{what[1:]}; {exposure:.3g} times the linear values, in sRGB."
        pixels = np.round(255 * encode_srgb(image * np.float32(exposure))).astype(np.uint8)
        pictures.append(_picture(name, title, caption, f"{title}: {what}.", pixels, comparable=True))
    return pictures


def _errors(result: Separation) -> list[PagePicture]:
    panels = uncertainty_panels(result)
    pictures = []
    for name, error in panels.errors.items():
        white = panels.white[name]
        pixels = np.round(255 * np.clip(error / np.float32(white), 0, 1)).astype(np.uint8)
        title = f"Standard error of the {name}"
        key = Key(_GREYS, ("0", f"{white / 2:.2g}", f"{white:.2g}"))
        caption = "In the layer's linear values."
        pictures.append(_picture(f"{name}-error", title, caption, f"{title}, bright where it is large.", pixels, key))
    pixels = np.round(255 * np.clip(panels.known, 0, 1)).astype(np.uint8)
    caption = f"Share of the reflection's detail that the photographs tell; red below {panels.faded:g}: it fades there."
    alt = "Where the reflection is known: bright where it is, red where it is not."
    pictures.append(_picture("known", "Where the reflection is known", caption, alt, pixels))
    return pictures


def _misfit(misfit: Image) -> PagePicture:
    pixels = np.round(255 * np.clip(_reduced(misfit) / MISFIT_WHITE, 0, 1)).astype(np.uint8)
    key = Key(_GREYS, ("0", f"{MISFIT_WHITE / 2:g}", f"{MISFIT_WHITE:g}"))
    caption = "Where the pane does not explain the photographs, in standard deviations of the noise."
    return _picture("misfit", "Misfit", caption, "Misfit of the photographs, bright where it is large.", pixels, key)


def _polarization(capture: Capture) -> list[PagePicture]:
    panels = polarization_panels(capture)
    steps = np.linspace(0, 1, _STOPS)
    degree = Key(_gradient(dolp_colors(steps)), ("0", "0.5", "1"))
    angle = Key(_gradient(aolp_colors(180 * steps, np.ones(_STOPS))), ("0", "45", "90", "135", "180 deg"))
    about = (
        f"Counter-clockwise from the right; black where unpolarized, full colour from a degree of {panels.full:.2f}."
    )
    return [
        _picture(
            "dolp", "Degree of polarization", "Grey where saturated.", "Degree of linear polarization.", panels.dolp,
            degree,
        ),
        _picture("aolp", "Angle of polarization", about, "Angle of linear polarization as hue.", panels.aolp, angle),
    ]  # fmt: skip


def _picture(
    name: str, title: str, caption: str, alt: str, pixels: Pixels, key: Key | None = None, *, comparable: bool = False
) -> PagePicture:
    from imagecodecs import jpeg_encode

    data = jpeg_encode(np.ascontiguousarray(pixels), level=_QUALITY)
    uri = "data:image/jpeg;base64," + base64.b64encode(data).decode("ascii")
    return PagePicture(name, title, caption, alt, uri, pixels.shape[1], pixels.shape[0], key, comparable)


def _reduced(planes: Image) -> Image:
    """Planes ([channel,] h, w) to an image of at most about a thousand pixels along its long side."""
    block = -(-max(planes.shape[-2:]) // _LONG_SIDE)
    means: Any = planes if block == 1 else block_means(planes, block)
    return planes_last(np.asarray(means, dtype=np.float32))


def _gradient(colors: Pixels) -> str:
    stops = ", ".join("rgb({}, {}, {})".format(*(int(part) for part in color)) for color in colors)
    return f"linear-gradient(to right, {stops})"
