"""One value and gradient on the pixels against the time that its memory traffic takes at least."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from copy import copy
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import noise_level
from polaropt.solving import FusedMisfit, FusedPenalties, Problem, Weights, take_start
from priors.gradient_sparsity import GradientSparsity
from solvers.kernels import in_blocks, thread_count
from studies.benchmark.rows import Place, Row
from studies.camera import Sample
from studies.kit.timing import Threads

N_GHOSTS = 2
# The spectral prior needs a transform: what is measured are the passes over pixels.
_WEIGHTS = Weights(natural_image=0.0)


def measure_kernels(place: Place, sample: Sample, repeats: int, vector_mib: int) -> list[Row]:
    """Seconds of the compiled and the automatic gradient, and the bandwidth, with one thread and with all.

    Parameters
    ----------
    place : Place
    sample : Sample
    repeats : int
    vector_mib : int
        Length of the vectors whose product measures the bandwidth.
    """
    scene = replace(sample.scene, n_bounces=N_GHOSTS)
    problem = Problem(sample.capture, scene, noise_level(sample.capture), _WEIGHTS)
    if problem.pse.taps.shape[1] != N_GHOSTS + 1:
        raise AssertionError(f"{problem.pse.taps.shape[1] - 1} ghosts instead of {N_GHOSTS}")
    own = problem.penalties.gradient_sparsity
    vector = np.ones(vector_mib * 2**20 // 4, dtype=np.float32)
    subjects = {"bandwidth": _dot(vector)}
    for sparsity in (replace(own, exponent=1.0), own):
        name = f"p = {sparsity.exponent:g}"
        subjects[f"compiled, {name}"] = _compiled(problem, sparsity)
        subjects[f"torch autograd, {name}"] = _autograd(problem, sparsity)
    rows = [place.measured("bound", "traffic", "bytes", [traffic_bytes(problem)])]
    for threads in dict.fromkeys((1, thread_count())):
        unit = f"{threads} thread" + ("s" if threads > 1 else "")
        place.say(unit)
        with _limited(threads):
            samples = _interleaved(subjects, repeats)
        rates = [2 * vector.nbytes / wall for wall, _ in samples.pop("bandwidth")]
        rows.append(place.measured("bandwidth", f"{unit}: rate", "bytes/s", rates))
        for name, seconds in samples.items():
            rows.append(place.measured(name, f"{unit}: wall", "s", [wall for wall, _ in seconds]))
            rows.append(place.measured(name, f"{unit}: CPU", "s", [cpu for _, cpu in seconds]))
    return rows


def traffic_bytes(problem: Problem) -> int:
    """Bytes that one value and gradient moves at least.

    The layers are read once, the gradient is written (which reads its lines too), the data is read once.
    """
    colors = problem.penalties.natural_image.mean.shape[1]
    canvas = problem.canvas
    layers = 2 * colors * canvas.shape[0] * canvas.shape[1]
    data = problem.pse.taps.shape[2] * colors * canvas.height * canvas.width
    return 4 * (layers + 2 * layers + data)


def _interleaved(subjects: Mapping[str, Callable[[], object]], repeats: int) -> dict[str, list[tuple[float, float]]]:
    """Elapsed and processor seconds of every call, round by round; the first round warms up."""
    samples: dict[str, list[tuple[float, float]]] = {name: [] for name in subjects}
    for _ in range(repeats + 1):
        for name, call in subjects.items():
            begun = (time.perf_counter(), time.process_time())
            call()
            samples[name].append((time.perf_counter() - begun[0], time.process_time() - begun[1]))
    return {name: seconds[1:] for name, seconds in samples.items()}


@contextmanager
def _limited(threads: int) -> Iterator[None]:
    """Within this context polaropt, torch and BLAS (one per block) use so many threads."""
    before = os.environ.get("OMP_NUM_THREADS")
    os.environ["OMP_NUM_THREADS"] = str(threads)
    try:
        with Threads(torch=threads, blas=1).set():
            yield
    finally:
        if before is None:
            del os.environ["OMP_NUM_THREADS"]
        else:
            os.environ["OMP_NUM_THREADS"] = before


def _dot(vector: NDArray[np.float32]) -> Callable[[], object]:
    """The product of two vectors far larger than a cache, in blocks on all threads."""
    other = vector.copy()

    def part(start: int, stop: int) -> float:
        return float(np.dot(vector[start:stop], other[start:stop]))

    return lambda: in_blocks(part, vector.size, 2**20)


def _compiled(problem: Problem, sparsity: GradientSparsity) -> Callable[[], object]:
    penalties = replace(problem.penalties, gradient_sparsity=sparsity)
    misfit = FusedMisfit(problem.capture, problem.pse, problem.canvas, problem.noise)
    layers = take_start(copy(problem), "closed-form")
    local = FusedPenalties(penalties, problem.canvas, layers.shape[1])
    gradient = np.empty_like(layers)

    def call() -> object:
        misfit.value_and_grad(layers, gradient)
        return local.value_and_grad(layers, gradient, _WEIGHTS)

    return call


def _autograd(problem: Problem, sparsity: GradientSparsity) -> Callable[[], object]:
    from studies.benchmark.autograd import AutogradObjective

    objective = AutogradObjective(problem, _WEIGHTS, sparsity)
    layers = take_start(copy(problem), "closed-form")
    return lambda: objective.value_and_grad(layers)
