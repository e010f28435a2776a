"""How often the true numbers of a scene lie within two of the standard errors that are stated with them.

Run ``polaropt study parameter_errors -o OUT``; without ``--photos`` it uses photographs inside scikit-image.
Scenes of six kinds: bounces in place, ghosts, a wide lens, a bent pane before it, and ghosts before a polarized screen
or sky; incidence, azimuth, thickness, view, bend and polarization are random, seeded by pair and round.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from polaropt.capture import noise_level
from polaropt.estimation import FoundScene, find_scene
from polaropt.optics import SceneParameters
from studies.camera import photograph
from studies.kit.records import row_of, write_tables
from studies.kit.run import effort_of, run_jobs, study_parser, workers_of
from studies.parameter_errors_figure import draw
from studies.photographs import N_PAIRS, Pair, n_pairs_of, pairs_of
from studies.scenes import BLIND, random_scene
from studies.scenes import POLARIZED_KINDS as POLARIZED
from studies.scenes import RANDOM_KINDS as KINDS

SURE = 2.0
_SIZE, _MARGIN = 192, 128
_TURNS = {"quick": 1, "default": 2, "full": 4}


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

    @property
    def covered(self) -> bool:
        """Whether the truth lies within two standard errors."""
        return abs(self.found - self.true) <= SURE * self.error


def scene_rows(kind: str, pair: Pair, turn: int) -> Iterator[Row]:
    """Every number that was found with an error, of one scene on the rung of its kind."""
    size = pair.cropped(pair.transmission).shape[0]
    scene = random_scene(kind, size, np.random.default_rng([pair.number, turn, KINDS.index(kind)]))
    capture = photograph(pair, scene).capture
    found = find_scene(capture, BLIND, noise_level(capture), _rung(kind))
    for parameter, true, value, error in compared(scene, found):
        yield Row(kind, pair.number, turn, scene.values()[0], parameter, true, value, error)


def _rung(kind: str) -> str:
    """The rung that is asked for."""
    return "polarized" if kind in POLARIZED else kind


def compared(scene: SceneParameters, found: FoundScene) -> Iterator[tuple[str, float, float, float]]:
    """Name, truth, value found and its error of each number; both azimuths that name the same pane are right."""
    errors, told = found.errors, found.scene
    incidence, azimuth, shift = scene.values()
    found_incidence, found_azimuth, found_shift = told.values()
    period = 360.0 if scene.focal_px is not None else 180.0
    turned = (found_azimuth - azimuth + period / 2) % period - period / 2
    sense = 1 if abs((found_azimuth - azimuth + 180) % 360 - 180) < 90 else -1
    numbers = [
        ("incidence_deg", incidence, found_incidence, errors.incidence_deg),
        ("azimuth_deg", azimuth, azimuth + turned, errors.azimuth_deg),
        ("ghost_shift", sense * shift, found_shift, errors.ghost_shift),
        ("focal_px", scene.focal_px or math.nan, told.focal_px or math.nan, errors.focal_px),
    ]
    if errors.bend_deg_per_px is not None:
        bends = zip(scene.bend_deg_per_px, told.bend_deg_per_px, errors.bend_deg_per_px, strict=True)
        numbers += [("bend_deg_per_px", true, value, error) for true, value, error in bends]
    numbers += _of_light(scene, found)
    for name, true, value, error in numbers:
        if error is not None:
            yield name, true, value, error


def _of_light(scene: SceneParameters, found: FoundScene) -> Iterator[tuple[str, float, float, float]]:
    """The same of degree and angle of each layer's light; no angle is true of unpolarized light."""
    for name in POLARIZED.values():
        (degree, angle), told, errors = (getattr(part, name) for part in (scene, found.scene, found.errors))
        if errors is not None:
            yield f"{name}, degree", degree, told[0], errors[0]
            if degree:
                yield f"{name}, angle", angle, angle + (told[1] - angle + 90) % 180 - 90, errors[1]


def table(rows: Sequence[Row]) -> str:
    """Shares covered and typical errors per kind and parameter, and over all kinds, as a Markdown table."""
    lines = [
        "| scenes | parameter | n | within two errors | stated error, median | true error, median |",
        "|" + "---|" * 6,
    ]
    kinds = [*dict.fromkeys(row.kind for row in rows), "all"]
    for kind in kinds:
        part = [row for row in rows if kind in (row.kind, "all")]
        for parameter in dict.fromkeys(row.parameter for row in part):
            told = [row for row in part if row.parameter == parameter]
            away = np.median([abs(row.found - row.true) for row in told])
            lines.append(
                f"| {kind} | {parameter} | {len(told)} | {100 * np.mean([row.covered for row in told]):.0f} % "
                f"| {np.median([row.error for row in told]):.3g} | {away:.3g} |"
            )
    return "\n".join(lines)


def run(job: Job) -> list[Row]:
    """Find one scene."""
    return list(scene_rows(job.kind, pairs_of(job.photos, _SIZE, _MARGIN)[job.pair], job.turn))


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table and write it with all rows."""
    parser = study_parser(__doc__)
    parser.add_argument("--kinds", default=",".join(KINDS), help="names, comma separated")
    options = parser.parse_args(arguments)
    effort = effort_of(options)
    n_pairs = n_pairs_of(options, 2 if effort == "quick" else N_PAIRS, _SIZE, _MARGIN)
    jobs = [
        Job(options.photos, kind, pair, turn)
        for kind in options.kinds.split(",")
        for pair in range(n_pairs)
        for turn in range(_TURNS[effort])
    ]
    made = run_jobs(run, jobs, options.out / "parameter_errors.json", {}, workers_of(options))
    rows = [row_of(Row, row) for row in made]
    text = table(rows)
    print(text)
    write_tables(options.out, "parameter_errors", made, text)
    draw(rows, options.out)


if __name__ == "__main__":
    main()
