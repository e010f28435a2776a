"""What each part of the separation is worth: the whole, and without each part, on the paper's six incidences.

Run ``polaropt study ablation -o OUT``. Differences are to the whole on the same scenes; their intervals come from
resampling the pairs of photographs. The learned start is no part of the whole: there it is put in.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import bootstrap
from threadpoolctl import threadpool_limits

from polaropt.capture import Capture, noise_level
from polaropt.errors import InputError
from polaropt.optics import SceneParameters
from studies.ablation_figures import draw
from studies.camera import take
from studies.kit.records import row_of, write_tables
from studies.kit.run import effort_of, run_jobs, study_parser, workers_of
from studies.photographs import N_PAIRS, Pair, n_pairs_of, pairs_of
from studies.scenes import INCIDENCES_DEG, protocol
from studies.scores import psnr_and_ssim
from studies.ways import PARTS, Part, weights_digest
from studies.ways import WHOLE as ALL

LAYERS = ("transmission", "reflection")
QUICK_INCIDENCES_DEG, QUICK_SIZE, SIZE = (10, 60), 128, 256
_SEED = 0
# A part earns its place if the mean of either layer is better by this with it than without.
_WORTH_DB = 0.05
# An interval over fewer pairs says nothing.
_FEWEST_PAIRS = 4


@dataclass(frozen=True)
class Job:
    """One scene, solved with every variant."""

    photos: str | None
    pair: int
    incidence_deg: float
    size: int


@dataclass(frozen=True)
class Row:
    """One solve: PSNR in dB and SSIM of both layers, 16 px at the border left out; seconds without the estimate.

    `not_run` says why it was not; empty if it was.
    """

    variant: str
    pair: int
    incidence_deg: float
    transmission: float = math.nan
    reflection: float = math.nan
    transmission_ssim: float = math.nan
    reflection_ssim: float = math.nan
    evaluations: int = 0
    seconds: float = math.nan
    not_run: str = ""


def run(job: Job) -> list[Row]:
    """Solve one scene with every variant; those that ask the same of the estimate share it."""
    pair = pairs_of(job.photos, job.size, job.size // 2)[job.pair]
    capture = take(protocol(job.incidence_deg), pair).capture
    noise = noise_level(capture)
    found: dict[SceneParameters, SceneParameters] = {}
    rows = []
    with threadpool_limits(1, "blas"):
        for variant in PARTS:
            if variant.hint not in found:
                found[variant.hint] = variant.estimate(capture, noise)
            rows.append(_row(job, pair, variant, capture, found[variant.hint]))
    return rows


def _row(job: Job, pair: Pair, variant: Part, capture: Capture, found: SceneParameters) -> Row:
    began = time.perf_counter()
    try:
        solved = variant.solved(capture, found, take(protocol(job.incidence_deg), pair).scene)
    except InputError as reason:
        return Row(variant.name, job.pair, job.incidence_deg, not_run=str(reason))
    seconds = time.perf_counter() - began
    quality = psnr_and_ssim(solved.layers, pair.layers)
    return Row(variant.name, job.pair, job.incidence_deg, *quality, solved.solver.n_evaluations, seconds)


def difference(rows: Sequence[Row], variant: Part, layer: str) -> tuple[float, float, float]:
    """Mean PSNR with the part less that without it, in dB, and its 95 % interval over pairs."""

    def per_pair(name: str) -> np.ndarray:
        part = [row for row in rows if row.variant == name]
        pairs = sorted({row.pair for row in part})
        return np.array([np.mean([getattr(row, layer) for row in part if row.pair == pair]) for pair in pairs])

    gain = per_pair(ALL) - per_pair(variant.name)
    gain = -gain if variant.added else gain
    mean = float(gain.mean())
    if len(gain) < _FEWEST_PAIRS:
        return mean, math.nan, math.nan
    if np.ptp(gain) == 0:
        return mean, mean, mean
    interval = bootstrap((gain,), np.mean, method="percentile", rng=np.random.default_rng(_SEED)).confidence_interval
    return mean, float(interval.low), float(interval.high)


def table(rows: Sequence[Row]) -> str:
    """Means over all scenes, and the worth of every part, as a Markdown table."""
    head = "| part | instead | T | R | T SSIM | R SSIM | T gained by it | R gained by it | evaluations | s | |"
    lines = [head, "|" + "---|" * 11]
    return "\n".join([*lines, *(_line(rows, variant) for variant in PARTS)])


def _line(rows: Sequence[Row], variant: Part) -> str:
    part = [row for row in rows if row.variant == variant.name]
    if reasons := [row.not_run for row in part if row.not_run]:
        return f"| {variant.change} | {variant.instead} |" + " |" * 8 + f" not run: {reasons[0]} |"
    means = [np.mean([getattr(row, name) for row in part]) for name in LAYERS]
    likeness = [np.mean([getattr(row, f"{name}_ssim") for row in part]) for name in LAYERS]
    gains = [difference(rows, variant, layer) for layer in LAYERS]
    told = [f"{mean:+.2f}" + ("" if math.isnan(low) else f" ({low:+.2f} to {high:+.2f})") for mean, low, high in gains]
    said = "" if variant.name == ALL else _verdict(gains, added=variant.added)
    return (
        f"| {variant.change} | {variant.instead} | " + " | ".join(f"{mean:.2f}" for mean in means) + " | "
        + " | ".join(f"{mean:.3f}" for mean in likeness) + " | " + " | ".join(told if said else ["", ""])
        + f" | {np.median([row.evaluations for row in part]):.0f} | {np.median([row.seconds for row in part]):.2f}"
        f" | {said} |"
    )  # fmt: skip


def _verdict(gains: Sequence[tuple[float, float, float]], *, added: bool) -> str:
    if math.isnan(gains[0][1]):
        return "too few pairs"
    if any(mean > _WORTH_DB and low > 0 for mean, low, _ in gains):
        return "would earn a place" if added else "earns its place"
    if any(mean < -_WORTH_DB and high < 0 for mean, _, high in gains):
        return "better without"
    return "does not show here"


def incidence_table(rows: Sequence[Row]) -> str:
    """PSNR of both layers per incidence, as a Markdown table."""
    incidences = sorted({row.incidence_deg for row in rows})
    lines = ["| part | " + " | ".join(f"{incidence:g} deg" for incidence in incidences) + " |"]
    lines.append("|" + "---|" * (len(incidences) + 1))
    for variant in PARTS:
        cells = []
        for incidence in incidences:
            part = [row for row in rows if (row.variant, row.incidence_deg) == (variant.name, incidence)]
            means = [np.mean([getattr(row, name) for row in part]) for name in LAYERS]
            ran = not any(row.not_run for row in part)
            cells.append(" / ".join(f"{mean:.2f}" for mean in means) if ran else "not run")
        lines.append(f"| {variant.change} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the tables and write them with all rows and figures."""
    parser = study_parser(__doc__)
    options = parser.parse_args(arguments)
    quick = effort_of(options) == "quick"
    size = QUICK_SIZE if quick else SIZE
    n_pairs = n_pairs_of(options, 2 if quick else N_PAIRS, size, size // 2)
    incidences = QUICK_INCIDENCES_DEG if quick else INCIDENCES_DEG
    jobs = [Job(options.photos, pair, float(theta), size) for pair in range(n_pairs) for theta in incidences]
    made = run_jobs(run, jobs, options.out / "ablation.json", {"weights": weights_digest()}, workers_of(options))
    rows = [row_of(Row, row) for row in made]
    text = f"{table(rows)}\n\n{incidence_table(rows)}"
    print(text)
    write_tables(options.out, "ablation", made, text)
    absent = {row.variant for row in rows if row.not_run}
    drawn = [variant for variant in PARTS[1:] if variant.name not in absent]
    gains = {v.name: [difference(rows, v, layer) for layer in LAYERS] for v in drawn}
    draw(gains, pairs_of(options.photos, size, size // 2)[0], [PARTS[0], *drawn], options.out)


if __name__ == "__main__":
    main()
