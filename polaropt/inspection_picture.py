"""Intensity, degree and angle of polarization of a capture, side by side, with keys."""

from __future__ import annotations

import colorsys
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture
from polaropt.image_io import encode_srgb
from polaropt.pair_gain import block_means
from polaropt.stokes import dolp_aolp, stokes_from_intensities

Picture = NDArray[np.uint8]
Floats = NDArray[np.floating[Any]]

_WIDEST = 640
_NARROWEST = 240
_GAP = 12
_TITLE = 26
_KEY = 48
_LETTERS = 13
_BACKGROUND = 255
# Dark to bright, also in grey print.
_DOLP_COLORS = ((0, 0, 4), (60, 15, 110), (140, 41, 129), (222, 73, 104), (254, 159, 109), (252, 253, 191))


def inspection_picture(capture: Capture) -> Picture:
    """Picture (h, w, 3) of intensity | DoLP | AoLP with titles and colour keys, for people.

    Intensity is s0, its 99 % quantile white, sRGB. DoLP runs from black (0) over purple to pale yellow (1). AoLP is the
    hue; brightness there is the DoLP, full from its 95 % quantile up, so that unpolarized pixels are black. Saturated
    pixels are grey in the last two. Large captures are reduced to at most 640 px per panel.
    """
    polarization = polarization_panels(capture)
    panels = [_intensity_panel(capture), polarization.dolp, polarization.aolp]
    keys = [
        None,
        dolp_colors(np.linspace(0, 1, 200)[None]),
        aolp_colors(np.linspace(0, 180, 200)[None], np.ones((1, 200))),
    ]
    titles = ("intensity", "degree of polarization", "angle of polarization")
    ticks = ((), ("0", "0.5", "1"), ("0", "45", "90", "135", "180 deg"))
    notes = ("", "grey: saturated", f"black: unpolarized; full colour from {polarization.full:.2f}")
    columns = [_column(*parts) for parts in zip(panels, titles, keys, ticks, notes, strict=True)]
    gap = np.full((columns[0].shape[0], _GAP, 3), _BACKGROUND, dtype=np.uint8)
    return np.concatenate([gap, columns[0], gap, columns[1], gap, columns[2], gap], axis=1)


@dataclass(frozen=True)
class PolarizationPanels:
    """Degree and angle of polarization as pictures (h, w, 3), and the degree from which the angle has full colour."""

    dolp: Picture
    aolp: Picture
    full: float


def polarization_panels(capture: Capture) -> PolarizationPanels:
    """Panels of `inspection_picture`, without titles and keys."""
    stokes, valid = _gray_stokes(capture)
    dolp, aolp = dolp_aolp(stokes)
    full = max(float(np.quantile(dolp[valid], 0.95)) if valid.any() else 1.0, 0.02)
    angles = aolp_colors(aolp, np.clip(dolp / full, 0, 1))
    return PolarizationPanels(_masked(dolp_colors(dolp), valid), _masked(angles, valid), full)


def dolp_colors(dolp: Floats) -> Picture:
    """DoLP 0..1 to colours (..., 3)."""
    stops = np.linspace(0, 1, len(_DOLP_COLORS))
    table = np.asarray(_DOLP_COLORS, dtype=np.float64)
    return np.stack([np.interp(dolp, stops, table[:, k]) for k in range(3)], axis=-1).astype(np.uint8)


def aolp_colors(aolp_deg: Floats, brightness: Floats) -> Picture:
    """Angles, 0..180 degrees once around the hues, and brightness 0..1 to colours (..., 3)."""
    table = np.array([colorsys.hsv_to_rgb(k / 180, 0.85, 1.0) for k in range(180)])
    colors = table[np.round(aolp_deg).astype(int) % 180]
    return np.asarray(255 * colors * np.asarray(brightness)[..., None]).astype(np.uint8)


def _reduction(capture: Capture) -> int:
    return -(-capture.shape[-1] // _WIDEST)


def _gray_stokes(capture: Capture) -> tuple[Floats, NDArray[np.bool_]]:
    images = capture.intensities.mean(axis=1) if capture.color else capture.intensities
    valid = capture.valid.all(axis=(0, 1)) if capture.color else capture.valid.all(axis=0)
    block = _reduction(capture)
    whole = block_means(np.asarray(valid, dtype=np.float32), block) > 0.5
    return stokes_from_intensities(block_means(images, block), capture.angles_deg), whole


def _intensity_panel(capture: Capture) -> Picture:
    s0 = block_means(capture.stokes[0], _reduction(capture))
    view = encode_srgb(s0 / max(float(np.quantile(s0, 0.99)), 1e-9))
    if capture.color and view.shape[0] == 3:
        return np.round(255 * np.moveaxis(view, 0, -1)).astype(np.uint8)
    gray = view.mean(axis=0) if capture.color else view
    return np.repeat(np.round(255 * gray).astype(np.uint8)[..., None], 3, axis=-1)


def _masked(colors: Picture, valid: NDArray[np.bool_]) -> Picture:
    return np.where(valid[..., None], colors, np.uint8(128)).astype(np.uint8)


def _column(panel: Picture, title: str, key: Picture | None, ticks: tuple[str, ...], note: str) -> Picture:
    """One panel with its title above and its key below."""
    from PIL import Image, ImageDraw, ImageFont

    width = max(panel.shape[1], _NARROWEST)
    canvas = Image.new("RGB", (width, panel.shape[0] + _TITLE + _KEY), (_BACKGROUND,) * 3)
    canvas.paste(Image.fromarray(panel), (0, _TITLE))
    draw, font = ImageDraw.Draw(canvas), ImageFont.load_default(_LETTERS)
    below = _TITLE + panel.shape[0]
    draw.text((0, 6), f"{title}   {note}" if note else title, fill=0, font=font)
    if key is not None:
        length = min(200, width - 40)
        canvas.paste(Image.fromarray(key).resize((length, 12)), (4, below + 8))
        for k, tick in enumerate(ticks):
            draw.text((4 + round(k * (length - 1) / (len(ticks) - 1)) - 3, below + 24), tick, fill=0, font=font)
    return np.asarray(canvas, dtype=np.uint8)
