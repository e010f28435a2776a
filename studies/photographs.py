"""Pairs of photographs that scenes are made of: one behind the pane, one mirrored by it.

They come from scikit-image, from a folder, or were measured behind and off a real pane.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from polaropt.errors import InputError
from polaropt.simulation import stack_layers

Image = NDArray[np.float32]
"""Colours last, (h, w, 3)."""
Images = NDArray[np.float32]
"""Colours before height and width, (..., h, w)."""

N_PAIRS = 12
"""Of the paper's protocol."""
SIZE_PX, MARGIN_PX = 256, 128
"""Side of the frame, and what is kept beyond it on each side for ghosts to come from."""
GAMMA = 2.2
"""With which measured layers are stored."""
WHITE_QUANTILE = 0.999
"""Of a measured layer: this value is taken for white, what is brighter clips."""
SHIPPED = ("astronaut", "coffee", "chelsea", "rocket")
"""Photographs inside scikit-image that studies are made of where no folder is named; no network is trained on them."""
_SHIPPED_PAIRS = ((0, 1), (2, 3), (1, 2), (3, 0))
"""Photographs inside scikit-image of each pair: transmission and reflection."""


@dataclass(frozen=True)
class Pair:
    """Two photographs (h, w, 3), larger than the frame by `margin` on each side, and the pair's number."""

    number: int
    transmission: Image
    reflection: Image
    margin: int

    def cropped(self, image: Images) -> Images:
        """The frame within a larger image (..., h, w) or (h, w, 3)."""
        m = self.margin
        return image[m:-m, m:-m] if image.shape[-1] == 3 else image[..., m:-m, m:-m]

    @property
    def frames(self) -> tuple[Image, Image]:
        """Transmission and reflection of the frame, (h, w, 3)."""
        return self.cropped(self.transmission), self.cropped(self.reflection)

    @property
    def layers(self) -> Images:
        """The same as a separation has them, (2, 3, h, w)."""
        return stack_layers(*self.frames)

    @property
    def height(self) -> int:
        """Of the frame, in pixels."""
        return self.transmission.shape[0] - 2 * self.margin


@dataclass(frozen=True)
class Size:
    """Height and width of a frame, which need not be square."""

    height: int
    width: int

    def __str__(self) -> str:
        return f"{self.width}x{self.height}"


@dataclass(frozen=True)
class Photographs:
    """Where the layers come from: a folder (None: the photographs inside scikit-image) and the pair's number."""

    folder: str | None = None
    pair: int = 0


def folder_pairs(folder: Path, size: int = SIZE_PX, margin: int = MARGIN_PX, n_pairs: int = N_PAIRS) -> list[Pair]:
    """Pairs of the photographs in a folder: names sorted, transmission 2i with reflection (2i + half) mod all.

    Frames are cut at the middle; a photograph is mirrored where it ends, so that ghosts find content there.
    """
    from skimage.io import imread

    files = sorted(path for path in folder.iterdir() if path.suffix.lower() in (".png", ".jpg", ".jpeg"))
    if len(files) < 2:
        raise InputError(f"{folder}: {len(files)} photographs; at least 2 are needed")
    half = len(files) // 2 - (1 if len(files) // 2 % 2 == 0 else 0)
    frames = [
        tuple(middle(_white_1(imread(files[j % len(files)])), size + 2 * margin) for j in (2 * i, 2 * i + half))
        for i in range(min(n_pairs, len(files) // 2))
    ]
    return [Pair(i, frame[0], frame[1], margin) for i, frame in enumerate(frames)]


def shipped_pairs(size: int = SIZE_PX, margin: int = MARGIN_PX) -> list[Pair]:
    """Pairs of the photographs that ship inside scikit-image."""
    from skimage import data

    photographs = [getattr(data, name)() for name in SHIPPED]
    frames = [middle(_white_1(photograph), size + 2 * margin) for photograph in photographs]
    return [Pair(number, frames[i], frames[j], margin) for number, (i, j) in enumerate(_SHIPPED_PAIRS)]


def unseen_pairs(judged: int | None = None) -> tuple[int, ...]:
    """Numbers of the shipped pairs that share no photograph with one of them, by its number; of all without one."""
    own = set() if judged is None else set(_SHIPPED_PAIRS[judged])
    return tuple(number for number, pair in enumerate(_SHIPPED_PAIRS) if not own & set(pair))


@lru_cache(maxsize=8)
def pairs_of(folder: str | None, size: int = SIZE_PX, margin: int = MARGIN_PX) -> tuple[Pair, ...]:
    """Pairs of photographs of a folder, or those inside scikit-image; read once per process."""
    return tuple(shipped_pairs(size, margin) if folder is None else folder_pairs(Path(folder), size, margin))


def n_pairs_of(options: argparse.Namespace, most: int, size: int = SIZE_PX, margin: int | None = None) -> int:
    """Number of pairs to work on: as asked for on the command line, at most as many as there are.

    Parameters
    ----------
    options : argparse.Namespace
        Of `studies.kit.run.study_parser`.
    most : int
        Where nothing is asked for.
    size, margin : int
        In pixels. Default of the margin: half the size.
    """
    margin = size // 2 if margin is None else margin
    return min(options.pairs or most, len(pairs_of(options.photos, size, margin)))


@lru_cache(maxsize=1)
def sized_pair(photographs: Photographs, size: Size) -> Pair:
    """A pair in a frame that need not be square: the middle of the larger square."""
    side = max(size.height, size.width)
    pairs = (
        shipped_pairs(side)
        if photographs.folder is None
        else folder_pairs(Path(photographs.folder), side, n_pairs=photographs.pair + 1)
    )
    pair = pairs[photographs.pair]
    top, left = (side - size.height) // 2, (side - size.width) // 2
    rows = slice(top, top + size.height + 2 * MARGIN_PX)
    columns = slice(left, left + size.width + 2 * MARGIN_PX)
    return replace(pair, transmission=pair.transmission[rows, columns], reflection=pair.reflection[rows, columns])


@lru_cache(maxsize=2)
def measured_pairs(folder: Path, size: int = SIZE_PX, margin: int = MARGIN_PX) -> tuple[Pair, ...]:
    """Layers measured behind and off a pane, NAME_T.png and NAME_R.png, in linear light.

    What that pane did to their brightness is not known: each has white at its 99.9 % quantile, and clips there.

    Raises
    ------
    InputError
        A folder without layers.
    """
    from skimage.io import imread

    files = sorted(folder.glob("*_R.png"))
    if not files:
        raise InputError(f"{folder}: no layers NAME_T.png, NAME_R.png; name the folder that holds them")
    pairs = []
    for number, mirrored in enumerate(files):
        behind = mirrored.with_name(mirrored.name.replace("_R.png", "_T.png"))
        frames = [middle(_linear(imread(file)), size + 2 * margin) for file in (behind, mirrored)]
        pairs.append(Pair(number, frames[0], frames[1], margin))
    return tuple(pairs)


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


def _linear(photograph: NDArray[np.uint8]) -> Image:
    image = _white_1(photograph) ** np.float32(GAMMA)
    return np.asarray(np.minimum(image / np.float32(np.quantile(image, WHITE_QUANTILE)), 1), dtype=np.float32)
