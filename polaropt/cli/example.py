"""The demo's examples: a pair of photographs that ship inside scikit-image, behind a simulated pane.

The first is taken through a filter that is turned, the second by a colour polarization camera.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture, planes_last
from polaropt.optics import SceneParameters, ghost_step
from polaropt.reporting import Picture, side_by_side, viewing_exposure
from polaropt.simulation import (
    MARGIN,
    Camera,
    cut,
    photograph_mosaic,
    photograph_pair,
    psnr_db,
    shipped_photograph,
    without_margin,
)

Image = NDArray[np.float32]

SIZE = 288
SCENE = SceneParameters(incidence_deg=68.0, azimuth_deg=25.0, ghost_shift=ghost_step(68.0, 1.5, 6.0))
# A room seen from the street: what the pane mirrors is brighter than what is behind it.
ROOM_LIGHT = 0.5
BORDER = 16
# Standard deviation: as sharp as lenses of polarization cameras, whose pixels are small, usually are.
LENS_BLUR_PX = 0.7


@dataclass(frozen=True)
class Example:
    """A capture and the truth, linear (h, w, 3)."""

    capture: Capture
    transmission: Image
    reflection: Image
    scene: SceneParameters


@dataclass(frozen=True)
class Score:
    """PSNR in dB of a layer against the truth, of its best guess without any separation, and of the result."""

    layer: str
    doing_nothing_db: float
    separated_db: float


def make_example() -> Example:
    """Photograph the shipped pair: 12 bits, noise of 0.5 % of white."""
    transmission, reflection = _layers()
    capture = photograph_pair(transmission, reflection, SCENE, Camera(noise=0.005, bits=12, seed=1))
    return Example(capture, without_margin(transmission), without_margin(reflection), SCENE)


def make_mosaic() -> tuple[Image, Image, Image]:
    """The same by a colour polarization camera: raw mosaic (h, w), transmission and reflection as its lens images."""
    camera = Camera(noise=0.005, bits=12, seed=1, lens_blur_px=LENS_BLUR_PX)
    layers = _layers()
    raw = without_margin(photograph_mosaic(*layers, SCENE, camera, color=True))
    transmission, reflection = (without_margin(camera.through_lens(layer)) for layer in layers)
    return raw, transmission, reflection


def _layers() -> tuple[Image, Image]:
    side = SIZE + 2 * MARGIN
    transmission = ROOM_LIGHT * cut(shipped_photograph("coffee"), (side, side), (0.5, 0.5))
    return transmission, cut(shipped_photograph("astronaut"), (side, side), (0.0, 0.4))


def doing_nothing(capture: Capture) -> tuple[Image, Image]:
    """The photographs themselves as layers: intensity, and twice the minimum over all polarizer angles."""
    s0, s1, s2 = capture.stokes
    return planes_last(s0), planes_last(np.asarray(s0 - np.hypot(s1, s2), dtype=np.float32))


def scores(example: Example, transmission: Image, reflection: Image) -> tuple[Score, Score]:
    """Both layers against the truth and against the better photograph."""
    photographs = doing_nothing(example.capture)
    rated = []
    for name, layer in (("transmission", transmission), ("reflection", reflection)):
        truth = getattr(example, name)
        nothing = max(_psnr(photograph, truth) for photograph in photographs)
        rated.append(Score(name, nothing, _psnr(layer, truth)))
    return rated[0], rated[1]


def comparison(example: Example, transmission: Image, reflection: Image) -> Picture:
    """Photographs, separated layers and truth side by side, all with one exposure."""
    through, behind_polarizer = doing_nothing(example.capture)
    rows = (
        (
            ("photograph", through),
            ("separated: transmission", transmission),
            ("separated: reflection", reflection),
        ),
        (
            ("polarizer at its best angle", behind_polarizer),
            ("truth: transmission", example.transmission),
            ("truth: reflection", example.reflection),
        ),
    )
    return side_by_side(rows, viewing_exposure(example.reflection))


def _psnr(image: Image, truth: Image) -> float:
    inside = (slice(BORDER, -BORDER), slice(BORDER, -BORDER))
    return psnr_db(image[inside], truth[inside])
