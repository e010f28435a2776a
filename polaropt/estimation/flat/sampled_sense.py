"""The sense of ghosts as the samples of a mosaic tell it.

A scene is estimated from one pixel per pattern, in which ghosts a few pixels apart are hardly resolved: how far they
lie from each other shows, to which side hardly. The samples themselves tell the side, once the rest is known. (They are
no measure of the distance: what a lens takes from fine detail is likelier to come of ghosts close together.)
"""

from __future__ import annotations

from polaropt.capture import Capture
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
    if capture.samples is None or scene.rung != "ghosts" or scene.transmission_ghost_shift is not None:
        return scene
    part = capture.part(*middle_part(capture.shape, _MOST_PX))
    other = scene.replace(ghost_shift=-scene.values()[2])
    likelihood = SampleLikelihood(part, scene.replace(ghost_shift=0.0), noise)
    gain = likelihood.n * (likelihood.score(scene) - likelihood.score(other))
    return other if gain >= _LEAST_GAIN else scene
