"""The scenes that the benchmark times: the protocol's, at the size of a photograph."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture
from polaropt.optics import SceneParameters
from polaropt.simulation import psnr_db
from studies.protocol import (
    EVALUATION_BORDER,
    Pair,
    protocol_capture,
    protocol_pairs,
    protocol_scene,
    shipped_pairs,
    true_layers,
)

Images = NDArray[np.float32]

_MARGIN = 128


@dataclass(frozen=True)
class Size:
    """Height and width of a frame."""

    height: int
    width: int

    def __str__(self) -> str:
        return f"{self.width}x{self.height}"


@dataclass(frozen=True)
class Photographs:
    """Where the layers come from: a folder (None: the photographs inside scikit-image) and the pair's number."""

    folder: str | None = None
    pair: int = 0


@dataclass(frozen=True)
class Example:
    """A capture, its scene and the layers (2, channel, h, w) that were blended."""

    capture: Capture
    scene: SceneParameters
    layers: Images

    def psnr_db(self, layers: Images) -> tuple[float, float]:
        """PSNR of both layers (2, channel, h, w) within the border."""
        return (
            psnr_db(layers[0], self.layers[0], EVALUATION_BORDER),
            psnr_db(layers[1], self.layers[1], EVALUATION_BORDER),
        )


def example(photographs: Photographs, incidence_deg: float, size: Size) -> Example:
    """One scene of the protocol, the pane known."""
    pair = sized_pair(photographs, size)
    capture = protocol_capture(pair, incidence_deg)
    layers = true_layers(pair)
    return Example(capture, protocol_scene(pair, incidence_deg), layers)


@lru_cache(maxsize=1)
def sized_pair(photographs: Photographs, size: Size) -> Pair:
    """A pair in a frame that need not be square: the middle of the larger square."""
    side = max(size.height, size.width)
    pairs = (
        shipped_pairs(side, _MARGIN)
        if photographs.folder is None
        else protocol_pairs(Path(photographs.folder), side, _MARGIN, photographs.pair + 1)
    )
    pair = pairs[photographs.pair]
    top, left = (side - size.height) // 2, (side - size.width) // 2
    rows = slice(top, top + size.height + 2 * _MARGIN)
    columns = slice(left, left + size.width + 2 * _MARGIN)
    return replace(pair, transmission=pair.transmission[rows, columns], reflection=pair.reflection[rows, columns])
