"""Whole separations: what running on beyond the default gains, and what finding the scene blind costs."""

from __future__ import annotations

import time

from polaropt.optics import SceneParameters
from polaropt.separation import separate
from polaropt.solving import start_names
from solvers.base import StoppingRule
from studies.benchmark.rows import Place, Row
from studies.camera import Sample
from studies.scores import both_psnr

MOMENTS = ("at the start", "at the default stopping", "at 1e-6")
_RELATIVE_CHANGE = 1e-6


def measure_running_on(place: Place, sample: Sample, max_evaluations: int) -> list[Row]:
    """PSNR and evaluations from every start, at the start, where the solve stops by itself, and far beyond."""
    rules = (StoppingRule(max_evaluations=1), StoppingRule(), StoppingRule(max_evaluations, _RELATIVE_CHANGE))
    rows = []
    for init in start_names():
        for when, stopping in zip(MOMENTS, rules, strict=True):
            place.say(f"{init}, {when}")
            result = separate(sample.capture, sample.scene, init=init, stopping=stopping)
            transmission, reflection = both_psnr(result.layers, sample.layers)
            value = sum(term.weight * term.value for term in result.terms.values())
            rows += [
                place.measured(init, f"transmission {when}", "dB", [transmission]),
                place.measured(init, f"reflection {when}", "dB", [reflection]),
                place.measured(init, f"evaluations {when}", "", [result.solver.n_evaluations]),
                place.measured(init, f"objective {when}", "", [value], note=result.solver.status.name),
            ]
    return rows


def measure_blind(place: Place, sample: Sample, repeats: int) -> list[Row]:
    """Seconds of `separate` with the scene known and with nothing known, interleaved."""
    samples: dict[tuple[str, str], list[float]] = {}
    for repeat in range(repeats + 1):
        for name, scene in (("known scene", sample.scene), ("blind", None)):
            place.say(f"{name}: round {repeat} of {repeats}" if repeat else f"{name}: warming up")
            seconds = _timed(sample, scene)
            if repeat:
                for what, value in seconds.items():
                    samples.setdefault((name, what), []).append(value)
    return [place.measured(name, what, "s", values) for (name, what), values in samples.items()]


def _timed(sample: Sample, scene: SceneParameters | None) -> dict[str, float]:
    """Seconds of one separation: as a whole, and of its stages."""
    begun = (time.perf_counter(), time.process_time())
    result = separate(sample.capture, scene)
    taken = {"wall": time.perf_counter() - begun[0], "CPU": time.process_time() - begun[1]}
    stages = {f"wall, {stage.lower()}": seconds for stage, seconds in result.seconds.items()}
    return taken | stages | {f"CPU, {stage.lower()}": seconds for stage, seconds in result.cpu_seconds.items()}
