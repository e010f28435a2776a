"""What a separation results in: two layers, with what is to be told of them and of how they were found."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Matching, planes_last
from polaropt.estimation import RungReport
from polaropt.judging import (
    Diagnostics,
    Uncertainty,
    UncertaintyStrip,
    assembled,
    diagnose,
    estimate_uncertainty,
    noise_share,
    scene_loss,
    uncertainty_without_polarization,
)
from polaropt.optics import SceneErrors, SceneParameters
from polaropt.progress import Stages
from polaropt.separation.case import Case
from polaropt.separation.parts import errors_beside, halves, layers_beside, parts_beside, solved_parts
from polaropt.solving import ComponentStrip, Settings, Solution, Term
from solvers.base import SolverResult, Status

Images = NDArray[np.float32]
Tell = Callable[[float], None]


@dataclass(frozen=True, eq=False)
class Separation:
    """Two layers and how they were found.

    Attributes
    ----------
    layers : ndarray of float32, shape (2, [channel,] h, w)
        [0] transmission, [1] reflection, linear. Colours come before rows, as in `PSE.forward` and all arrays of
        several images; `transmission` and `reflection` have them last.
    scene : SceneParameters
        Complete: given or estimated.
    errors : SceneErrors
        Standard errors of what was estimated.
    tried : tuple of RungReport
        The rungs of the ladder that were looked at, with why they were taken or left; empty where the scene was given.
    terms : dict of str to Term
        Raw value and weight of each term of the objective at the solution.
    solver : SolverResult
        Its `x` is empty: the layers are what it stands for.
    diagnostics : Diagnostics
    asked : SceneParameters
        What was asked for; None in it was estimated.
    settings : Settings
    n_bounces : int or None
        Bounces that the solve kept apart, as many as stand out of the noise; None where all lie on each other.
    seconds, cpu_seconds : dict of str to float
        Time of each stage: elapsed, and of all cores together.
    moving : ndarray of bool, shape (h, w), or None
        Where something moves between the photographs: it was left out when the scene was estimated, and the layers are
        those of one photograph, with the reflection around. None where nothing does, or nothing could tell.
    matching : Matching or None
        The photographs as they were separated, where they, or both layers of them, had to be moved onto each other, or
        they had to be made equally sharp or exposed.
    unglazed : ndarray of bool, shape (h, w), or None
        Where the frame shows no glass, as far as its light tells: it was left out, the transmission is the light there,
        and the reflection nothing. None where no such place was found.
    parts : callable
        Makes `components`.
    judge : callable
        Makes `uncertainty` and `reflection_known`; takes `tell` as `uncertainty_strips` does.
    """

    layers: Images = field(repr=False)
    scene: SceneParameters
    errors: SceneErrors
    tried: tuple[RungReport, ...]
    terms: dict[str, Term]
    solver: SolverResult
    diagnostics: Diagnostics
    asked: SceneParameters
    settings: Settings
    n_bounces: int | None
    seconds: dict[str, float]
    cpu_seconds: dict[str, float]
    moving: NDArray[np.bool_] | None = field(repr=False)
    matching: Matching | None = field(repr=False)
    unglazed: NDArray[np.bool_] | None = field(repr=False)
    parts: Callable[[], Iterator[ComponentStrip]] = field(repr=False)
    judge: Callable[..., Iterator[UncertaintyStrip]] = field(repr=False)

    @cached_property
    def components(self) -> Images:
        """The two parts of every photograph, (2, k, [channel,] h, w); simulated when first asked for."""
        return np.concatenate([strip.components for strip in self.parts()], axis=-2)

    def component_strips(self) -> Iterator[ComponentStrip]:
        """`components` of some rows at a time, which are not kept."""
        if "components" in vars(self):
            yield ComponentStrip(slice(0, self.layers.shape[-2]), self.components)
        else:
            yield from self.parts()

    @property
    def uncertainty(self) -> Images:
        """Standard error of the layers in every pixel, (2, [channel,] h, w), with what the scene's own errors add.

        Computed when first asked for.
        """
        return self._judged.standard_error

    @property
    def reflection_known(self) -> Images:
        """Share of the reflection's detail that the photographs tell, (h, w), 0..1."""
        return self._judged.reflection_known

    @cached_property
    def _judged(self) -> Uncertainty:
        return assembled(self.judge(), self.layers)

    def uncertainty_strips(self, tell: Tell | None = None) -> Iterator[UncertaintyStrip]:
        """`uncertainty` and `reflection_known` of some rows at a time, which are not kept.

        Parameters
        ----------
        tell : callable, optional
            Called with the fraction done, 0..1.
        """
        if "_judged" in vars(self):
            yield UncertaintyStrip(slice(0, self.layers.shape[-2]), self._judged)
        else:
            yield from self.judge(tell=tell)

    @property
    def transmission(self) -> Images:
        """What is behind the glass, (h, w) or (h, w, channel)."""
        return planes_last(self.layers[0])

    @property
    def reflection(self) -> Images:
        """What the glass mirrors, (h, w) or (h, w, channel)."""
        return planes_last(self.layers[1])


