"""What the learned start is worth: starts alone, where their solves stop, and the minima that they lead to.

Run ``polaropt study learned_init --photos DIR -o OUT`` (``--quick`` for a look). Without photographs it takes those
inside scikit-image, and leaves the learned start out where its networks were trained on them. Every scene is found
blind, once for all starts; its seconds count for all of them alike. It is solved from every start by the default rule,
and on to the minimum, with what every evaluation gave.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pandas import DataFrame, Series
from threadpoolctl import threadpool_limits

from polaropt.capture import NoiseModel, measured_noise
from polaropt.estimation import find_scene
from polaropt.optics import SceneParameters
from polaropt.progress import Stages
from polaropt.solving import Problem, Settings, Solution, Weights, solve, take_start
from solvers.base import StoppingRule
from solvers.registry import get_solver
from studies.camera import Sample, SceneJob, take
from studies.kit.charts import BLUE, GREEN, VERMILION, Fill, Style, legend_below, new_figure
from studies.kit.frames import joined, markdown, mean, summary, values_of, where
from studies.kit.run import effort_of, publish, run_study, study_parser
from studies.kit.timing import Clock
from studies.photographs import Pair, n_pairs_of, pairs_of
from studies.scenes import INCIDENCES_DEG, MAP, START_NOISES, Scene
from studies.scenes import starts as scenes
from studies.scores import GAP, LAYERS, NEAR_DB, both_psnr
from studies.ways import CLOSED_FORM_START as CLOSED_FORM
from studies.ways import COLD, DEFAULT, LEARNED, judged_starts, starts, weights_digest

Images = NDArray[np.float32]

NAME = "learned_init"
SIZES = {"quick": 128, "default": 192, "full": 256}
N_PAIRS = {"quick": 1, "default": 3, "full": 4}
MOST_EVALUATIONS = {"quick": 60, "default": 120, "full": 150}
"""Of a solve to the minimum."""
CONVERGED_CHANGE = 1e-6
"""Relative change at which a solve is at its minimum."""
PATH = 24
"""Evaluations whose transmission is written down."""
MOMENTS = ("start", "stopped", "converged")
PLACES = ("stopped", "gap", "near")
"""Until the default end, the gap, and near the final transmission."""
FRONTAL_DEG = 25.0
"""Up to here the layers' detail can hardly be told apart."""
KEPT_DB = 0.1
"""A solve may end so far below its start."""
SAME_DB, CLEAR_DB = 0.05, 0.1
"""Solves that stop so near to each other are as good; beyond the second one is better."""


@dataclass(frozen=True)
class Job(SceneJob):
    """One scene, to be solved from every start."""

    most_evaluations: int = MOST_EVALUATIONS["default"]


@dataclass(frozen=True)
class Row:
    """One start on one scene. PSNR in dB over the pixels that no photograph clips.

    Attributes
    ----------
    family, case, incidence_deg, noise, pair
        The scene, see `studies.scenes.starts`.
    start : str
    rung : str
        Of the scene model that was taken.
    transmission_start, reflection_start : float
        Of the start alone.
    transmission_stopped, reflection_stopped : float
        Where `separate` ends by its default rule.
    transmission_converged, reflection_converged : float
        At the minimum that the start leads to (relative change 1e-6).
    misfit_start, misfit_stopped : float
        Over that of the noise.
    status : str
        Why the default solve ended.
    gap : float
        How far the minimum lies above the lowest of all starts, in parts of the way there from the cold start.
    short_db : float
        How far its transmission lies below that at the lowest.
    evaluations_stopped, evaluations_gap, evaluations_near : float
        Until the default end, the gap of the benchmark and the final transmission less 0.1 dB; NaN where never.
    cpu_scene, cpu_start : float
        CPU seconds of the blind estimate, and of all that a start needs before the first evaluation, networks included.
    cpu_stopped, cpu_gap, cpu_near, seconds_stopped, seconds_gap, seconds_near : float
        CPU and elapsed seconds until there, scene and start included.
    path : tuple of float
        Transmission after each of the first evaluations.
    """

    family: str
    case: str
    incidence_deg: float
    noise: float
    pair: int
    start: str
    rung: str
    transmission_start: float
    reflection_start: float
    transmission_stopped: float
    reflection_stopped: float
    transmission_converged: float
    reflection_converged: float
    misfit_start: float
    misfit_stopped: float
    status: str
    gap: float
    short_db: float
    evaluations_stopped: float
    evaluations_gap: float
    evaluations_near: float
    cpu_scene: float
    cpu_start: float
    cpu_stopped: float
    cpu_gap: float
    cpu_near: float
    seconds_stopped: float
    seconds_gap: float
    seconds_near: float
    path: tuple[float, ...]


