"""Where in the frame a separation does not explain its photographs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture

if TYPE_CHECKING:
    from polaropt.separation import Separation

MISFIT_WHITE = 10.0
"""Multiple of the noise that is white in a picture of the map."""


def misfit_map(result: Separation, capture: Capture) -> NDArray[np.float32]:
    """Residual of the photographs in units of their noise, root mean square over photographs and colours, (h, w).

    About 1 where the model holds; 0 where every photograph is clipped.
    """
    count = np.zeros(capture.shape[-2:], dtype=np.float32)
    total = np.zeros_like(count)
    # One photograph at a time: all residuals of a large capture are much memory.
    for k, (photograph, valid) in enumerate(zip(capture.intensities, capture.valid, strict=True)):
        squares = np.square(result.components[0, k] + result.components[1, k] - photograph) * valid
        total += squares.reshape(-1, *count.shape).sum(axis=0)
        count += valid.reshape(-1, *count.shape).sum(axis=0)
    mean = np.sqrt(total / np.maximum(count, 1)) / np.float32(result.diagnostics.noise)
    return np.asarray(mean, dtype=np.float32)
