"""How far scenes may leave the plain case: errors, failures, and whether the warnings told of them.

Run ``polaropt study stability -o OUT`` (``--quick`` for a look, ``--photos DIR`` for other photographs than those
inside scikit-image).

A separation fails where its transmission is worse than the plain intensity by more than 0.1 dB; where it lies more
than 10 dB below what the family gives at its easy end on the same pair and gains less than 6 dB over the better
trivial baseline; or where the reflection's detail correlates with the truth by less than 0.3.

A failure is announced by any warning but those that speak of something else: clipped pixels announce nothing, and a
reflection that cannot be identified says nothing of the transmission. An alarm is false where nothing fails and it is
not true of the scene either (that it was gamma-encoded, say); "strictly" counts those too.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pandas import DataFrame, MultiIndex

from studies.camera import Sample, SceneJob
from studies.kit.charts import BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILION, Style, legend_below, new_figure
from studies.kit.frames import Cell, across, joined, markdown, mean, summary, values_of, where
from studies.kit.run import effort_of, publish, run_study, study_parser
from studies.photographs import n_pairs_of
from studies.scenes import MAP, SPECIAL, STABILITY, STABILITY_QUICK, Scene
from studies.scores import both_psnr, detail_correlation
from studies.ways import COMPONENTS, DEFAULT, METHODS, RUNGS
from studies.ways import MINIMUM as MINIMUM_OVER_ANGLES
from studies.ways import PLAIN as PLAIN_INTENSITY

NAME = "stability"
SIZE = 128
N_PAIRS = {"quick": 1, "default": 3, "full": 4}
AUTO, NOTHING, MINIMUM = DEFAULT.rung, "s0", "minimum"
BASELINES = {NOTHING: PLAIN_INTENSITY, MINIMUM: MINIMUM_OVER_ANGLES, COMPONENTS: COMPONENTS}
"""Methods that know no pane, by the names that they have in this study."""
WAYS = (*RUNGS, *BASELINES)
"""By their names; polaropt's model "none" is doing nothing."""

WORSE_DB, FAR_DB, LITTLE_GAIN_DB, LEAST_DETAIL = 0.1, 10.0, 6.0, 0.3
_SAYS_NOTHING = frozenset({"SATURATED"})
_OF_REFLECTION = frozenset({"REFLECTION_NOT_IDENTIFIABLE"})


@dataclass(frozen=True)
class Job(SceneJob):
    """One scene to be separated in some ways."""

    ways: tuple[str, ...] = ()


@dataclass(frozen=True)
class Row:
    """One separation.

    Attributes
    ----------
    family, case, value, second, pair
        The scene, see `studies.scenes.Scene`; the pair's number.
    method : str
    transmission, reflection : float
        PSNR in dB over pixels that no photograph clips, 16 px at the border left out.
    detail : float
        Correlation of the reflection's detail (finer than about 5 px) with the true one.
    rung : str
        That was taken; empty for the baselines.
    incidence_deg : float or None
        That was found.
    misfit : float or None
        Mean squared residual in units of the noise.
    seconds : float
    warnings : tuple of str
    """

    family: str
    case: str
    value: float
    second: float
    pair: int
    method: str
    transmission: float
    reflection: float
    detail: float
    rung: str
    incidence_deg: float | None
    misfit: float | None
    seconds: float
    warnings: tuple[str, ...]


def run(job: Job) -> list[Row]:
    """Separate one scene in every way that is wanted."""
    sample = job.sample()
    return [_row(job, method, sample) for method in job.ways]


def _row(job: Job, method: str, sample: Sample) -> Row:
    began = time.perf_counter()
    rung, incidence, misfit, warnings = "", None, None, ()
    if method in BASELINES:
        transmission, reflection = METHODS[BASELINES[method]].run(sample)
        layers = np.stack([transmission, np.zeros_like(transmission) if reflection is None else reflection])
    else:
        result = RUNGS[method].separation(sample)
        layers, rung = result.layers, result.scene.rung
        incidence, misfit = result.scene.incidence_deg, result.diagnostics.misfit_ratio
        warnings = tuple(warning.name for warning in result.diagnostics.warnings)
    seconds = time.perf_counter() - began
    quality = both_psnr(layers, sample.layers, sample.unclipped)
    detail = detail_correlation(layers[1], sample.layers[1], sample.unclipped)
    scene = job.scene
    return Row(
        scene.family, scene.name, scene.value, scene.second, job.pair, method, *quality, detail, rung, incidence,
        misfit, seconds, warnings,
    )  # fmt: skip


