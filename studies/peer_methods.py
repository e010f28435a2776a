"""What is compared: methods that can be run, each told what suits it best, and what it is told."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from numpy.typing import NDArray

from polaropt.separation import separate
from polaropt.solving import start_names
from solvers.base import StoppingRule
from studies import peer_single_image
from studies.peer_multiscale import separate_in_scales
from studies.peer_scenes import Sample
from studies.peer_scores import fitted
from studies.peer_semireflector import correlation, mutual_information, separate_by
from studies.stability_methods import COMPONENTS, MINIMUM, NOTHING, baseline

Images = NDArray[np.float32]
# Transmission and reflection (channel, h, w); None is not shown.
Layers = tuple[Images, Images | None]

FULL, CLOSED_FORM, NETWORKS = "full solve", "closed form alone", "PolarNet and FusionNet alone"
PLAIN = "plain intensity"
# Name of the start that they are, see `polaropt.solving.starts`.
LEARNED = "learned"


class NotRun(Exception):
    """A method that is not there; says why."""


@dataclass(frozen=True)
class Method:
    """One row of the tables.

    Attributes
    ----------
    name : str
    run : callable
        From a sample to layers; raises `NotRun`.
    told : str
        What of the truth it is told.
    source : str
        Where it was published.
    ours : bool
        Whether it is a part of this project.
    scaleless : bool
        Whether its layers have no scale of their own, so that they are given the best.
    """

    name: str
    run: Callable[[Sample], Layers] = field(repr=False)
    told: str = "nothing"
    source: str = ""
    ours: bool = False
    scaleless: bool = False


def _from_baseline(name: str, sample: Sample) -> Layers:
    transmission, reflection = baseline(name, sample.capture, sample.layers)
    return transmission, None if name == NOTHING else reflection


def _by(criterion: Callable[[Images, Images], float], sample: Sample) -> Layers:
    _, azimuth, _ = sample.scene.values()
    transmission, reflection = separate_by(criterion, sample.capture, azimuth, sample.scene.refractive_index)
    return transmission, reflection


def _in_scales(sample: Sample) -> Layers:
    _, azimuth, _ = sample.scene.values()
    transmission, reflection = separate_in_scales(sample.capture, azimuth, sample.scene.refractive_index)
    return transmission, reflection


def _single_image(sample: Sample) -> Layers:
    """The strength and scale that suit the true transmission best."""
    if not peer_single_image.built():
        raise NotRun("run `make peers` first")
    truth = sample.layers[0]
    tried = [fitted(transmission, truth) for transmission in peer_single_image.suppressed(sample.capture)]
    return min(tried, key=lambda image: float(np.square(image - truth).mean())), None


def _networks(sample: Sample) -> Layers:
    """What the learned start gives, before any solve."""
    if LEARNED not in start_names():
        raise NotRun("there are no trained weights yet")
    return _separated(StoppingRule(max_evaluations=1), sample, init=LEARNED)


def _separated(stopping: StoppingRule, sample: Sample, init: str = "closed-form") -> Layers:
    transmission, reflection = separate(sample.capture, stopping=stopping, init=init).layers
    return transmission, reflection


METHODS: Sequence[Method] = (
    Method(PLAIN, partial(_from_baseline, NOTHING)),
    Method("minimum over angles", partial(_from_baseline, MINIMUM)),
    Method(
        "FastICA",
        partial(_from_baseline, COMPONENTS),
        told="order, sign, gain and offset of its components",
        source="Farid & Adelson, CVPR 1999; FastICA of scikit-learn on the four photographs",
        scaleless=True,
    ),
    Method(
        "least correlation",
        partial(_by, correlation),
        told="azimuth, refractive index",
        source="Schechner, Shamir, Kiryati, Optics Letters 1999",
    ),
    Method(
        "least mutual information",
        partial(_by, mutual_information),
        told="azimuth, refractive index",
        source="Schechner, Shamir, Kiryati, JOSA A 2000",
    ),
    Method(
        "multiscale physical",
        _in_scales,
        told="azimuth to 45 degrees, refractive index",
        source="Kong, Tai, Shin, IEEE TPAMI 2014, written anew (studies/peer_multiscale.py says what is not known)",
    ),
    Method(
        "single image",
        _single_image,
        told="the best of four strengths, gain and offset",
        source="Yang et al., CVPR 2019; package fast-reflection-removal",
        scaleless=True,
    ),
    Method(NETWORKS, _networks, ours=True),
    Method(CLOSED_FORM, partial(_separated, StoppingRule(max_evaluations=1)), ours=True),
    Method(FULL, partial(_separated, StoppingRule()), ours=True),
)
