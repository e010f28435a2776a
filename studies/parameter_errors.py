"""How often the true numbers of a scene lie within two of the standard errors that are stated with them.

Run ``polaropt study parameter_errors -o OUT``; without ``--photos`` it uses photographs inside scikit-image.
Scenes of six kinds: bounces in place, ghosts, a wide lens, a bent pane before it, and ghosts before a polarized screen
or sky; incidence, azimuth, thickness, view, bend and polarization are random, seeded by pair and round.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pandas import DataFrame, concat

from polaropt.capture import noise_level
from polaropt.estimation import find_scene
from polaropt.numerics import turn_between
from polaropt.optics import SceneErrors, SceneParameters
from studies.camera import photograph
from studies.kit.charts import BLUE, new_figure
from studies.kit.frames import markdown, median, summary
from studies.kit.run import effort_of, publish, run_study, study_parser
from studies.photographs import N_PAIRS, n_pairs_of, pairs_of
from studies.scenes import BLIND, POLARIZED_KINDS, RANDOM_KINDS, random_scene

NAME = "parameter_errors"
SURE = 2.0
"""Standard errors within which the truth should lie."""
NORMAL_MEDIAN = 0.674
"""Of absolute normal errors, in standard deviations."""
WANTED = (90.0, 99.0)
"""Per cent of the truths that should lie there."""
SIZE, MARGIN = 192, 128
TURNS = {"quick": 1, "default": 2, "full": 4}


@dataclass(frozen=True)
class Job:
    """One scene of one kind."""

    photos: str | None
    kind: str
    pair: int
    turn: int


@dataclass(frozen=True)
class Row:
    """One number of one scene: its true value, what was found and the standard error stated with it."""

    kind: str
    pair: int
    turn: int
    incidence_deg: float
    parameter: str
    true: float
    found: float
    error: float


def run(job: Job) -> list[Row]:
    """Every number that is estimated with an error, of one scene on the rung of its kind."""
    pair = pairs_of(job.photos, SIZE, MARGIN)[job.pair]
    random = np.random.default_rng([job.pair, job.turn, RANDOM_KINDS.index(job.kind)])
    scene = random_scene(job.kind, SIZE, random)
    capture = photograph(pair, scene).capture
    rung = "polarized" if job.kind in POLARIZED_KINDS else job.kind
    found = find_scene(capture, BLIND, noise_level(capture), rung)
    of_job = (job.kind, job.pair, job.turn, scene.values()[0])
    return [Row(*of_job, *number) for number in compared(scene, found.scene, found.errors)]


def compared(
    scene: SceneParameters, estimate: SceneParameters, errors: SceneErrors
) -> Iterator[tuple[str, float, float, float]]:
    """Name, truth, estimate and its error of each number; both azimuths that name the same pane are right."""
    incidence, azimuth, shift = scene.values()
    found_incidence, found_azimuth, found_shift = estimate.values()
    period = 360.0 if scene.focal_px is not None and estimate.varies else 180.0
    turned = turn_between(found_azimuth, azimuth, period)
    sense = 1 if abs(turn_between(found_azimuth, azimuth, 360.0)) < 90 else -1
    numbers = [
        ("incidence_deg", incidence, found_incidence, errors.incidence_deg),
        ("azimuth_deg", azimuth, azimuth + turned, errors.azimuth_deg),
        ("ghost_shift", sense * shift, found_shift, errors.ghost_shift),
        ("gap_shift", sense * (scene.gap_shift or 0.0), estimate.gap_shift or 0.0, errors.gap_shift),
        ("focal_px", scene.focal_px or math.nan, estimate.focal_px or math.nan, errors.focal_px),
    ]
    if errors.bend_deg_per_px is not None:
        # Seen from afar a pane looks like the one that leans the other way and is bent so, too.
        side = sense if period < 360 else 1
        bends = zip(scene.bend_deg_per_px, estimate.bend_deg_per_px, errors.bend_deg_per_px, strict=True)
        numbers += [("bend_deg_per_px", side * true, value, error) for true, value, error in bends]
    numbers += _of_light(scene, estimate, errors)
    yield from ((name, true, value, error) for name, true, value, error in numbers if error is not None)


def _of_light(
    scene: SceneParameters, estimate: SceneParameters, errors: SceneErrors
) -> Iterator[tuple[str, float, float, float]]:
    """The same of degree and angle of each layer's light; no angle is true of unpolarized light."""
    for name in POLARIZED_KINDS.values():
        (degree, angle), found, stated = (getattr(part, name) for part in (scene, estimate, errors))
        if stated is not None:
            yield f"{name}, degree", degree, found[0], stated[0]
            if degree:
                yield f"{name}, angle", angle, angle + turn_between(found[1], angle), stated[1]