# What fails, and what was said of it.


def facts(scene: Scene) -> frozenset[str]:
    """Warnings that are true of a scene, whether or not it fails.

    That the model does not explain the photographs is true where the scene is none of the model's.
    """
    pane, taking = scene.pane, scene.taking
    polarized = pane.screen_dolp > 0 or pane.sky_dolp > 0
    moved, encoded = 2 * taking.shift_px >= 0.5 or taking.turn_deg > 0, taking.gamma != 1
    told_wrongly = "told" in scene.family and not scene.easy
    true = {
        "SATURATED": True,
        "NEAR_NORMAL": pane.incidence_deg < 12,
        "GRAZING": pane.incidence_deg > 84,
        "MISALIGNED": moved,
        "GAMMA_ENCODED": encoded,
        "POLARIZED_SOURCE": polarized,
        "INCIDENCE_DOUBTFUL": told_wrongly and scene.family.startswith("incidence"),
        "MODEL_DOES_NOT_EXPLAIN": any((polarized, moved, encoded, told_wrongly, taking.bend_deg)),
    }
    return frozenset(name for name, holds in true.items() if holds)


def judge(frame: DataFrame, scenes: Iterable[Scene] = STABILITY) -> DataFrame:
    """The rows of families whose easy end is there, judged against the baselines of the same scene and that end.

    Returns
    -------
    DataFrame
        With these columns as well: `gain`, the transmission's advantage over the plain intensity in dB; what fails,
        `worse` and `far` (transmission), `lost` (reflection), `failed` (any); `announced`, whether all that fails was;
        `false_alarm`, and `strictly_false`, where what is true of the scene counts, too, clipped pixels apart.
    """
    known = {scene.name: scene for scene in scenes}
    easy = {scene.family: scene.name for scene in known.values() if scene.easy}
    levels = frame.set_index(["case", "pair", "method"]).transmission

    def level(cases: Iterable[str], method: str) -> np.ndarray:
        there = MultiIndex.from_arrays([list(cases), frame.pair, [method] * len(frame)])
        return levels.reindex(there).to_numpy()

    best = level(frame.family.map(easy), AUTO)
    nothing, minimum = level(frame.case, NOTHING), level(frame.case, MINIMUM)
    gain = frame.transmission - nothing
    far = (frame.transmission < best - FAR_DB) & (frame.transmission < np.fmax(nothing, minimum) + LITTLE_GAIN_DB)
    judged = frame.assign(gain=gain, worse=gain < -WORSE_DB, far=far, lost=frame.detail < LEAST_DETAIL)
    in_transmission = judged.worse | judged.far
    failed = in_transmission | judged.lost
    said = [frozenset(warnings) for warnings in frame.warnings]
    of_any = np.array([bool(names - _SAYS_NOTHING) for names in said], bool)
    of_transmission = np.array([bool(names - _SAYS_NOTHING - _OF_REFLECTION) for names in said], bool)
    untrue = np.array([bool(names - facts(known[case])) for names, case in zip(said, frame.case, strict=True)], bool)
    judged = judged.assign(
        failed=failed,
        announced=(of_transmission | ~in_transmission) & (of_any | ~judged.lost),
        false_alarm=~failed & untrue,
        strictly_false=~failed & of_any,
    )
    return judged[~np.isnan(best)]


