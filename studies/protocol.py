"""The scenes that accuracy is measured on: fixed pairs of photographs behind a simulated pane."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture
from polaropt.errors import InputError
from polaropt.optics import SceneParameters, ghost_step
from polaropt.simulation import psnr_db, similarity_map, simulate, stack_layers

INCIDENCES_DEG = (10, 40, 60, 70, 80, 85)
N_PAIRS = 12
REFRACTIVE_INDEX = 1.5
THICKNESS_PX = 10.0
NOISE = 0.005
BITS = 12
EVALUATION_BORDER = 16

Kind = Literal["paper", "plate"]
Image = NDArray[np.float32]


@dataclass(frozen=True)
class Pair:
    """Two photographs (h, w, 3), larger than the frame by `margin` on each side, and the pair's number."""

    number: int
    transmission: Image
    reflection: Image
    margin: int

    def cropped(self, image: Image) -> Image:
        """The frame within a larger image (..., h, w) or (h, w, 3)."""
        m = self.margin
        return image[m:-m, m:-m] if image.shape[-1] == 3 else image[..., m:-m, m:-m]


def protocol_pairs(photos: Path, size: int = 256, margin: int = 128, n_pairs: int = N_PAIRS) -> list[Pair]:
    """Pairs of the photographs in a folder: names sorted, transmission 2i with reflection (2i + half) mod all.

    Frames are cut at the middle; a photograph is mirrored where it ends, so that ghosts find content there.
    """
    from skimage.io import imread

    files = sorted(path for path in photos.iterdir() if path.suffix.lower() in (".png", ".jpg", ".jpeg"))
    if len(files) < 2:
        raise InputError(f"{photos}: {len(files)} photographs; at least 2 are needed")
    half = len(files) // 2 - (1 if len(files) // 2 % 2 == 0 else 0)
    frames = [
        tuple(middle(_white_1(imread(files[j % len(files)])), size + 2 * margin) for j in (2 * i, 2 * i + half))
        for i in range(min(n_pairs, len(files) // 2))
    ]
    return [Pair(i, frame[0], frame[1], margin) for i, frame in enumerate(frames)]


def shipped_pairs(size: int = 256, margin: int = 128) -> list[Pair]:
    """Pairs of the photographs that ship inside scikit-image."""
    from skimage import data

    photographs = [data.astronaut(), data.coffee(), data.chelsea(), data.rocket()]
    frames = [middle(_white_1(photograph), size + 2 * margin) for photograph in photographs]
    order = ((0, 1), (2, 3), (1, 2), (3, 0))
    return [Pair(number, frames[i], frames[j], margin) for number, (i, j) in enumerate(order)]


def protocol_scene(pair: Pair, incidence_deg: float, kind: Kind = "paper") -> SceneParameters:
    """The pane of a pair: the azimuth is random, seeded by the pair's number."""
    azimuth = float(np.random.default_rng(pair.number).uniform(0, 180))
    shift = ghost_step(incidence_deg, REFRACTIVE_INDEX, THICKNESS_PX, kind)
    return SceneParameters(incidence_deg, azimuth, shift, REFRACTIVE_INDEX)


def protocol_capture(pair: Pair, incidence_deg: float, kind: Kind = "paper", noise: float = NOISE) -> Capture:
    """Photographs of a pair, simulated on the larger frame and cropped."""
    scene = protocol_scene(pair, incidence_deg, kind)
    larger = simulate(pair.transmission, pair.reflection, scene, noise=noise, bits=BITS, seed=pair.number)
    return Capture.of_planes(pair.cropped(larger.intensities), larger.angles_deg, pair.cropped(larger.valid))


def truth(pair: Pair) -> tuple[Image, Image]:
    """Transmission and reflection of the frame, (256, 256, 3)."""
    return pair.cropped(pair.transmission), pair.cropped(pair.reflection)


def true_layers(pair: Pair) -> Image:
    """The same as a separation has them, (2, 3, h, w)."""
    return stack_layers(*truth(pair))


def layer_quality(layers: Image, true: Image) -> tuple[float, float, float, float]:
    """PSNR in dB of transmission and reflection, then SSIM of both, within the border."""
    inner = (..., slice(EVALUATION_BORDER, -EVALUATION_BORDER), slice(EVALUATION_BORDER, -EVALUATION_BORDER))
    noise = [psnr_db(layers[i], true[i], EVALUATION_BORDER) for i in (0, 1)]
    likeness = [float(similarity_map(layers[i], true[i])[inner].mean()) for i in (0, 1)]
    return noise[0], noise[1], likeness[0], likeness[1]


def middle(image: Image, size: int) -> Image:
    """Middle of an image (h, w, 3), mirrored where it ends, (size, size, 3)."""
    missing: Sequence[int] = [max(size - side, 0) for side in image.shape[:2]]
    padding = [(lack // 2, lack - lack // 2) for lack in missing]
    image = np.pad(image, [*padding, (0, 0)], mode="symmetric")
    top, left = ((side - size) // 2 for side in image.shape[:2])
    return np.ascontiguousarray(image[top : top + size, left : left + size])


def _white_1(photograph: NDArray[np.uint8]) -> Image:
    """A photograph's colours in [0, 1]."""
    return photograph[..., :3].astype(np.float32) / 255