# Solves.


@dataclass(frozen=True)
class Point:
    """An evaluation: value, misfit over that of the noise, PSNR of both layers, elapsed and CPU seconds."""

    value: float
    misfit: float
    transmission: float
    reflection: float
    seconds: tuple[float, float]


@dataclass
class _Course:
    """A solve to the minimum: seconds before its first evaluation, and a point for each one."""

    before: tuple[float, float] = (0.0, 0.0)
    points: list[Point] = field(default_factory=list)

    @property
    def end(self) -> Point:
        return min(self.points, key=lambda point: point.value)


@dataclass(frozen=True)
class _Estimate:
    """A sample with the scene that was found blind, its noise, and the seconds that took."""

    sample: Sample
    scene: SceneParameters
    noise: float
    growth: NoiseModel
    seconds: tuple[float, float]

    def psnr(self, layers: Images) -> tuple[float, float]:
        """Of both layers on the frame."""
        return both_psnr(layers, self.sample.layers, self.sample.unclipped)


def run(job: Job) -> list[Row]:
    """Solve one scene from every start."""
    _warm_up(job.photos, job.size)
    return rows_of(job.scene, job.photographs, job.most_evaluations, judged_starts(job.photos))


@lru_cache(maxsize=1)
def _warm_up(photos: str | None, size: int) -> None:
    """Load weights and compiled kernels, once in a process and off the clock; the networks keep to one core.

    Where cores are shared torch's threads wait actively, and their CPU seconds would tell of that alone.
    """
    if LEARNED in starts():
        import torch

        torch.set_num_threads(1)
    rows_of(scenes()[0], pairs_of(photos, size, size // 2)[0], most_evaluations=4)


def rows_of(scene: Scene, pair: Pair, most_evaluations: int, names: Sequence[str] | None = None) -> list[Row]:
    """Solve one scene from every start; no rows where the photographs show no polarized light.

    Parameters
    ----------
    scene : Scene
    pair : Pair
    most_evaluations : int
        Of a solve to the minimum.
    names : sequence of str, optional
        Of the starts. Default: all that are installed.
    """
    with threadpool_limits(1, "blas"):
        estimate = _estimate(take(scene, pair))
        if not estimate.scene.signal:
            return []
        courses = {start: _course(estimate, start, most_evaluations) for start in names or starts()}
        lowest = min((course.end for course in courses.values()), key=lambda point: point.value)
        way = courses[COLD].points[0].value - lowest.value
        return [
            _row(scene, pair, start, estimate, _Comparison(course, lowest, way)) for start, course in courses.items()
        ]


def _estimate(sample: Sample) -> _Estimate:
    clock = Clock()
    noise, growth = measured_noise(sample.capture)
    scene = find_scene(sample.capture, sample.hint, noise).scene
    return _Estimate(sample, scene, noise, growth, clock.read())


def _course(estimate: _Estimate, start: str, most_evaluations: int) -> _Course:
    course, clock = _Course(), Clock()
    problem = Problem(estimate.sample.capture, estimate.scene, estimate.noise, Weights(), growth=estimate.growth)
    layers = take_start(problem, start)
    objective = problem.compiled(layers)
    z = objective.coordinates(layers)
    course.before = clock.read()

    def evaluate(z: Any) -> tuple[float, Any]:
        value, gradient = objective.value_and_grad(z)
        seconds = clock.read()
        with clock.paused():
            # Looking at the layers overwrites the gradient's buffer.
            gradient = gradient.copy()
            there, terms = objective.solution(z)
            quality = estimate.psnr(problem.canvas.crop(there))
            misfit = terms["misfit"].value / problem.misfit_of_noise
            course.points.append(Point(value, misfit, *quality, seconds))
        return value, gradient

    stopping = StoppingRule(max_evaluations=most_evaluations, relative_change=CONVERGED_CHANGE)
    get_solver(DEFAULT.solver).minimize(evaluate, z, stopping)
    return course


@dataclass(frozen=True)
class _Comparison:
    """A course against the lowest point of all, and the way there from the cold start."""

    course: _Course
    lowest: Point
    way: float

    def gap(self, point: Point) -> float:
        return (point.value - self.lowest.value) / max(self.way, 1e-12)

    def arrival(self, *, gap: bool) -> int | None:
        """First evaluation within the gap, or near the final transmission."""
        least = self.lowest.transmission - NEAR_DB
        for i, point in enumerate(self.course.points):
            if self.gap(point) <= GAP if gap else point.transmission >= least:
                return i
        return None


def _row(scene: Scene, pair: Pair, start: str, estimate: _Estimate, comparison: _Comparison) -> Row:
    stopped, stopped_seconds = _stopped(estimate, start)
    course = comparison.course
    first, end = course.points[0], course.end
    enough = 0.5 * float(estimate.sample.capture.valid.sum())
    at = {name: comparison.arrival(gap=name == "gap") for name in ("gap", "near")}
    counts = {f"evaluations_{name}": math.nan if i is None else float(i + 1) for name, i in at.items()}
    times = {name: None if i is None else course.points[i].seconds for name, i in at.items()}
    return Row(
        scene.family, scene.name, scene.pane.incidence_deg, scene.taking.noise, pair.number, start,
        estimate.scene.rung,
        first.transmission, first.reflection, *estimate.psnr(stopped.layers), end.transmission, end.reflection,
        misfit_start=first.misfit,
        misfit_stopped=stopped.terms["misfit"].value / enough,
        status=stopped.solver.status.name,
        gap=comparison.gap(end),
        short_db=comparison.lowest.transmission - end.transmission,
        evaluations_stopped=float(stopped.solver.n_evaluations),
        **counts,
        cpu_scene=estimate.seconds[1],
        cpu_start=course.before[1],
        **_clocks(estimate.seconds, {"stopped": stopped_seconds, **times}),
        path=tuple(point.transmission for point in course.points[:PATH]),
    )  # fmt: skip


def _clocks(before: tuple[float, float], times: dict[str, tuple[float, float] | None]) -> dict[str, float]:
    """Columns of elapsed and CPU seconds since the photographs were there."""
    return {
        f"{clock}_{name}": math.nan if seconds is None else before[i] + seconds[i]
        for i, clock in enumerate(("seconds", "cpu"))
        for name, seconds in times.items()
    }


def _stopped(estimate: _Estimate, start: str) -> tuple[Solution, tuple[float, float]]:
    """What `separate` does once the scene is found, and its seconds."""
    settings, clock = Settings(init=start), Clock()
    solution = solve(
        estimate.sample.capture, estimate.scene, estimate.noise, settings, Stages(), growth=estimate.growth
    )
    return solution, clock.read()


# Tables.


def regime(family: str, incidence_deg: float, noise: float) -> str:
    """What the conclusions are drawn for: a special case, or a part of the map."""
    if family != MAP:
        return family
    side = f"incidence <= {FRONTAL_DEG:g} deg" if incidence_deg <= FRONTAL_DEG else f"beyond {FRONTAL_DEG:g} deg"
    return f"{side}, noise {noise:g}"


def with_regimes(frame: DataFrame) -> DataFrame:
    """The rows with their regime, and whether another start ends lower or with a better transmission."""
    return frame.assign(
        regime=list(map(regime, frame.family, frame.incidence_deg, frame.noise)),
        worse_minimum=frame.gap > GAP,
        worse_transmission=frame.short_db > NEAR_DB,
    )


@dataclass(frozen=True)
class Comparison:
    """A start against the closed form on the same scenes.

    Attributes
    ----------
    n : int
        Scenes.
    alone, stopped : (float, float)
        What transmission and reflection gain, in dB: at the start, and where the solves stop.
    seconds_near, seconds_gap : float
        Its CPU seconds over those of the closed form, until near the final transmission and until the gap.
    """

    n: int
    alone: tuple[float, float]
    stopped: tuple[float, float]
    seconds_near: float
    seconds_gap: float

    @property
    def verdict(self) -> str:
        """Whether its solves stop better, in words."""
        least, most = min(self.stopped), max(self.stopped)
        if least > -SAME_DB and most > CLEAR_DB:
            return "better"
        if most < SAME_DB and least < -CLEAR_DB:
            return "worse"
        return "as good" if max(abs(least), abs(most)) <= CLEAR_DB else "better in one layer, worse in the other"


def means(frame: DataFrame, start: str) -> Series:
    """Of a start's columns, over the rows that have a value."""
    return where(frame, start=start).mean(numeric_only=True)


def compare(frame: DataFrame, start: str) -> Comparison:
    """A start against the closed form; both must have a row on every scene."""
    ours, theirs = means(frame, start), means(frame, CLOSED_FORM)
    gains = ours - theirs
    alone, stopped = (
        (float(gains[f"transmission_{moment}"]), float(gains[f"reflection_{moment}"])) for moment in MOMENTS[:2]
    )
    ratios = [float(ours[name] / theirs[name]) for name in ("cpu_near", "cpu_gap")]
    return Comparison(len(where(frame, start=start)), alone, stopped, ratios[0], ratios[1])


def kept(frame: DataFrame, start: str) -> list[tuple[float, float, float]]:
    """Per incidence what the default solve changes on the start: incidence, transmission and reflection in dB."""
    by_incidence = where(frame, start=start).groupby("incidence_deg").mean(numeric_only=True)
    changes = [by_incidence[f"{layer}_stopped"] - by_incidence[f"{layer}_start"] for layer in LAYERS]
    return list(zip(by_incidence.index.tolist(), *(change.tolist() for change in changes), strict=True))


def of_protocol(frame: DataFrame) -> DataFrame:
    """The rows of the paper's incidences with little noise."""
    on_map = where(frame, family=MAP, noise=START_NOISES[0])
    return on_map[on_map.incidence_deg.isin(INCIDENCES_DEG)]


def tables(frame: DataFrame, weights: str) -> str:
    """Conclusions, then the tables that they are drawn from; `weights` is the digest of the learned start's."""
    names = values_of(frame, "start")
    frame = with_regimes(frame)
    lines = [
        "# What a start is worth",
        "",
        f"{len(where(frame, start=CLOSED_FORM))} scenes, each found blind once for all starts; weights {weights}. "
        "Seconds are CPU seconds of all cores, from the photographs on: scene, closed form, networks (on one core), "
        "solve.",
        "",
    ]
    if LEARNED in names:
        lines += [f"- {sentence}" for sentence in conclusions(frame, LEARNED)] + [""]
    return "\n".join([*lines, _regime_table(frame, names), "", _work_table(frame), "", _quality_table(frame, names)])


def conclusions(frame: DataFrame, start: str) -> list[str]:
    """What the rows say of a start, whatever that is."""
    frame = with_regimes(frame)
    on_protocol = of_protocol(frame)
    return [
        _alone(on_protocol, start),
        _not_thrown_away(on_protocol, start),
        _where_solves_stop(on_protocol, start),
        _in_time(on_protocol, start),
        _minima(frame, start),
        _by_regime(frame, start),
    ]


def _alone(frame: DataFrame, start: str) -> str:
    parts = [compare(part, start).alone for _, part in frame.groupby("incidence_deg")]
    least = [min(part[i] for part in parts) for i in (0, 1)]
    average = [float(np.mean([part[i] for part in parts])) for i in (0, 1)]
    return (
        f"Alone, the {start} start is at {average[0]:+.2f} dB (transmission) and {average[1]:+.2f} dB (reflection) "
        f"against the closed form on the paper's incidences; at the least favourable one "
        f"{least[0]:+.2f} and {least[1]:+.2f} dB."
    )


def _not_thrown_away(frame: DataFrame, start: str) -> str:
    worst = min(kept(frame, start), key=lambda change: min(change[1:]))
    holds = min(worst[1:]) >= -KEPT_DB
    return (
        f"The default solve {'keeps' if holds else 'DOES NOT keep'} it: at the worst incidence "
        f"({worst[0]:g} deg) it changes transmission and reflection by {worst[1]:+.2f} and {worst[2]:+.2f} dB."
    )


def _where_solves_stop(frame: DataFrame, start: str) -> str:
    gain, own = compare(frame, start).stopped, means(frame, start)
    beyond = [own[f"{layer}_converged"] - own[f"{layer}_stopped"] for layer in LAYERS]
    return (
        f"Where the solves stop, it is at {gain[0]:+.2f} dB (transmission) and {gain[1]:+.2f} dB (reflection) "
        f"against the solve from the closed form, mean over the paper's incidences. Going on to the minimum would "
        f"change that by {beyond[0]:+.2f} and {beyond[1]:+.2f} dB."
    )


def _in_time(frame: DataFrame, start: str) -> str:
    comparison = compare(frame, start)
    return (
        f"Until within {NEAR_DB:g} dB of the final transmission it takes {comparison.seconds_near:.2f} times the "
        f"closed form's CPU seconds, until the gap of {GAP:g} {comparison.seconds_gap:.2f} times (mean over the "
        "paper's angles)."
    )


def _minima(frame: DataFrame, start: str) -> str:
    ours, theirs = where(frame, start=start), where(frame, start=CLOSED_FORM)
    return (
        f"Its minimum lies more than {GAP:g} higher than another start's on {ours.worse_minimum.sum()} of {len(ours)} "
        f"scenes (closed form: {theirs.worse_minimum.sum()}), its transmission there more than {NEAR_DB:g} dB lower on "
        f"{ours.worse_transmission.sum()} (closed form: {theirs.worse_transmission.sum()})."
    )


def _by_regime(frame: DataFrame, start: str) -> str:
    comparisons = {str(name): compare(part, start) for name, part in frame.groupby("regime", sort=False)}
    groups = []
    for verdict in dict.fromkeys(comparison.verdict for comparison in comparisons.values()):
        names = [name for name, comparison in comparisons.items() if comparison.verdict == verdict]
        groups.append(f"{verdict}: {'; '.join(names)}")
    faster = [name for name, comparison in comparisons.items() if comparison.seconds_near < 1]
    return (
        f"Against the solve from the closed form it stops {'. '.join(groups)}. It is near the final transmission in "
        f"fewer seconds in {len(faster)} of {len(comparisons)} regimes{': ' if faster else ''}{'; '.join(faster)}."
    )


def _regime_table(frame: DataFrame, names: Sequence[str]) -> str:
    lines = []
    for name, part in frame.groupby("regime", sort=False):
        for start in names:
            if start == CLOSED_FORM:
                continue
            found = compare(part, start)
            gains = (f"{of_t:+.2f} / {of_r:+.2f}" for of_t, of_r in (found.alone, found.stopped))
            ratios = (f"{ratio:.2f}" for ratio in (found.seconds_near, found.seconds_gap))
            lines.append((name, start, found.n, *gains, *ratios, found.verdict))
    headings = ("regime", "start", "scenes", "alone", "stopped", f"seconds to {NEAR_DB:g} dB", "seconds to the gap",
                "it stops")  # fmt: skip
    return (
        "Against the closed form (transmission / reflection in dB; ratios of CPU seconds):\n\n"
        + markdown(DataFrame(lines, columns=headings), "llrrrrrl")
    )  # fmt: skip


def _work_table(frame: DataFrame) -> str:
    cells = {
        "evaluations": joined(*(mean(f"evaluations_{place}", ".1f") for place in PLACES)),
        "seconds": joined(*(mean(f"cpu_{place}") for place in PLACES)),
        "scene": mean("cpu_scene"),
        "start": mean("cpu_start"),
        "worse minima": lambda part: f"{part.worse_minimum.sum()} of {len(part)}",
        "worse transmission": lambda part: f"{part.worse_transmission.sum()} of {len(part)}",
    }
    table = summary(frame, {"regime": "regime", "start": "start"}, cells)
    return (
        "Work (means; evaluations until the default end, the gap, and near the final transmission; CPU seconds, of "
        "which scene and start; minima worse in the objective and in transmission):\n\n" + markdown(table, "llr")
    )


def _quality_table(frame: DataFrame, names: Sequence[str]) -> str:
    """Start, stopped and converged side by side, per scene."""

    def cell(start: str, moment: str) -> Callable[[DataFrame], str]:
        both = joined(*(mean(f"{layer}_{moment}") for layer in LAYERS))
        return lambda part: both(where(part, start=start))

    cells = {f"{start}: {moment}": cell(start, moment) for start in names for moment in MOMENTS}
    return (
        "Transmission / reflection in dB, mean over pairs: the start, where its solve stops, its minimum.\n\n"
        + markdown(summary(frame, {"scene": "case"}, cells), "lr")
    )


# Figures.

_COLORS = {CLOSED_FORM: BLUE, LEARNED: "black", COLD: VERMILION}
_MARKERS = {CLOSED_FORM: "s", LEARNED: "o", COLD: "^"}
_FILLS = {CLOSED_FORM: Fill("#9ecae1", "///"), LEARNED: Fill("#555555", ""), COLD: Fill("#f5d0b5", "...")}
_OTHER_FILL = Fill("#b7e0d0", "xx")
_DASHES: dict[str, Any] = {"start": (0, (1, 1.5)), "stopped": "-", "converged": (0, (5, 2))}
_LOWEST_DB = -3.0
_PATHS = 3
_WORK = {
    "cpu_near": "CPU seconds to 0.1 dB",
    "cpu_gap": "CPU seconds to the gap",
    "evaluations_near": "evaluations to 0.1 dB",
    "evaluations_gap": "evaluations to the gap",
}


def figures(frame: DataFrame) -> dict[str, Callable[[], Any]]:
    """Quality over incidence, work per regime, and the way to the minimum."""
    makers = {"quality": _quality, "work": _work, "paths": _paths}
    return {f"{NAME}_{name}": partial(make, with_regimes(frame)) for name, make in makers.items()}


def _style(start: str, moment: str = "stopped") -> Style:
    return Style(_COLORS.get(start, GREEN), _DASHES[moment], _MARKERS.get(start, "D"), 2 if start == LEARNED else 1.3)


def _quality(frame: DataFrame) -> Any:
    """Start, stopped and converged over incidence, as differences to the solve from the closed form."""
    noises = [noise for noise in START_NOISES if len(where(frame, family=MAP, noise=noise))]
    figure = new_figure(1.5 + 5.2 * len(noises), 7.2)
    axes = figure.subplots(2, len(noises), squeeze=False, sharex=True)
    handles: dict[str, Any] = {}
    for column, noise in enumerate(noises):
        for row, layer in enumerate(LAYERS):
            axis = axes[row][column]
            handles |= _differences(axis, where(frame, family=MAP, noise=noise), layer)
            axis.set_ylim(bottom=max(_LOWEST_DB, axis.get_ylim()[0]))
            axis.set_ylabel(f"{layer} (dB)" if column == 0 else "")
        axes[0][column].set_title(f"noise {noise:g}")
        axes[1][column].set_xlabel("incidence (deg)")
    figure.suptitle("PSNR against the solve from the closed form by the default rule, mean over pairs")
    legend_below(figure, list(handles.values()), list(handles), 3, handlelength=4)
    return figure


def _differences(axis: Any, frame: DataFrame, layer: str) -> dict[str, Any]:
    levels = frame.groupby(["start", "incidence_deg"]).mean(numeric_only=True)
    base = levels.loc[CLOSED_FORM, f"{layer}_stopped"]
    handles = {}
    for start in values_of(frame, "start"):
        # The plain intensity is far below all others.
        for moment in MOMENTS[1:] if start == COLD else MOMENTS:
            style = _style(start, moment)
            gains = levels.loc[start, f"{layer}_{moment}"] - base
            (handles[f"{start}: {moment}"],) = axis.plot(
                gains.index, gains, markersize=9 if moment == "start" else 5,
                markerfacecolor="none" if moment == "start" else style.color, **style.line,
            )  # fmt: skip
    return handles


def _work(frame: DataFrame) -> Any:
    """CPU seconds and evaluations until near the final transmission and until the gap, per regime."""
    regimes, names = values_of(frame, "regime"), values_of(frame, "start")
    figure = new_figure(13, 0.5 * len(regimes) + 1.8)
    axes = figure.subplots(1, len(_WORK), sharey=True)
    height = 0.8 / len(names)
    levels = frame.groupby(["start", "regime"])[list(_WORK)].mean()
    for axis, (column, title) in zip(axes, _WORK.items(), strict=True):
        for i, start in enumerate(names):
            axis.barh(
                np.arange(len(regimes)) + height * (i - (len(names) - 1) / 2),
                np.nan_to_num(levels.loc[start, column].reindex(regimes)), height, label=start,
                **_FILLS.get(start, _OTHER_FILL).bar,
            )  # fmt: skip
        axis.set_title(title, fontsize=9)
    axes[0].set_yticks(range(len(regimes)), regimes)
    axes[0].invert_yaxis()
    legend_below(figure, *axes[0].get_legend_handles_labels(), len(names))
    return figure


def _paths(frame: DataFrame) -> Any:
    """Transmission after each evaluation on the way to the minimum, for some incidences of the first pair."""
    part = where(frame, family=MAP, noise=START_NOISES[0], pair=frame.pair.iloc[0])
    incidences = sorted(values_of(part, "incidence_deg"))
    chosen = [incidences[i] for i in np.unique(np.linspace(0, len(incidences) - 1, _PATHS).astype(int))]
    figure = new_figure(4.3 * len(chosen), 3.8)
    handles: dict[str, Any] = {}
    for axis, incidence in zip(figure.subplots(1, len(chosen), squeeze=False)[0], chosen, strict=True):
        there = where(part, incidence_deg=incidence)
        for start, path in zip(there.start, there.path, strict=True):
            style = _style(start)
            (handles[start],) = axis.plot(
                range(1, len(path) + 1), path, color=style.color, marker=style.marker, markersize=4, linewidth=1.3
            )
        axis.set_ylim(there.transmission_converged.min() - 6, max(map(max, there.path)) + 0.5)
        axis.set_title(f"{incidence:g} deg")
        axis.set_xlabel("evaluations")
    figure.supylabel("transmission (dB)")
    legend_below(figure, list(handles.values()), list(handles), len(handles))
    return figure


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the study."""
    parser = study_parser(__doc__)
    parser.add_argument("--size", type=int, help="Side of the frame in pixels.")
    options = parser.parse_args(arguments)
    effort = effort_of(options)
    size = options.size or SIZES[effort]
    jobs = [
        Job(scene, pair, options.photos, size, MOST_EVALUATIONS[effort])
        for scene in scenes(quick=effort == "quick")
        for pair in range(n_pairs_of(options, N_PAIRS[effort], size))
    ]
    weights = weights_digest()
    frame = run_study(NAME, run, jobs, Row, options, {"weights": weights, "starts": judged_starts(options.photos)})
    publish(NAME, options, tables(frame, weights), figures(frame), dpi=110)


if __name__ == "__main__":
    main()