@dataclass(frozen=True)
class Score:
    """How some separations did: their number, failures, announcements and the least gain over doing nothing (dB)."""

    n: int
    failed: int
    worse: int
    announced: int
    false_alarms: int
    strictly_false: int
    least_gain: float

    @property
    def recall(self) -> float:
        """Share of the failures that were announced; 1 without any."""
        return self.announced / self.failed if self.failed else 1.0

    def share(self, alarms: int) -> float:
        """Share of alarms among the separations that do not fail."""
        return alarms / max(1, self.n - self.failed)


def score(judged: DataFrame) -> Score:
    """Counts over separations."""
    announced = judged.failed & judged.announced
    flags = (judged.failed, judged.worse, announced, judged.false_alarm, judged.strictly_false)
    return Score(len(judged), *(int(flag.sum()) for flag in flags), judged.gain.min() if len(judged) else 0.0)


# Tables.

_COUNTS = {
    "separations": "n",
    "fail": "failed",
    "worse than nothing": "worse",
    "announced": "announced",
    "false alarms": "false_alarms",
    "strictly": "strictly_false",
}
_SIDES_OF_FAILURES = "lrrrlll"


def tables(frame: DataFrame) -> str:
    """Headline, warnings per family, methods per family, and each failure that nobody told."""
    judged = judge(frame)
    auto = where(judged, method=AUTO)
    total = score(auto)
    family = {"family": "family"}
    of_warnings: dict[str, Cell] = {head: _count(name) for head, name in _COUNTS.items()}
    of_warnings["least gain"] = lambda part: f"{score(part).least_gain:+.2f}"
    levels = joined(mean("transmission", ".1f"), mean("reflection", ".1f"))
    methods = across("method", values_of(judged, "method"), lambda part: f"{levels(part)} ({_per_cent(part.worse)})")
    return "\n\n".join([
        "# Stability",
        f"{total.n} separations by `auto`: {total.failed} fail, {100 * total.recall:.1f} % of them announced; "
        f"{100 * total.share(total.false_alarms):.1f} % false alarms among the others "
        f"({100 * total.share(total.strictly_false):.1f} % strictly). {total.worse} are worse than doing nothing by "
        f"more than {WORSE_DB:g} dB; least gain {total.least_gain:+.2f} dB.",
        markdown(summary(auto, family, of_warnings), "lr"),
        "Means of transmission / reflection in dB (share of transmissions worse than the plain intensity):",
        markdown(summary(judged, family, methods), "lr"),
        markdown(_failures(auto), _SIDES_OF_FAILURES),
    ])  # fmt: skip


def _count(name: str) -> Cell:
    return lambda part: str(getattr(score(part), name))


def _per_cent(flags: Any) -> str:
    return f"{100 * flags.mean():.0f} %"


def _failures(auto: DataFrame) -> DataFrame:
    """All that went wrong with `auto`, scene by scene: what was not announced, and false alarms."""
    wrong = auto[auto.worse | (auto.failed & ~auto.announced) | auto.false_alarm]
    lines = [
        [
            row.case,
            row.pair,
            f"{row.transmission:.1f} ({row.gain:+.1f})",
            f"{row.detail:.2f}",
            row.rung,
            _what_failed(row),
            ", ".join(row.warnings) or "-",
        ]
        for row in wrong.itertuples()
    ]
    return DataFrame(lines, columns=["scene", "pair", "T (gain)", "R detail", "rung", "what", "told"], dtype=object)


def _what_failed(row: Any) -> str:
    if not row.failed:
        return "false alarm"
    named = (("worse than nothing", row.worse), ("far below", row.far), ("reflection", row.lost))
    return ", ".join(name for name, fails in named if fails) + (" (announced)" if row.announced else "")


# Figures: maps are in a scale that stays in order in grey.

