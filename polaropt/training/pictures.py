"""Pictures to train on: generated leaves, photographs that ship with libraries, or a person's own folder."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import lru_cache, partial
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from polaropt.errors import InputError
from polaropt.numerics import in_color
from polaropt.simulation import cut, dead_leaves, photographs_in, read_photograph

Image = NDArray[np.float32]

FROM_SKIMAGE = ("hubble_deep_field", "camera", "coins", "brick", "grass", "gravel")
"""Not those that studies are made of by default: no network is judged on what it was trained on."""
FROM_SKLEARN = ("china.jpg", "flower.jpg")
# Generated images and their side in pixels; scales at which pictures are cut. Set by hand.
N_LEAVES, _LEAVES_PX = 64, 448
SCALES = (0.45, 1.0)
# Share of pictures with grain, its standard deviation (white = 1), equally likely in its logarithm, how far it reaches,
# and how alike it is in all colours: what sensors and films leave in photographs that are seen as they were taken.
GRAINY = 0.5
GRAIN = (0.003, 0.03)
GRAIN_PX = (0.0, 0.8)
GRAIN_IN_COLOR = (0.2, 0.7)


LEAST_SPREAD = 0.03
"""Standard deviation of a picture that shows anything (white = 1)."""


class Pictures:
    """Pictures by a random generator.

    Parameters
    ----------
    folder : Path, optional
        Take photographs from here too, beside those inside scikit-image and scikit-learn, which may be redistributed.
    leaves : int
        Generated images.
    leaves_share : float
        How often a generated image is taken, 0 to 1.

    Attributes
    ----------
    source : str
        What they are, for the record.
    added : str or None
        What of them is the folder's.
    """

    def __init__(self, folder: Path | None = None, leaves: int = N_LEAVES, leaves_share: float = 0.5) -> None:
        files = [] if folder is None else photographs_in(folder)
        self._photographs: list[Callable[[], Image]] = [
            *(partial(_of_skimage, name) for name in FROM_SKIMAGE),
            *(partial(_of_sklearn, name) for name in FROM_SKLEARN),
            *(partial(_file, path) for path in files),
        ]
        self._leaves, self._leaves_share = leaves if leaves_share else 0, leaves_share
        self._drawn: dict[int, NDArray[np.uint8]] = {}
        sources = [f"{leaves} generated dead-leaves images (share {leaves_share:g})"] if leaves_share else []
        sources += [", ".join(FROM_SKIMAGE + FROM_SKLEARN)]
        self.added = None if folder is None else f"{len(files)} photographs of the folder {folder.name}"
        sources += [self.added] if self.added is not None else []
        self.source = "; ".join(sources)

    def draw(self, workers: int) -> None:
        """Draw all generated images now, in processes of their own, so that none has to be drawn by each of them."""
        with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
            self._drawn = dict(enumerate(pool.map(_leaves, range(self._leaves), chunksize=4)))

    def all(self) -> Iterator[tuple[NDArray[np.uint8], float]]:
        """Every picture (h, w, 3), and how often it is taken."""
        of_photographs = (1 - self._leaves_share * bool(self._leaves)) / len(self._photographs)
        for number in range(len(self._photographs)):
            yield self._picture(leaves=False, number=number), of_photographs
        for number in range(self._leaves):
            yield self._picture(leaves=True, number=number), self._leaves_share / self._leaves

    def frame(self, size: int, random: np.random.Generator) -> Image:
        """A square part (size, size, 3) of a picture, reduced, turned, mirrored, and with grain at random."""
        picture = np.asarray(self._picture(*self._draw(random)), dtype=np.float32) / np.float32(255)
        scale = random.uniform(*SCALES)
        wanted = min(int(np.ceil(size / scale)), *(2 * side for side in picture.shape[:2]))
        part = cut(picture, (wanted, wanted), (random.random(), random.random()))
        part = np.rot90(part, int(random.integers(4)))[..., random.permutation(3)]
        frame = _resized(part[:, ::-1] if random.random() < 0.5 else part, size)
        return _with_grain(frame, random) if random.random() < GRAINY else frame

    def _draw(self, random: np.random.Generator) -> tuple[bool, int]:
        leaves = bool(random.random() < self._leaves_share)
        return leaves, int(random.integers(self._leaves if leaves else len(self._photographs)))

    def _picture(self, leaves: bool, number: int) -> NDArray[np.uint8]:
        if not leaves:
            return _read(self._photographs[number])
        if number not in self._drawn:
            self._drawn[number] = _leaves(number)
        return self._drawn[number]


@lru_cache(maxsize=256)
def _read(photograph: Callable[[], Image]) -> NDArray[np.uint8]:
    return _in_bytes(photograph())


def _leaves(number: int) -> NDArray[np.uint8]:
    return _in_bytes(dead_leaves(_LEAVES_PX, number))


def _with_grain(image: Image, random: np.random.Generator) -> Image:
    """A picture with grain as fine as its pixels or a little coarser."""
    in_color = random.uniform(*GRAIN_IN_COLOR)
    grey, color = random.standard_normal(image.shape[:2])[..., None], random.standard_normal(image.shape)
    grain = gaussian_filter(np.sqrt(1 - in_color**2) * grey + in_color * color, random.uniform(*GRAIN_PX), axes=(0, 1))
    strength = np.exp(random.uniform(*np.log(GRAIN))) / grain.std()
    return np.asarray(np.clip(image + strength * grain, 0, 1), dtype=np.float32)


def _in_bytes(image: Image) -> NDArray[np.uint8]:
    return np.round(255 * image).astype(np.uint8)


def _of_skimage(name: str) -> Image:
    from skimage import data

    return in_color(np.asarray(getattr(data, name)(), dtype=np.float32) / np.float32(255))


def _of_sklearn(name: str) -> Image:
    try:
        from sklearn.datasets import load_sample_image
    except ImportError:
        raise InputError("the training pictures need scikit-learn: pip install 'polaropt[studies]'") from None
    return np.asarray(load_sample_image(name), dtype=np.float32) / np.float32(255)


def _file(path: Path) -> Image:
    return in_color(read_photograph(path))


def _resized(image: Image, size: int) -> Image:
    """A square image (n, n, 3) reduced to `size`, edges kept free of aliasing."""
    import torch
    from torch.nn.functional import interpolate

    planes = torch.from_numpy(np.ascontiguousarray(np.moveaxis(image, -1, 0)))[None]
    small = interpolate(planes, size=(size, size), mode="bilinear", antialias=True, align_corners=False)
    return np.ascontiguousarray(np.moveaxis(small[0].numpy(), 0, -1), dtype=np.float32)
