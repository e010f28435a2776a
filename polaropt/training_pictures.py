"""Pictures to train on: generated leaves, photographs that ship with libraries, or a person's own folder."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from polaropt.dead_leaves import dead_leaves
from polaropt.errors import InputError
from polaropt.photographs import cut, in_color, photographs_in, read_photograph

Image = NDArray[np.float32]

FROM_SKIMAGE = (
    "astronaut", "coffee", "chelsea", "rocket", "hubble_deep_field", "camera", "coins", "brick", "grass", "gravel",
)  # fmt: skip
FROM_SKLEARN = ("china.jpg", "flower.jpg")
_N_LEAVES, _LEAVES_PX = 64, 448
_SCALES = (0.45, 1.0)


class Pictures:
    """Pictures by a random generator.

    Parameters
    ----------
    folder : Path, optional
        Take photographs from here. Default: half generated leaves, half photographs inside scikit-image and
        scikit-learn, which may all be redistributed.

    Attributes
    ----------
    source : str
        What they are, for the record.
    """

    def __init__(self, folder: Path | None = None) -> None:
        if folder is None:
            self.source = f"{_N_LEAVES} generated dead-leaves images; {', '.join(FROM_SKIMAGE + FROM_SKLEARN)}"
            self._photographs: list[Callable[[], Image]] = [
                *map(_of_skimage, FROM_SKIMAGE),
                *map(_of_sklearn, FROM_SKLEARN),
            ]
        else:
            files = photographs_in(folder)
            self.source = f"{len(files)} photographs of the folder {folder.name}"
            self._photographs = [_file(path) for path in files]
        self._leaves = _N_LEAVES if folder is None else 0
        self._kept = lru_cache(maxsize=256)(self._read)

    def frame(self, size: int, random: np.random.Generator) -> Image:
        """A square part (size, size, 3) of a picture, reduced, turned and mirrored at random."""
        picture = np.asarray(self._kept(*self._draw(random)), dtype=np.float32) / np.float32(255)
        scale = random.uniform(*_SCALES)
        wanted = min(int(np.ceil(size / scale)), *(2 * side for side in picture.shape[:2]))
        part = cut(picture, (wanted, wanted), (random.random(), random.random()))
        part = np.rot90(part, int(random.integers(4)))
        return _resized(part[:, ::-1] if random.random() < 0.5 else part, size)

    def _draw(self, random: np.random.Generator) -> tuple[bool, int]:
        leaves = bool(random.random() < 0.5) and self._leaves > 0
        return leaves, int(random.integers(self._leaves if leaves else len(self._photographs)))

    def _read(self, leaves: bool, number: int) -> NDArray[np.uint8]:
        image = dead_leaves(_LEAVES_PX, number) if leaves else self._photographs[number]()
        return np.round(255 * image).astype(np.uint8)


def _of_skimage(name: str) -> Callable[[], Image]:
    def read() -> Image:
        from skimage import data

        return in_color(np.asarray(getattr(data, name)(), dtype=np.float32) / np.float32(255))

    return read


def _of_sklearn(name: str) -> Callable[[], Image]:
    def read() -> Image:
        try:
            from sklearn.datasets import load_sample_image
        except ImportError:
            raise InputError(
                "the training pictures need scikit-learn: pip install 'polaropt[studies]', or name a folder"
            ) from None
        return np.asarray(load_sample_image(name), dtype=np.float32) / np.float32(255)

    return read


def _file(path: Path) -> Callable[[], Image]:
    return lambda: in_color(read_photograph(path))


def _resized(image: Image, size: int) -> Image:
    """A square image (n, n, 3) reduced to `size`, edges kept free of aliasing."""
    import torch
    from torch.nn.functional import interpolate

    planes = torch.from_numpy(np.ascontiguousarray(np.moveaxis(image, -1, 0)))[None]
    small = interpolate(planes, size=(size, size), mode="bilinear", antialias=True, align_corners=False)
    return np.ascontiguousarray(np.moveaxis(small[0].numpy(), 0, -1), dtype=np.float32)
