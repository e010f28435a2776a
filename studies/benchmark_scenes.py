"""The scenes that the benchmark times: the protocol's, at the size of a photograph."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture
from polaropt.optics import SceneParameters
from studies.camera import take
from studies.photographs import Photographs, Size, sized_pair
from studies.scenes import protocol
from studies.scores import both_psnr

Images = NDArray[np.float32]


@dataclass(frozen=True)
class Example:
    """A capture, its scene and the layers (2, channel, h, w) that were blended."""

    capture: Capture
    scene: SceneParameters
    layers: Images

    def psnr_db(self, layers: Images) -> tuple[float, float]:
        """PSNR of both layers (2, channel, h, w) within the border."""
        return both_psnr(layers, self.layers)


def example(photographs: Photographs, incidence_deg: float, size: Size) -> Example:
    """One scene of the protocol, the pane known."""
    sample = take(protocol(incidence_deg), sized_pair(photographs, size))
    return Example(sample.capture, sample.scene, sample.layers)