def judged(frame: DataFrame) -> DataFrame:
    """The rows with `away`, how far the estimate lies from the truth, and whether that is within two errors."""
    away = (frame.found - frame.true).abs()
    return frame.assign(away=away, covered=away <= SURE * frame.error)


def tables(frame: DataFrame) -> str:
    """Shares covered and typical errors per kind and parameter, and over all kinds."""
    cells = {
        "n": lambda part: str(len(part)),
        "within two errors": lambda part: f"{100 * part.covered.mean():.0f} %",
        "stated error, median": median("error", ".3g"),
        "true error, median": median("away", ".3g"),
    }
    rows = judged(frame)
    both = concat([rows, rows.assign(kind="all")])
    return markdown(summary(both, {"scenes": "kind", "parameter": "parameter"}, cells))


_RATIOS = (0.3, 1.0, 3.0, 10.0)


def figures(frame: DataFrame) -> dict[str, Callable[[], Any]]:
    """How often the stated errors hold the truth, and how large they are beside the true ones."""
    return {NAME: lambda: _shares(judged(frame))}


def _shares(frame: DataFrame) -> Any:
    """One row per kind and number: the share, with the interval that so few scenes leave, and the ratio of errors."""
    groups = dict(list(frame.groupby(["kind", "parameter"], sort=False)))
    figure = new_figure(9, 0.27 * len(groups) + 1.4)
    shares, ratios = figure.subplots(1, 2, sharey=True)
    places = np.arange(len(groups))
    shares.axvspan(*WANTED, color="#cccccc", label="{:.0f} to {:.0f} %".format(*WANTED))
    held = np.array([100 * part.covered.mean() for part in groups.values()])
    beside = np.abs(np.transpose([_interval(part.covered) for part in groups.values()]) - held)
    shares.errorbar(held, places, xerr=beside, fmt="o", color="black", capsize=3, label="share, and 95 % interval")
    shares.set_xlabel("truths within two stated errors (%)")
    shares.set_yticks(places, [f"{kind}: {name} ({len(part)})" for (kind, name), part in groups.items()])
    shares.invert_yaxis()
    figure.legend(loc="outside lower center", ncols=2, frameon=False)
    ratios.plot([_ratio(part) for part in groups.values()], places, "D", color=BLUE)
    ratios.axvline(1, color="black", linewidth=0.8)
    ratios.set_xscale("log")
    ratios.set_xticks(_RATIOS, [f"{ratio:g}" for ratio in _RATIOS])
    ratios.minorticks_off()
    ratios.set_xlabel("stated over true error, medians\n(right of 1: stated too large)")
    return figure


def _interval(held: Any) -> tuple[float, float]:
    """Where the share may truly lie, in per cent (Clopper and Pearson)."""
    from scipy.stats import binomtest

    low, high = binomtest(int(held.sum()), len(held)).proportion_ci(0.95)
    return 100 * low, 100 * high


def _ratio(part: DataFrame) -> float:
    return NORMAL_MEDIAN * float(part.error.median()) / max(float(part.away.median()), 1e-12)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the study."""
    parser = study_parser(__doc__)
    parser.add_argument("--kinds", default=",".join(RANDOM_KINDS), help="Names, comma separated.")
    options = parser.parse_args(arguments)
    effort = effort_of(options)
    jobs = [
        Job(options.photos, kind, pair, turn)
        for kind in options.kinds.split(",")
        for pair in range(n_pairs_of(options, 2 if effort == "quick" else N_PAIRS, SIZE, MARGIN))
        for turn in range(TURNS[effort])
    ]
    frame = run_study(NAME, run, jobs, Row, options)
    publish(NAME, options, tables(frame), figures(frame))


if __name__ == "__main__":
    main()
