"""Whole separations: what running on beyond the default gains, and what finding the scene blind costs."""

from __future__ import annotations

import time
from collections.abc import Callable

from polaropt.optics import SceneParameters
from polaropt.separation import Separation, separate
from polaropt.solving import start_names
from solvers.base import StoppingRule
from studies.benchmark_record import Measurement, Place
from studies.benchmark_scenes import Example

RUNNING_ON = "running on"
BLIND = "blind"
INCIDENCES_DEG = (10.0, 20.0, 85.0)
BLIND_INCIDENCE_DEG = 60.0

_RELATIVE_CHANGE = 1e-6

Tell = Callable[[str], None]


def measure_running_on(place: Place, example: Example, max_evaluations: int, tell: Tell) -> list[Measurement]:
    """PSNR and evaluations from every start, at the start, where the solve stops by itself, and far beyond."""
    moments = {
        "at the start": StoppingRule(max_evaluations=1),
        "at the default stopping": StoppingRule(),
        "at 1e-6": StoppingRule(max_evaluations=max_evaluations, relative_change=_RELATIVE_CHANGE),
    }
    measurements = []
    for init in start_names():
        for when, stopping in moments.items():
            tell(f"{init}, {when}")
            result = separate(example.capture, example.scene, init=init, stopping=stopping)
            decibels = example.psnr_db(result.layers)
            value = sum(term.weight * term.value for term in result.terms.values())
            measurements += [
                place.measured(init, f"transmission {when}", "dB", [decibels[0]]),
                place.measured(init, f"reflection {when}", "dB", [decibels[1]]),
                place.measured(init, f"evaluations {when}", "", [result.solver.n_evaluations]),
                place.measured(init, f"objective {when}", "", [value], note=result.solver.status.name),
            ]
    return measurements


def measure_blind(place: Place, example: Example, repeats: int, tell: Tell) -> list[Measurement]:
    """Seconds of `separate` with the scene known and with nothing known, interleaved."""
    scenes: dict[str, SceneParameters | None] = {"known scene": example.scene, "blind": None}
    samples: dict[tuple[str, str], list[float]] = {}
    for repeat in range(repeats + 1):
        for name, scene in scenes.items():
            tell(f"{name}: round {repeat} of {repeats}" if repeat else f"{name}: warming up")
            seconds = _timed(example, scene)
            if repeat:
                for what, value in seconds.items():
                    samples.setdefault((name, what), []).append(value)
    return [place.measured(name, what, "s", values) for (name, what), values in samples.items()]


def _timed(example: Example, scene: SceneParameters | None) -> dict[str, float]:
    """Seconds of one separation: as a whole, and of its stages."""
    begun = (time.perf_counter(), time.process_time())
    result: Separation = separate(example.capture, scene)
    taken = {"wall": time.perf_counter() - begun[0], "CPU": time.process_time() - begun[1]}
    stages = {f"wall, {stage.lower()}": seconds for stage, seconds in result.seconds.items()}
    return taken | stages | {f"CPU, {stage.lower()}": seconds for stage, seconds in result.cpu_seconds.items()}
