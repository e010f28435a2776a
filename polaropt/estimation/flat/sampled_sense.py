"""The sense of ghosts as the samples of a mosaic tell it.

A scene is estimated from one pixel per pattern, in which ghosts a few pixels apart are hardly resolved: how far they
lie from each other shows, to which side hardly. The samples themselves tell the side, once the rest is known. (They are
no measure of the distance: what a lens takes from fine detail is likelier to come of ghosts close together.)
"""

from __future__ import annotations

import numpy as np

from polaropt.capture import Capture, RegisteredCells
from polaropt.inversion import SampleLikelihood
from polaropt.numerics import middle_part
from polaropt.optics import SceneParameters

_MOST_PX = 512
"""Side of the middle of a frame whose samples are looked at; set by hand."""
_LEAST_GAIN = 5.0
"""Deviance that the other side must gain over the one found; set by hand."""


def with_sense_of_samples(scene: SceneParameters, capture: Capture, noise: float) -> SceneParameters:
    """A flat pane whose ghosts lie to the side to which a mosaic's samples are likelier; any other scene as it is.

    Parameters
    ----------
    scene : SceneParameters
        Complete, in pixels of the capture.
    capture : Capture
    noise : float
        Standard deviation of a sample's noise.
    """
    cells = capture.cells
    if cells is None or scene.rung != "ghosts" or scene.transmission_ghost_shift is not None:
        return scene
    period = cells.samples.sampling.period
    of_sensor = scene.scaled(period / cells.scale)
    other = of_sensor.replace(ghost_shift=-of_sensor.values()[2])
    likelihood = SampleLikelihood(_middle(cells), of_sensor.replace(ghost_shift=0.0), noise)
    gain = likelihood.n * (likelihood.score(of_sensor) - likelihood.score(other))
    return scene.replace(ghost_shift=-scene.values()[2]) if gain >= _LEAST_GAIN else scene


def _middle(cells: RegisteredCells) -> Capture:
    """The middle of the sensor's frame, its photographs no finer than the cells."""
    period = cells.samples.sampling.period
    part = middle_part(cells.capture.shape, _MOST_PX // period)
    small = cells.capture.part(*part)
    rows, columns = (slice(side.start * period, side.stop * period) for side in part)
    photographs = np.repeat(np.repeat(small.intensities, period, axis=-2), period, axis=-1)
    valid = np.ones(photographs.shape, dtype=bool)
    samples = cells.samples.part(rows, columns)
    return Capture.of_planes(photographs, small.angles_deg, valid, samples=samples)
