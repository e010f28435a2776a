"""The parts of photographs, as they were solved and where nothing is separated: there is no glass, or it does not show.

Where a frame shows no glass the transmission is the light, and nothing is mirrored.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture
from polaropt.judging import Uncertainty, UncertaintyStrip
from polaropt.optics import analyzer_matrix
from polaropt.solving import ComponentStrip, Solution, component_strips

Images = NDArray[np.float32]
Mask = NDArray[np.bool_]


def solved_parts(solution: Solution, color: bool) -> Iterator[ComponentStrip]:
    """Both parts of every photograph as a solve ended, of grey ones without a channel axis."""
    for strip in component_strips(solution.pse, solution.canvas, solution.canvas_layers):
        yield strip if color else ComponentStrip(strip.rows, strip.components[:, :, 0])


def halves(capture: Capture) -> Iterator[ComponentStrip]:
    """Those of a capture in which nothing is polarized: all is transmission."""
    for rows, intensity in capture.intensity_strips():
        half = np.broadcast_to(intensity / 2, (len(capture.angles_deg), *intensity.shape))
        yield ComponentStrip(rows, np.stack([half, np.zeros_like(half)]))


def layers_beside(layers: Images, capture: Capture, unglazed: Mask) -> Images:
    """Layers (2, channel, h, w) that are the light and nothing where `unglazed` (h, w)."""
    layers = layers.copy()
    layers[1][:, unglazed] = 0
    for rows, light in capture.intensity_strips():
        where = unglazed[rows]
        layers[0][:, rows][:, where] = light.reshape(-1, *where.shape)[:, where]
    return layers


def parts_beside(
    parts_of: Callable[[], Iterator[ComponentStrip]], capture: Capture, unglazed: Mask
) -> Iterator[ComponentStrip]:
    """Parts of the photographs, of which the first is the photograph where `unglazed` (h, w)."""
    for strip in parts_of():
        parts, where = strip.components.copy(), unglazed[strip.rows]
        parts[0][..., where] = capture.intensities[..., strip.rows, :][..., where]
        parts[1][..., where] = 0
        yield ComponentStrip(strip.rows, parts)


def errors_beside(
    judge: Callable[..., Iterator[UncertaintyStrip]],
    unglazed: Mask,
    noise: float,
    capture: Capture,
    tell: Callable[[float], None] | None = None,
) -> Iterator[UncertaintyStrip]:
    """Errors as `judge` makes them that are the light's noise and none where `unglazed` (h, w): no reflection is."""
    of_light = noise * float(np.linalg.norm(np.linalg.pinv(analyzer_matrix(capture.angles_deg))[0]))
    for strip in judge(tell=tell):
        error, known = strip.uncertainty.standard_error.copy(), strip.uncertainty.reflection_known.copy()
        where = unglazed[strip.rows]
        error[0][..., where] = of_light
        error[1][..., where] = 0
        known[where] = 1
        yield replace(strip, uncertainty=Uncertainty(error, known))