_STYLES = {
    AUTO: Style("black", "-", "o", 2.4),
    "pixelwise": Style(BLUE, "--", "s"),
    "ghosts": Style(VERMILION, "-.", "^"),
    "perspective": Style(GREEN, ":", "v"),
    NOTHING: Style("grey", (0, (1, 1)), "+"),
    MINIMUM: Style(ORANGE, (0, (5, 1, 1, 1)), "x"),
    COMPONENTS: Style(PURPLE, (0, (3, 2)), "d"),
}
_OTHERS = (Style(SKY, (0, (6, 2)), "P"), Style("#8c564b", (0, (4, 1, 1, 1, 1, 1)), "*"))
_WORDS = {
    AUTO: "model auto (chosen by the photographs)",
    NOTHING: "plain intensity (nothing done)",
    MINIMUM: "minimum over angles",
    COMPONENTS: "independent components (FastICA)",
}
_MAPPED = {
    "transmission": "transmission (dB)",
    "reflection": "reflection (dB)",
    "gain": "transmission over doing nothing (dB)",
}
_COLUMNS = 4


def figures(frame: DataFrame) -> dict[str, Callable[[], Any]]:
    """Maps over incidence and noise, curves along every other family, and the warnings."""
    judged = judge(frame)
    on_map = where(judged, family=MAP, method=AUTO)
    maps = {} if on_map.empty else {"stability_map": lambda: _maps(on_map)}
    return maps | {
        "stability_transmission": lambda: _curves(judged, "transmission"),
        "stability_reflection": lambda: _curves(judged, "reflection"),
        "stability_warnings": lambda: _warnings(where(judged, method=AUTO)),
    }


def _maps(auto: DataFrame) -> Any:
    """Means over pairs of both layers' PSNR over incidence and noise; where any pair fails, and unannounced."""
    figure = new_figure(13, 4.4)
    for axis, (name, title) in zip(figure.subplots(1, 3, sharey=True), _MAPPED.items(), strict=True):
        values = auto.pivot_table(name, "second", "value")
        for (noise, incidence), part in auto.groupby(["second", "value"]):
            place = values.index.get_loc(noise), values.columns.get_loc(incidence)
            _mark(axis, *place, part, part.lost if name == "reflection" else part.worse | part.far)
        _heatmap(axis, values)
        axis.set_title(title)
        axis.set_xlabel("incidence (deg)")
        if name == "transmission":
            axis.set_ylabel("noise (white = 1)")
    figure.suptitle("auto, mean over pairs; framed: a pair fails in this layer, dashed frame: and was not announced")
    return figure


def _mark(axis: Any, row: int, column: int, part: DataFrame, failed: Any) -> None:
    """A frame around the cell of scenes that fail in the layer shown."""
    from matplotlib.patches import Rectangle

    if failed.any():
        dashes = "-" if part[failed].announced.all() else ":"
        corner = (column - 0.42, row - 0.42)
        axis.add_patch(Rectangle(corner, 0.84, 0.84, fill=False, edgecolor="red", linestyle=dashes, linewidth=2))


def _heatmap(axis: Any, values: DataFrame) -> None:
    image = axis.imshow(values, cmap="cividis", aspect="auto", origin="lower")
    middle = np.nanmean([np.nanmin(values), np.nanmax(values)])
    for (i, j), value in np.ndenumerate(values):
        if math.isfinite(value):
            axis.text(j, i, f"{value:.0f}", ha="center", va="center", color="white" if value < middle else "black")
    axis.set_xticks(range(len(values.columns)), [f"{incidence:g}" for incidence in values.columns])
    axis.set_yticks(range(len(values.index)), [f"{noise:g}" for noise in values.index])
    axis.grid(visible=False)
    axis.figure.colorbar(image, ax=axis, shrink=0.8)


def _curves(judged: DataFrame, layer: str) -> Any:
    """PSNR of a layer along every family, a line per method; crosses where `auto` is worse than doing nothing."""
    families = [family for family in values_of(judged, "family") if family != MAP]
    others = iter(_OTHERS * len(WAYS))
    styles = {name: _STYLES.get(name) or next(others) for name in values_of(judged, "method")}
    rows = max(1, math.ceil(len(families) / _COLUMNS))
    figure = new_figure(4.0 * _COLUMNS, 3.0 * rows + 0.6)
    axes = figure.subplots(rows, _COLUMNS, squeeze=False).ravel()
    handles: dict[str, Any] = {}
    for axis, family in zip(axes, families, strict=False):
        of_family = where(judged, family=family)
        for name, style in styles.items():
            handles[name] = _curve(axis, where(of_family, method=name), layer, style)
        _label(axis, family, of_family)
    for axis in axes[len(families) :]:
        axis.set_visible(False)
    figure.supylabel(f"PSNR of the {layer} (dB), mean over pairs")
    words = [_WORDS.get(name, f"model {name}") for name in handles]
    legend_below(figure, list(handles.values()), words, min(5, len(styles)), handlelength=4)
    if layer == "transmission":
        figure.suptitle("large crosses: auto is worse than the plain intensity by more than 0.1 dB on a pair")
    return figure


