"""This software against others' methods: the paper's protocol, its special cases, and measured layers.

Run ``polaropt study peers -o OUT`` (``--quick`` for a look, ``--photos DIR`` for other photographs than those inside
scikit-image, ``--layers DIR`` for measured layers NAME_T.png, NAME_R.png). ``make peers`` first, for the single-image
method.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pandas import DataFrame

from studies.camera import Sample, SceneJob
from studies.kit.charts import BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILION, Style, new_figure
from studies.kit.frames import Cell, across, joined, markdown, mean, values_of, where
from studies.kit.run import effort_of, publish, run_study, study_parser
from studies.peers.published import TABLES, PublishedTable
from studies.peers.single_image import built
from studies.photographs import N_PAIRS, Pair, measured_pairs, n_pairs_of
from studies.scenes import INCIDENCES_DEG, SPECIAL, protocol
from studies.scenes import SPECIAL_CASES as SPECIAL_SCENES
from studies.scores import LAYERS, fitted_psnr, psnr, ssim
from studies.ways import FULL, METHODS, NETWORKS, Method, NotRun, seen_in_training

NAME = "peers"
PROTOCOL, SPECIAL_CASES, MEASURED = "paper protocol", "special cases", "measured layers"
QUICK_SIZE, SIZE = 128, 256
QUICK_INCIDENCES_DEG = (40, 70)
QUICK_SPECIAL = 2
SPECIAL_PAIRS = 3


@dataclass(frozen=True)
class Job(SceneJob):
    """One scene; `photos` is the folder of measured layers, where they are `measured`."""

    measured: bool = False

    @property
    def photographs(self) -> Pair:
        """The pair."""
        if self.measured:
            return measured_pairs(Path(self.photos or "."), self.size, self.size // 2)[self.pair]
        return super().photographs

    @property
    def group(self) -> str:
        """The set: `PROTOCOL`, `SPECIAL_CASES` or `MEASURED`."""
        return MEASURED if self.measured else SPECIAL_CASES if self.scene.family == SPECIAL else PROTOCOL

    @property
    def column(self) -> str:
        """The special case, or the incidence in degrees."""
        return self.scene.label if self.group == SPECIAL_CASES else f"{self.scene.value:g}"


@dataclass(frozen=True)
class Row:
    """How one method did on one scene; not a number is what it does not show or was not run.

    Attributes
    ----------
    group, scene, pair
        The set, its column and the pair's number.
    method : str
    transmission, reflection : float
        PSNR in dB over pixels that no photograph clips, 16 px at the border left out.
    transmission_ssim, reflection_ssim : float
    transmission_fitted, reflection_fitted : float
        PSNR in dB where each layer gets the gain and offset that suit the true one best.
    seconds : float
    not_run : str
        Why; empty if it was.
    """

    group: str
    scene: str
    pair: int
    method: str
    transmission: float = math.nan
    reflection: float = math.nan
    transmission_ssim: float = math.nan
    reflection_ssim: float = math.nan
    transmission_fitted: float = math.nan
    reflection_fitted: float = math.nan
    seconds: float = math.nan
    not_run: str = ""


def run(job: Job, methods: Sequence[Method] = tuple(METHODS.values())) -> list[Row]:
    """Separate one scene by every method."""
    sample = job.sample()
    return [_row(job, method, sample) for method in methods]


def _row(job: Job, method: Method, sample: Sample) -> Row:
    began = time.perf_counter()
    try:
        # Measured layers are of no one's training.
        if method.name == NETWORKS and job.group != MEASURED and (seen := seen_in_training(job.photos)):
            raise NotRun(seen)
        layers = method.run(sample)
    except NotRun as reason:
        return Row(job.group, job.column, job.pair, method.name, not_run=str(reason))
    seconds = time.perf_counter() - began
    scores: dict[str, float] = {}
    for name, layer, truth in zip(LAYERS, layers, sample.layers, strict=True):
        if layer is not None:
            scores[name] = psnr(layer, truth, sample.unclipped)
            scores[f"{name}_ssim"] = ssim(layer, truth, sample.unclipped)
            scores[f"{name}_fitted"] = fitted_psnr(layer, truth, sample.unclipped)
    return Row(job.group, job.column, job.pair, method.name, seconds=seconds, **scores)


# Tables.


def tables(frame: DataFrame) -> str:
    """One table per set, the margins, what each method was told, the paper's own figures."""
    parts = [
        "# Against other methods",
        "PSNR in dB of transmission / reflection against the true layers, over pixels that no photograph clips; means "
        "over pairs. A method marked * has no scale of its own: its layers are given the gain and offset that suit the "
        "true ones best. `-` is what a method does not show.",
    ]
    for group in values_of(frame, "group"):
        rows = where(frame, group=group)
        parts += [f"## {group[0].upper()}{group[1:]}", markdown(_levels(rows), "lr")]
        if leads := _leads(rows):
            parts.append(
                f"Lead of the full solve over the best peer that is not part of this project, in dB:\n\n{leads}"
            )
    told = DataFrame([[method.name, method.given, method.source] for method in METHODS.values()])
    parts += ["## What each method is told", markdown(told.set_axis(["method", "told of the truth", "source"], axis=1))]
    parts += ["## The source paper's own figures", "From that paper's photographs, not from these: PSNR in dB / SSIM."]
    parts += [f"{table.title}:\n\n{markdown(_in_print(table), 'lr')}" for table in TABLES]
    return "\n\n".join(parts)