def separated(case: Case, solution: Solution, stages: Stages, judged: Diagnostics | None) -> Separation:
    """A capture as it was solved, judged.

    Parameters
    ----------
    case : Case
    solution : Solution
    stages : Stages
        Ended here: their seconds are the result's.
    judged : Diagnostics or None
        Of the frame before, of a film.
    """
    still, found = case.still, case.found
    capture, noise = still.capture, still.noise
    # A mosaic's errors are told by the noise of its samples, whatever its layers are solved for.
    solved = still if still.correlated is None else still.for_layers()
    rivals = () if found.estimate is None else found.estimate.rivals
    diagnostics = diagnose(
        capture,
        noise,
        misfit_ratio=solution.misfit_ratio * (solved.noise / noise) ** 2,
        reflection_unknown=solution.reflection_unknown,
        gain_of_less_noise=solution.gain_of_less_noise,
        noise_share=noise_share(capture, solution.layers[0], float(solution.variance[0])),
        loss=scene_loss(capture, solved.noise, found.scene, case.near_errors, solution.variance, solved.growth, rivals),
        finite=solution.solver.status is not Status.NOT_FINITE,
        before=judged,
        **case.known,
    )
    stages.end()
    layers, parts = solution.layers, partial(solved_parts, solution, capture.color)
    judge: Callable[..., Iterator[UncertaintyStrip]] = partial(
        estimate_uncertainty,
        capture,
        solution.layers,
        solved.noise,
        solution.pieces,
        solved.growth,
        correlated=still.correlated,
        of_scene=case.near_errors,
        rivals=rivals,
    )
    if case.unglazed is not None:
        layers = layers_beside(layers, case.capture, case.unglazed)
        parts = partial(parts_beside, parts, case.capture, case.unglazed)
        judge = partial(errors_beside, judge, case.unglazed, noise, capture)
    return Separation(
        layers=layers if capture.color else layers[:, 0],
        scene=found.scene,
        errors=case.errors,
        tried=found.tried,
        terms=solution.terms,
        solver=solution.solver,
        diagnostics=replace(diagnostics, noise_model=still.growth),
        asked=case.asked,
        settings=case.settings,
        n_bounces=solution.n_bounces,
        seconds=stages.seconds,
        cpu_seconds=stages.cpu_seconds,
        moving=still.moving,
        matching=case.matching,
        unglazed=case.unglazed,
        parts=parts,
        judge=judge,
    )


def unseparated(case: Case, stages: Stages) -> Separation:
    """The intensity as transmission: all that an unpolarized capture tells, and the better guess in doubt."""
    capture, still, found = case.capture, case.still, case.found
    estimate, noise = found.estimate, still.noise
    layers = np.zeros((2, *capture.shape), dtype=np.float32)
    for rows, intensity in capture.intensity_strips():
        layers[0][..., rows, :] = intensity
    diagnostics = diagnose(
        still.capture,
        noise,
        misfit_ratio=1.0,
        reflection_unknown=float(estimate is not None and not estimate.polarized),
        estimate=estimate,
        mistakes=still.mistakes,
        moving=still.moving,
        valid_share=still.valid_share,
        doubtful_incidence=case.doubtful_incidence,
        coated=case.coated,
    )
    stages.end()
    return Separation(
        layers=layers,
        scene=found.scene,
        errors=found.errors,
        tried=found.tried,
        terms={},
        solver=SolverResult(np.zeros(0, np.float32), 0.0, 0, 0, Status.NOT_RUN, 0.0),
        # Whatever the reason to warn of, no reflection is shown.
        diagnostics=replace(diagnostics, reflection_unknown=1.0),
        asked=case.asked,
        settings=case.settings,
        n_bounces=None,
        seconds=stages.seconds,
        cpu_seconds=stages.cpu_seconds,
        moving=still.moving,
        matching=case.matching,
        unglazed=None,
        parts=partial(halves, capture),
        judge=partial(uncertainty_without_polarization, capture, noise),
    )
