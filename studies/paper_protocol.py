"""Accuracy on the paper's kind of scenes: PSNR of both layers with the scene known and blind, per incidence.

Run ``polaropt study paper_protocol -o OUT``; without ``--photos`` it uses photographs inside scikit-image.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from polaropt.capture import Capture
from polaropt.separation import Separation, separate
from polaropt.simulation import psnr_db
from studies.command import effort_of, hands_of, n_pairs_of, pairs_of, study_parser
from studies.paper_protocol_figure import draw
from studies.protocol import (
    EVALUATION_BORDER,
    INCIDENCES_DEG,
    N_PAIRS,
    Image,
    Kind,
    protocol_capture,
    protocol_scene,
    truth,
)
from studies.record import write_tables
from studies.work import row_of, run_jobs


@dataclass(frozen=True)
class Job:
    """One scene to be separated twice: known and blind."""

    photos: str | None
    pair: int
    incidence_deg: float
    kind: Kind
    known: bool = True


@dataclass(frozen=True)
class Row:
    """What came out: PSNR in dB, errors of the scene, evaluations and seconds."""

    pair: int
    incidence_deg: float
    kind: str
    nothing: float
    minimum: float
    start_transmission: float
    start_reflection: float
    known_transmission: float
    known_reflection: float
    blind_transmission: float
    blind_reflection: float
    incidence_error_deg: float
    azimuth_error_deg: float
    shift_error_px: float
    evaluations: int
    seconds: float
    warnings: tuple[str, ...]


def run(job: Job) -> list[Row]:
    """Separate one scene, known and blind."""
    pair = pairs_of(job.photos)[job.pair]
    scene = protocol_scene(pair, job.incidence_deg, job.kind)
    capture = protocol_capture(pair, job.incidence_deg, job.kind)
    layers = truth(pair)
    nothing, minimum = trivial_psnr(capture, layers[0])
    start = known = (math.nan, math.nan)
    if job.known:
        from polaropt import StoppingRule

        start = _psnr(separate(capture, scene, stopping=StoppingRule(max_evaluations=1)), layers)
        known = _psnr(separate(capture, scene), layers)
    blind = separate(capture)
    incidence, azimuth, shift = scene_errors(blind, scene.values())
    row = Row(
        job.pair, job.incidence_deg, job.kind, nothing, minimum, *start, *known, *_psnr(blind, layers),
        incidence, azimuth, shift, blind.solver.n_evaluations, sum(blind.seconds.values()),
        tuple(warning.name for warning in blind.diagnostics.warnings),
    )  # fmt: skip
    return [row]


def trivial_psnr(capture: Capture, transmission: Image) -> tuple[float, float]:
    """PSNR of the plain intensity and of twice the minimum over all angles, taken as transmission."""
    s0, s1, s2 = capture.stokes
    target = np.moveaxis(transmission, -1, 0)
    return (
        psnr_db(s0, target, EVALUATION_BORDER),
        psnr_db(s0 - np.hypot(s1, s2), target, EVALUATION_BORDER),
    )


def scene_errors(result: Separation, true: tuple[float, float, float]) -> tuple[float, float, float]:
    """Absolute errors of incidence (deg), azimuth (deg, modulo 180) and shift (px, along the true azimuth)."""
    incidence, azimuth, shift = result.scene.values()
    turn = (azimuth - true[1] + 90) % 360 - 90
    if turn > 90:
        turn, shift = turn - 180, -shift
    return abs(incidence - true[0]), abs(turn), abs(shift - true[2])


def _psnr(result: Separation, layers: tuple[Image, Image]) -> tuple[float, float]:
    planes = [np.moveaxis(layer, -1, 0) for layer in layers]
    return (
        psnr_db(result.layers[0], planes[0], EVALUATION_BORDER),
        psnr_db(result.layers[1], planes[1], EVALUATION_BORDER),
    )


def table(rows: Sequence[Row]) -> str:
    """Means per kind and incidence, as a Markdown table."""
    lines = [
        "| step | theta | s0 | T start | R start | T known | R known | T blind | R blind "
        "| theta error (median, 90 %) | azimuth error (largest) | shift error (median) | worst against doing nothing "
        "| evaluations | s | warned |",
        "|" + "---|" * 16,
    ]
    for kind, incidence in dict.fromkeys((row.kind, row.incidence_deg) for row in rows):
        lines.append(_line([row for row in rows if (row.kind, row.incidence_deg) == (kind, incidence)]))
    return "\n".join(lines)


def _line(rows: Sequence[Row]) -> str:
    def mean(name: str) -> float:
        return float(np.mean([getattr(row, name) for row in rows]))

    def column(name: str) -> list[float]:
        return [getattr(row, name) for row in rows]

    levels = ("nothing", "start_transmission", "start_reflection", "known_transmission", "known_reflection",
              "blind_transmission", "blind_reflection")  # fmt: skip
    worst = min(row.blind_transmission - max(row.nothing, row.minimum) for row in rows)
    warned = sum("REFLECTION_NOT_IDENTIFIABLE" in row.warnings for row in rows)
    return (
        f"| {rows[0].kind} | {rows[0].incidence_deg:g} | "
        + " | ".join(f"{mean(name):.2f}" for name in levels)
        + f" | {np.median(column('incidence_error_deg')):.2f}, {np.percentile(column('incidence_error_deg'), 90):.2f}"
        f" | {max(column('azimuth_error_deg')):.2f} | {np.median(column('shift_error_px')):.2f} | {worst:+.2f}"
        f" | {mean('evaluations'):.0f} | {mean('seconds'):.1f} | {warned}/{len(rows)} |"
    )


QUICK_INCIDENCES_DEG = (10, 60, 85)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table and write it with all rows."""
    parser = study_parser(__doc__)
    parser.add_argument("--kind", choices=("paper", "plate", "both"), help="formula of the ghost step")
    parser.add_argument("--incidences", help="degrees, comma separated")
    parser.add_argument("--blind-only", action="store_true", help="leave out the solves with the scene known")
    options = parser.parse_args(arguments)
    quick = effort_of(options) == "quick"
    kind = options.kind or ("paper" if quick else "both")
    kinds: tuple[Kind, ...] = ("paper", "plate") if kind == "both" else (kind,)
    default = QUICK_INCIDENCES_DEG if quick else INCIDENCES_DEG
    incidences = [float(text) for text in options.incidences.split(",")] if options.incidences else default
    jobs = [
        Job(options.photos, pair, float(incidence), kind, not options.blind_only)
        for kind in kinds
        for incidence in incidences
        for pair in range(n_pairs_of(options, 1 if quick else N_PAIRS))
    ]
    made = run_jobs(run, jobs, options.out / "paper_protocol.json", {}, hands_of(options))
    rows = [row_of(Row, row) for row in made]
    print(table(rows))
    write_tables(options.out, "paper_protocol", made, table(rows))
    draw(rows, options.out)


if __name__ == "__main__":
    main()
