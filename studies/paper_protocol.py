"""Accuracy on the paper's kind of scenes: PSNR of both layers with the scene known and blind, per incidence.

Run ``polaropt study paper_protocol -o OUT``; without ``--photos`` it uses photographs inside scikit-image.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass
from typing import Any

from pandas import DataFrame

from studies.camera import SceneJob
from studies.kit.charts import BLUE, VERMILION, Style, legend_below, new_figure
from studies.kit.frames import Cell, largest, markdown, mean, median, n_with, summary, values_of, where
from studies.kit.run import effort_of, publish, run_study, study_parser
from studies.photographs import N_PAIRS, n_pairs_of
from studies.scenes import INCIDENCES_DEG, Formula, protocol
from studies.scores import LAYERS, both_psnr, pane_errors, psnr
from studies.ways import DEFAULT, WITH_SCENE, alone, minimum_over_angles, plain_intensity

NAME = "paper_protocol"
QUICK_INCIDENCES_DEG = (10, 60, 85)
WAYS = ("start", "known", "blind")
NOT_SOLVED = (math.nan, math.nan)


@dataclass(frozen=True)
class Job(SceneJob):
    """One scene to be separated blind, and with the scene known as well."""

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
    sample = job.sample()
    start = known = NOT_SOLVED
    if job.known:
        start, known = (
            both_psnr(way.separation(sample).layers, sample.layers) for way in (alone(WITH_SCENE), WITH_SCENE)
        )
    blind = DEFAULT.separation(sample)
    pane = job.scene.pane
    row = Row(
        job.pair,
        pane.incidence_deg,
        pane.ghosts,
        *(psnr(method(sample)[0], sample.layers[0]) for method in (plain_intensity, minimum_over_angles)),
        *start,
        *known,
        *both_psnr(blind.layers, sample.layers),
        *astuple(pane_errors(blind.scene, sample.scene)),
        blind.solver.n_evaluations,
        sum(blind.seconds.values()),
        tuple(warning.name for warning in blind.diagnostics.warnings),
    )
    return [row]


def tables(frame: DataFrame) -> str:
    """Means per kind and incidence."""
    cells: dict[str, Cell] = {
        "s0": mean("nothing"),
        **{f"{layer[0].upper()} {way}": mean(f"{way}_{layer}") for way in WAYS for layer in LAYERS},
        "theta error (median, 90 %)": lambda part: (
            f"{median('incidence_error_deg')(part)}, {part.incidence_error_deg.quantile(0.9):.2f}"
        ),
        "azimuth error (largest)": largest("azimuth_error_deg"),
        "shift error (median)": median("shift_error_px"),
        "worst against doing nothing": lambda part: (
            f"{(part.blind_transmission - part[['nothing', 'minimum']].max(axis=1)).min():+.2f}"
        ),
        "evaluations": mean("evaluations", ".0f"),
        "s": mean("seconds", ".1f"),
        "warned": lambda part: f"{n_with(part, 'warnings', 'REFLECTION_NOT_IDENTIFIABLE')}/{len(part)}",
    }
    return markdown(summary(frame, {"step": "kind", "theta": "incidence_deg"}, cells))


_LINES = {
    "blind": ("solved blind (band: all pairs)", Style("black", "-", "o", 2.4)),
    "known": ("solved, scene known", Style(BLUE, "--", "s")),
    "start": ("closed form alone, scene known", Style(VERMILION, ":", "^")),
}
_NOTHING = ("plain intensity", Style("grey", "-.", "x"))
_KINDS = {"paper": "ghosts as far apart as the paper has them", "plate": "ghosts of a plane-parallel plate"}


def figures(frame: DataFrame) -> dict[str, Callable[[], Any]]:
    """PSNR of both layers over incidence: known, blind and before any solve."""
    return {NAME: lambda: _levels(frame)}


def _levels(frame: DataFrame) -> Any:
    """A row of panels for each kind of ghosts."""
    kinds = values_of(frame, "kind")
    figure = new_figure(10, 0.8 + 3.6 * len(kinds))
    grid = figure.subplots(len(kinds), len(LAYERS), squeeze=False, sharey="col")
    for panels, kind in zip(grid, kinds, strict=True):
        for panel, layer in zip(panels, LAYERS, strict=True):
            _panel(panel, where(frame, kind=kind), layer)
            panel.set_title(_KINDS.get(kind, kind))
    handles, names = grid[0, 0].get_legend_handles_labels()
    legend_below(figure, handles, names, len(names), handlelength=4)
    return figure


def _panel(panel: Any, frame: DataFrame, layer: str) -> None:
    by_incidence = frame.groupby("incidence_deg")
    lines = [(f"{name}_{layer}", *line) for name, line in _LINES.items()]
    if layer == "transmission":
        lines.append(("nothing", *_NOTHING))
    for column, label, style in lines:
        # What was not run is NaN, and shows no line.
        means = by_incidence[column].mean()
        panel.plot(means.index, means, label=label, **style.line)
    of_pairs = by_incidence[f"blind_{layer}"]
    panel.fill_between(of_pairs.min().index, of_pairs.min(), of_pairs.max(), color="0.85")
    panel.set_xticks(list(of_pairs.groups))
    panel.set_xlabel("angle of incidence (deg)")
    panel.set_ylabel(f"PSNR of the {layer} (dB)")


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the study."""
    parser = study_parser(__doc__)
    parser.add_argument("--kind", choices=("paper", "plate", "both"), help="Formula of the ghost step.")
    parser.add_argument("--incidences", help="Degrees, comma separated.")
    parser.add_argument("--blind-only", action="store_true", help="Leave out the solves with the scene known.")
    options = parser.parse_args(arguments)
    quick = effort_of(options) == "quick"
    kind = options.kind or ("paper" if quick else "both")
    formulas: tuple[Formula, ...] = ("paper", "plate") if kind == "both" else (kind,)
    default = QUICK_INCIDENCES_DEG if quick else INCIDENCES_DEG
    incidences = [float(text) for text in options.incidences.split(",")] if options.incidences else default
    jobs = [
        Job(protocol(incidence, formula), pair, options.photos, known=not options.blind_only)
        for formula in formulas
        for incidence in incidences
        for pair in range(n_pairs_of(options, 1 if quick else N_PAIRS))
    ]
    frame = run_study(NAME, run, jobs, Row, options)
    publish(NAME, options, tables(frame), figures(frame))


if __name__ == "__main__":
    main()
