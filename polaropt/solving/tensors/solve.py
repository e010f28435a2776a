"""Captures of one size solved together on a device: closed form, what windows expect, objective and solver."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import count
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from polaropt.inversion import DETAIL_CUT, DETAIL_PX, ClosedForm, detail_power, open_part, worth_filling
from polaropt.numerics import column_multiplicity, squared_frequencies
from polaropt.optics import PSE
from polaropt.solving.objective import layer_penalties, own_penalties, plugged_penalties
from polaropt.solving.problem import Problem
from polaropt.solving.starts import take_start
from polaropt.solving.tensors.batch import CaptureBatch, batch_of, blurred, placed
from polaropt.solving.tensors.closed_form import closed_form
from polaropt.solving.tensors.objective import BatchMisfit, BatchObjective, SpectralPrior, spectral_prior
from polaropt.solving.tensors.windows import expected_layers
from solvers.base import Solver, SolverResult, StoppingRule
from solvers.batch_lbfgs import minimize_all

Images = NDArray[np.float32]


@dataclass(frozen=True)
class BatchProblem:
    """Captures on a device, ready to be solved.

    Attributes
    ----------
    objective : BatchObjective
    start : Tensor, shape (capture, n)
        In its coordinates.
    forms : tuple of ClosedForm
        What is known of each capture, without images and spectra.
    unknown_detail : tuple of float
        Share of each reflection's detail that remains open, 0..1.
    """

    objective: BatchObjective
    start: Tensor
    forms: tuple[ClosedForm, ...]
    unknown_detail: tuple[float, ...]

    def layers(self, z: Tensor) -> Images:
        """Canvas layers (capture, 2, channel, H, W) at coordinates, in the colours of the photographs."""
        return np.asarray(self.objective.in_colors(z).cpu())


def alike(problem: Problem) -> tuple[Any, ...]:
    """What problems must have in common to be solved together."""
    capture = problem.capture
    return (
        problem.canvas,
        len(capture.angles_deg),
        capture.color,
        # The samples of a colour mosaic have a colour basis of their own.
        None if capture.samples is None else id(capture),
        problem.fits_windows,
        worth_filling(capture),
    )


def minimize_batch(
    there: BatchProblem,
    stopping: StoppingRule,
    advance: Callable[[int], None],
    minimizer: Solver | None = None,
) -> tuple[Tensor, list[SolverResult]]:
    """Solve.

    Parameters
    ----------
    there : BatchProblem
    stopping : StoppingRule
        Seconds are those of all together.
    advance : callable
        Is told the number of each evaluation.
    minimizer : Solver, optional
        Of tensors, for a single capture. Default: the one that solves several at once.

    Returns
    -------
    points : Tensor, shape (capture, n)
        Coordinates.
    results : list of SolverResult
    """
    numbers = count(1)

    def evaluate(z: Tensor) -> tuple[Tensor, Tensor]:
        advance(next(numbers))
        return there.objective.value_and_grad(z)

    if minimizer is None:
        found = minimize_all(evaluate, there.start, stopping)
        return found.points, found.results

    def of_one(z: Any) -> tuple[float, Any]:
        value, gradient = evaluate(z[None])
        return float(value[0]), gradient[0]

    start: Any = there.start[0]
    result = minimizer.minimize(of_one, start, stopping)
    return placed(result.x, there.start.device)[None], [result]


def batch_problem(problems: Sequence[Problem], device: str, init: str, start: Images | None = None) -> BatchProblem:
    """Problems that are `alike`, on a device.

    Parameters
    ----------
    problems : sequence of Problem
    device : str
        As torch names it.
    init : str
        Name of the start. From the closed form on, all is worked out on the device; what other starts need, and what a
        mosaic's samples or missing values do, is of the processor.
    start : ndarray, shape (2, channel, h, w), optional
        Layers to start from instead, of a single problem.
    """
    engines = [problem.pse for problem in problems if isinstance(problem.pse, PSE)]
    noises = [problem.pixel_noise for problem in problems]
    first = problems[0].capture
    there = init == "closed-form" and start is None and first.samples is None and not worth_filling(first)
    basis = None if there else problems[0].known.basis
    batch = batch_of([problem.observed for problem in problems], engines, noises, problems[0].canvas, device, basis)
    misfit = BatchMisfit(batch, problems[0].robust)
    if there:
        return _found_there(problems, engines, batch, misfit)
    unknown = tuple(problem.unknown_detail() for problem in problems)
    starts = [take_start(problem, init, start) for problem in problems]
    objective, layers = _found_before(problems, starts, batch, misfit)
    return BatchProblem(objective, objective.coordinates(layers), tuple(problem.known for problem in problems), unknown)


def _believed_share(problems: Sequence[Problem], device: torch.device) -> Tensor | None:
    """`Problem.believed_share` of each, (capture, 1, channel, h, w); None where all is believed of all."""
    shares = [problem.believed_share() for problem in problems]
    some = next((share for share in shares if share is not None), None)
    if some is None:
        return None
    whole = [np.ones_like(some) if share is None else share for share in shares]
    return placed(np.stack(whole)[:, None], device)


def _found_there(
    problems: Sequence[Problem], engines: Sequence[PSE], batch: CaptureBatch, misfit: BatchMisfit
) -> BatchProblem:
    """All of it worked out on the device."""
    known = closed_form(batch, [problem.capture for problem in problems], engines, [p.noise for p in problems])
    weights, expected, slope = problems[0].weights, None, None
    layers = known.layers
    if problems[0].fits_windows:
        # What a pixel's photographs tell, beside what the closed form takes for it.
        usual = torch.tensor([problem.noise for problem in problems], device=batch.device)
        precision = (batch.precision * usual[:, None, None, None, None]).square()
        share = _believed_share(problems, batch.device)
        precision = (precision if share is None else precision * share).mean(dim=(1, 2))

        def believed_slope(layers: Tensor) -> Tensor:
            slope = misfit.gradient(layers)
            if share is not None:
                in_colors = batch.in_colors(slope)
                batch.canvas.crop(in_colors).mul_(share)
                slope = batch.opponent(in_colors)
            return slope

        fast_alone = [problem.slow_is_known for problem in problems]
        expected = expected_layers(batch, known, believed_slope, precision, fast_alone)
        layers = expected.layers
        slope = misfit.gradient(layers)
    forms = known.each(batch.basis)
    each = zip(problems, forms, strict=True)
    within = [layer_penalties(own, p.mean_noise, mosaic=False, expects=expected is not None) for p, own in each]
    prior = spectral_prior(batch, known, expected, within, slope)
    others = [
        {**own_penalties(own, p.mean_noise), **plugged_penalties(weights, own, p.mean_noise)}
        for p, own in zip(problems, forms, strict=True)
    ]
    if expected is None:
        frames = batch.canvas.crop(batch.in_colors(layers)).cpu().numpy()
        unknown = [own.sampled.unknown_detail(frame[1]) for own, frame in zip(forms, frames, strict=True)]
        layers = placed(np.stack([batch.canvas.continued(frame) for frame in frames]), batch.device)
        layers = batch.opponent(layers)
    else:
        unknown = _unknown_detail(batch, expected.variance, layers)
    objective = BatchObjective(batch, misfit, (known.told, known.cross), within, prior, weights, others, layers)
    return BatchProblem(objective, objective.coordinates(layers), forms, tuple(unknown))


def _found_before(
    problems: Sequence[Problem], starts: Sequence[Images], batch: CaptureBatch, misfit: BatchMisfit
) -> tuple[BatchObjective, Tensor]:
    """With what the processor has found: the objective, and the starts in the colour basis."""
    penalties = [problem.penalties for problem in problems]
    known = [problem.known for problem in problems]
    told, cross = (np.stack([getattr(form, name) for form in known]) for name in ("told", "cross"))
    prior = SpectralPrior(
        placed(np.stack([each.natural_image.stiffness for each in penalties]), batch.device),
        placed(np.stack([each.natural_image.mean for each in penalties]), batch.device),
    )
    layers = batch.opponent(placed(np.stack(starts), batch.device))
    there = (placed(told, batch.device), placed(cross, batch.device))
    others = [each.others for each in penalties]
    return BatchObjective(batch, misfit, there, penalties, prior, problems[0].weights, others, layers), layers


def _unknown_detail(batch: CaptureBatch, variance: Tensor, layers: Tensor) -> list[float]:
    """`Expectation.unknown_detail` of each capture."""
    height, width = batch.canvas.shape
    rows, columns = squared_frequencies(height, width)
    share = column_multiplicity(width) / (height * width)
    weights = placed(
        (share * detail_power((rows[:, None] + columns).astype(np.float32))).astype(np.float32), batch.device
    )
    left = (variance[:, 1] * weights).flatten(1).sum(dim=1, dtype=torch.float64)
    reflection = batch.canvas.crop(batch.in_colors(layers)[:, 1])
    fine = reflection - blurred(reflection, DETAIL_PX, round(DETAIL_CUT * DETAIL_PX))
    power = fine.square().mean(dim=(-1, -2), dtype=torch.float64).sum(dim=1)
    return [open_part(*numbers) for numbers in torch.stack([left, power], dim=1).tolist()]