def _levels(frame: DataFrame) -> DataFrame:
    """A line per method of what a set shows."""
    cells: dict[str, Cell] = {
        **across("scene", values_of(frame, "scene"), _both(), _heading),
        "mean": _both(),
        "SSIM": _both("_ssim", ".3f"),
        "mean with best gain and offset": _both("_fitted"),
        "s": mean("seconds"),
    }
    lines = []
    for method in METHODS.values():
        rows = where(frame, method=method.name)
        name = f"**{method.name}**" if method.ours else method.name + ("*" if method.scaleless else "")
        if rows.empty:
            continue
        if all(rows.not_run):
            lines.append([name, f"not run: {rows.not_run.iloc[0]}", *[""] * (len(cells) - 1)])
        else:
            lines.append([name, *(cell(rows) for cell in cells.values())])
    return DataFrame(lines, columns=["method", *cells], dtype=object)


def _both(ending: str = "", form: str = ".1f") -> Cell:
    return joined(*(_shown(layer + ending, form) for layer in LAYERS))


def _shown(column: str, form: str) -> Cell:
    return lambda part: mean(column, form)(part) if part[column].notna().any() else "-"


def _heading(scene: str) -> str:
    """Incidences with their unit."""
    return f"{scene} deg" if scene.isdecimal() else scene


def margins(frame: DataFrame, column: str) -> list[tuple[str, float, str]]:
    """Per scene and at last on average: its name, the full solve's lead over the best peer in dB, and that peer."""
    peers = [method.name for method in METHODS.values() if not method.ours]
    levels = frame.pivot_table(column, "method", "scene", sort=False)
    levels = levels.reindex(columns=values_of(frame, "scene")).assign(mean=frame.groupby("method")[column].mean())
    leads = []
    for scene in levels:
        theirs = levels[scene].reindex(peers).dropna()
        ours = levels[scene].get(FULL, math.nan)
        if len(theirs) and not math.isnan(ours):
            leads.append((str(scene), ours - theirs.max(), str(theirs.idxmax())))
    return leads


def _leads(frame: DataFrame) -> str:
    words = {"transmission_fitted": "transmission, all with best gain and offset"}
    lines = []
    for column in (*LAYERS, *words):
        leads = [f"{_heading(scene)} {lead:+.1f} ({peer})" for scene, lead, peer in margins(frame, column)]
        if leads:
            lines.append(f"- {words.get(column, column)}: {', '.join(leads)}")
    return "\n".join(lines)


def _in_print(table: PublishedTable) -> DataFrame:
    lines = [
        [method, *(f"{level:.2f} / {likeness:.3f}" for level, likeness in (*levels, np.mean(levels, axis=0)))]
        for method, levels in table.methods.items()
    ]
    return DataFrame(lines, columns=["method", *table.scenes, "mean"])


_STYLES = (
    Style("grey", (0, (1, 1)), "+"),
    Style(ORANGE, (0, (5, 1, 1, 1)), "x"),
    Style(PURPLE, (0, (3, 2)), "d"),
    Style(GREEN, ":", "v"),
    Style(BLUE, "--", "s"),
    Style(VERMILION, "-.", "^"),
    Style("#8c564b", (0, (4, 1, 1, 1, 1, 1)), "*"),
    Style(SKY, (0, (6, 2)), "P"),
    Style("#332288", (0, (2, 1)), "X"),
    Style("black", "-", "o", 2.6),
)


def figures(frame: DataFrame) -> dict[str, Callable[[], Any]]:
    """PSNR of both layers over incidence, a line per method, of the paper's protocol."""
    rows = where(frame, group=PROTOCOL)
    return {} if rows.empty else {NAME: lambda: _over_incidence(rows)}


def _over_incidence(frame: DataFrame) -> Any:
    figure = new_figure(10, 5.2)
    panels = figure.subplots(1, len(LAYERS))
    scenes = values_of(frame, "scene")
    for panel, layer in zip(panels, LAYERS, strict=True):
        levels = frame.pivot_table(layer, "method", "scene").reindex(columns=scenes)
        for method, style in zip(METHODS, _STYLES, strict=True):
            if method in levels.index:
                panel.plot(range(len(scenes)), levels.loc[method], label=method, **style.line)
        panel.set_xticks(range(len(scenes)), scenes)
        panel.set_xlabel("angle of incidence (deg)")
        panel.set_ylabel(f"PSNR of the {layer} (dB)")
    handles, names = panels[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=4)
    return figure


def jobs_of(photos: str | None, layers: str | None, n_pairs: int, *, quick: bool, size: int) -> list[Job]:
    """All scenes, or a few of each set."""
    on_protocol = [protocol(incidence) for incidence in (QUICK_INCIDENCES_DEG if quick else INCIDENCES_DEG)]
    special = SPECIAL_SCENES[: QUICK_SPECIAL if quick else None]
    n_measured = 0 if layers is None else len(measured_pairs(Path(layers), size, size // 2))
    return [
        *(Job(scene, pair, photos, size) for scene in on_protocol for pair in range(n_pairs)),
        *(Job(scene, pair, photos, size) for scene in special for pair in range(min(n_pairs, SPECIAL_PAIRS))),
        *(Job(scene, pair, layers, size, measured=True) for scene in on_protocol for pair in range(n_measured)),
    ]


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the study."""
    parser = study_parser(__doc__)
    parser.add_argument("--layers", metavar="DIR", help="Folder of measured layers NAME_T.png, NAME_R.png.")
    options = parser.parse_args(arguments)
    quick = effort_of(options) == "quick"
    size = QUICK_SIZE if quick else SIZE
    n_pairs = n_pairs_of(options, 1 if quick else N_PAIRS, size)
    jobs = jobs_of(options.photos, options.layers, n_pairs, quick=quick, size=size)
    frame = run_study(NAME, run, jobs, Row, options, {"single_image": built()})
    publish(NAME, options, tables(frame), figures(frame), dpi=130)


if __name__ == "__main__":
    main()