def _curve(axis: Any, part: DataFrame, layer: str, style: Style) -> Any:
    by_value = part.groupby("value")
    means = by_value[layer].mean().to_numpy()
    look = {**style.line, "markersize": 4, "zorder": 5 if style.width > 2 else 3}
    (line,) = axis.plot(range(len(means)), means, **look)
    if layer == "transmission" and (part.method == AUTO).any():
        worse = np.flatnonzero(by_value.worse.any())
        axis.plot(worse, means[worse], "x", color="red", markersize=11, markeredgewidth=2.5, zorder=6)
    return line


def _label(axis: Any, family: str, part: DataFrame) -> None:
    """Values evenly spaced, as they were chosen; special cases by their names."""
    labels = {value: case.removeprefix(f"{family}: ") for value, case in sorted(values_of(part, "value", "case"))}
    special = family == SPECIAL
    axis.set_xticks(
        range(len(labels)),
        [label.replace(", ", ",\n") if special else f"{value:g}" for value, label in labels.items()],
        rotation=30 if special else 0,
        ha="right" if special else "center",
        fontsize=8,
    )
    axis.set_title(family, fontsize=10)


def _warnings(auto: DataFrame) -> Any:
    """Per family: separations without failure, failures announced and not, false alarms."""
    families = values_of(auto, "family")
    scores = [score(where(auto, family=family)) for family in families]
    bars = (
        ("no failure, nothing said", [s.n - s.failed - s.false_alarms for s in scores], "#dddddd", ""),
        ("no failure, false alarm", [s.false_alarms for s in scores], ORANGE, "//"),
        ("failure, announced", [s.announced for s in scores], SKY, ".."),
        ("failure, not announced", [s.failed - s.announced for s in scores], "#a01010", "xx"),
    )
    figure = new_figure(9, 0.35 * len(families) + 1.6)
    axis = figure.subplots()
    left = np.zeros(len(families))
    for label, counts, color, hatch in bars:
        axis.barh(families, counts, left=left, label=label, color=color, hatch=hatch, edgecolor="black", linewidth=0.5)
        left += counts
    axis.invert_yaxis()
    axis.set_xlabel("separations by auto")
    figure.legend(loc="outside upper center", ncols=2, frameon=False)
    return figure


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the study."""
    parser = study_parser(__doc__)
    parser.add_argument("--families", default="", help="Only families whose names contain one of these, by commas.")
    parser.add_argument("--methods", help="Names by commas; those that all are measured against come by themselves.")
    options = parser.parse_args(arguments)
    effort = effort_of(options)
    named = options.methods.split(",") if options.methods else (COMPONENTS,) if effort == "quick" else WAYS
    # The map has a third of the scenes, and its figures show what is chosen there.
    on_map = named if options.methods else (COMPONENTS,)
    jobs = [
        Job(scene, pair, options.photos, SIZE, _with_measures(on_map if scene.family == MAP else named))
        for scene in (STABILITY_QUICK if effort == "quick" else STABILITY)
        if any(word in scene.family for word in options.families.split(","))
        for pair in range(n_pairs_of(options, N_PAIRS[effort], SIZE))
    ]
    frame = run_study(NAME, run, jobs, Row, options)
    publish(NAME, options, tables(frame), figures(frame))


def _with_measures(ways: Sequence[str]) -> tuple[str, ...]:
    """Ways with those that all are measured against."""
    return tuple(dict.fromkeys((AUTO, *ways, NOTHING, MINIMUM)))


if __name__ == "__main__":
    main()
