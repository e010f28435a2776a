"""What several captures through one pane tell of it together: errors of incidence, azimuth and ghost shift.

Run ``polaropt study shared_scene -o OUT``; without ``--photos`` it uses photographs inside scikit-image. Each capture
shows another pair of photographs, or the same one with other noise, behind the same pane.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pandas import DataFrame

from polaropt.batch import Estimate, combine_scenes
from polaropt.optics import SceneErrors, SceneParameters
from polaropt.separation import estimate
from polaropt.simulation import simulate
from studies.kit.charts import BLUE, new_figure
from studies.kit.frames import markdown, summary
from studies.kit.run import effort_of, publish, run_study, study_parser
from studies.photographs import N_PAIRS, n_pairs_of, pairs_of

NAME = "shared_scene"
SIZE, MARGIN = 192, 32
NOISE = 0.005
INCIDENCES = {"quick": (60.0,), "default": (50.0, 65.0), "full": (40.0, 50.0, 60.0, 70.0)}
TURNS = {"quick": 2, "default": 4, "full": 8}
"""Captures of each pair, cut at other places."""
NUMBERS = (1, 2, 4, 8, 16)
"""Captures that tell a scene together."""
_FIELDS = ("incidence_deg", "azimuth_deg", "ghost_shift")
_AZIMUTH, _SHIFT = 25.0, 4.0
# Groups that are drawn of each number, so that all captures count about equally.
_DRAWS = 40


@dataclass(frozen=True)
class Job:
    """One capture behind the pane of one incidence."""

    photos: str | None
    incidence: float
    pair: int
    turn: int


@dataclass(frozen=True)
class Row:
    """What one capture tells, with its standard errors."""

    incidence: float
    pair: int
    turn: int
    incidence_deg: float
    incidence_deg_error: float
    azimuth_deg: float
    azimuth_deg_error: float
    ghost_shift: float
    ghost_shift_error: float


def run(job: Job) -> list[Row]:
    """Estimate the scene of one capture, blind."""
    pair = pairs_of(job.photos, SIZE, MARGIN)[job.pair]
    random = np.random.default_rng([job.pair, job.turn])
    # The same pane before other parts of the photographs.
    turned = [np.rot90(image, job.turn % 4).copy() for image in (pair.transmission, pair.reflection)]
    if job.turn >= 4:
        turned.reverse()
    pane = SceneParameters(job.incidence, _AZIMUTH, _SHIFT)
    found = estimate(simulate(*turned, pane, noise=NOISE, seed=int(random.integers(2**31))))
    if not found.scene.signal:
        return []
    errors = found.errors
    told = [
        math.nan if value is None else value for value in (errors.incidence_deg, errors.azimuth_deg, errors.ghost_shift)
    ]
    values = found.scene.values()
    numbers = [number for both in zip(values, told, strict=True) for number in both]
    return [Row(job.incidence, job.pair, job.turn, *numbers)]


@dataclass(frozen=True)
class Told:
    """One number as a group of captures tells it, against the truth."""

    incidence: float
    captures: int
    parameter: str
    away: float
    error: float
    disagree: int


def told_together(frame: DataFrame) -> DataFrame:
    """Groups of captures of each number, drawn without putting back."""
    return DataFrame(list(_groups(frame)))


def _groups(frame: DataFrame) -> Iterator[Told]:
    for incidence, part in frame.groupby("incidence", sort=True):
        random = np.random.default_rng(0)
        true = dict(zip(_FIELDS, (incidence, _AZIMUTH, _SHIFT), strict=True))
        estimates = [_estimate(row) for row in part.itertuples()]
        for number in NUMBERS:
            if number > len(estimates):
                continue
            for _ in range(_DRAWS):
                drawn = random.choice(len(estimates), number, replace=False)
                shared = combine_scenes([estimates[i] for i in drawn])
                turned = round((shared.scene.values()[1] - _AZIMUTH) / 180)
                for name in _FIELDS:
                    value, error = getattr(shared.scene, name), getattr(shared.errors, name)
                    if error is None:
                        continue
                    if name == "azimuth_deg":
                        value -= 180 * turned
                    elif name == "ghost_shift" and turned % 2:
                        value = -value
                    away = float(value - true[name])
                    yield Told(float(incidence), number, name, away, float(error), len(shared.disagreements))


def _estimate(row: Any) -> Estimate:
    scene = SceneParameters(row.incidence_deg, row.azimuth_deg, row.ghost_shift)
    known = {name: getattr(row, f"{name}_error") for name in _FIELDS}
    return Estimate(scene, SceneErrors(**{name: None if value != value else value for name, value in known.items()}))


def _root_mean_square(part: DataFrame) -> str:
    return f"{math.sqrt(float((part.away**2).mean())):.3g}"


def tables(frame: DataFrame) -> str:
    """True and stated errors for each number of captures."""
    cells: dict[str, Callable[[DataFrame], str]] = {
        "true error (rms)": _root_mean_square,
        "stated error (median)": lambda part: f"{part.error.median():.3g}",
        "within two errors": lambda part: f"{100 * (part.away.abs() <= 2 * part.error).mean():.0f} %",
        "captures that disagree": lambda part: f"{100 * (part.disagree / part.captures).mean():.1f} %",
    }
    groups = {"parameter": "parameter", "incidence": "incidence", "captures": "captures"}
    return markdown(summary(told_together(frame), groups, cells))


def figures(frame: DataFrame) -> dict[str, Callable[[], Any]]:
    """Errors over the number of captures, beside the root of it."""
    return {NAME: lambda: _over_numbers(told_together(frame))}


def _over_numbers(told: DataFrame) -> Any:
    figure = new_figure(9, 3.2)
    for axes, name in zip(figure.subplots(1, len(_FIELDS)), _FIELDS, strict=True):
        part = told[told.parameter == name]
        if part.empty:
            continue
        grouped = part.groupby("captures")
        true = grouped.away.apply(lambda away: math.sqrt(float((away**2).mean())))
        stated = grouped.error.median()
        axes.plot(true.index, true, "o-", color="black", label="true, rms")
        axes.plot(stated.index, stated, "D--", color=BLUE, label="stated, median")
        axes.plot(stated.index, stated.iloc[0] / np.sqrt(stated.index), color="#999999", label="root of the number")
        axes.set_xscale("log", base=2)
        axes.set_yscale("log")
        axes.set_title(name)
        axes.set_xlabel("captures")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=False)
    return figure


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the study."""
    options = study_parser(__doc__).parse_args(arguments)
    effort = effort_of(options)
    jobs = [
        Job(options.photos, incidence, pair, turn)
        for incidence in INCIDENCES[effort]
        for pair in range(n_pairs_of(options, 4 if effort == "quick" else N_PAIRS, SIZE, MARGIN))
        for turn in range(TURNS[effort])
    ]
    frame = run_study(NAME, run, jobs, Row, options)
    publish(NAME, options, tables(frame), figures(frame))


if __name__ == "__main__":
    main()
