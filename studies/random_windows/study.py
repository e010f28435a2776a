"""How good is a separation of any window: random scenes over everything, fitted on half of them, judged on the others.

Run ``polaropt study random_windows -o OUT`` for the scenes that are there to fit on, with ``--seeds judge`` for those
that are looked at once, at the end. ``--from N`` takes scenes from that number on, which nothing was fitted on either,
``--against FOLDER`` tells what changed since an earlier run. ``--only N`` prints all about scene N and writes pictures
of its layers. ``--sensor mono`` (or ``color``) takes raw mosaics of a polarization camera, in frames of 384 px.

A scene is drawn by its number: incidence, refractive index, noise, double images, and what is special about its
family. Doing nothing is the better of the plain intensity and of s0 - sqrt(s1^2 + s2^2), twice the fitted minimum over
all polarizer angles. A separation fails where its transmission lies more than 3 dB below that of the solve with the
scene known; POLARIZED_SOURCE, SATURATED and REFLECTION_NOT_IDENTIFIABLE alone do not announce that. A warning without
failure is a false alarm unless it is true of the scene. A rung is adequate that the scene was made with (double images
from 0.5 px on: `ghosts`), or a lower one within 1 dB of the solve with the scene known.
"""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, get_args

from polaropt.capture import planes_last
from polaropt.separation import Separation
from studies.kit.charts import crops, write_figures
from studies.kit.frames import frame_of
from studies.kit.run import effort_of, publish, run_study, study_parser
from studies.kit.speech import say_tables
from studies.parameter_errors import compared
from studies.random_windows.comparison import changes, earlier
from studies.random_windows.judging import judged
from studies.random_windows.results import figures, tables, what_is_wrong
from studies.random_windows.separations import Job, Row, row_of, run, stated_errors
from studies.random_windows.windows import FAMILIES, FIT, HALVES, Window, numbers_of, window_of
from studies.scenes import Sensor
from studies.ways import DEFAULT, WITH_SCENE

NAME = "random_windows"
SENSORS = tuple(sensor for sensor in get_args(Sensor) if sensor)
PER_FAMILY = {"quick": 1, "default": 10, "full": 25}
QUICK_SIZE, SIZE, MOSAIC_SIZE = 96, 192, 384


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the study, or look at one scene."""
    parser = study_parser(__doc__)
    parser.add_argument("--seeds", choices=HALVES, default=FIT, help="Which half of the scenes.")
    parser.add_argument("--families", default="", help="Only families whose names contain one of these, by commas.")
    parser.add_argument("--per-family", type=int, metavar="N", help="Scenes of each family.")
    parser.add_argument("--from", dest="first", type=int, default=0, metavar="N", help="Scenes from this number on.")
    parser.add_argument("--against", type=Path, metavar="FOLDER", help="Earlier results: tell what changed.")
    parser.add_argument("--only", type=int, metavar="N", help="All about the scene with this number.")
    parser.add_argument("--sensor", choices=SENSORS, default="", help="Raw mosaics of such a polarization camera.")
    parser.add_argument(
        "--shot-noise", action="store_true", help="Noise that grows with the light, as a sensor's does."
    )
    options = parser.parse_args(arguments)
    size = (MOSAIC_SIZE if options.sensor else SIZE) // (SIZE // QUICK_SIZE if options.quick else 1)
    if options.only is not None:
        look_at(options, size)
        return
    names = [name for name in FAMILIES if any(word in name for word in options.families.split(","))]
    per_family = options.per_family or PER_FAMILY[effort_of(options)]
    jobs = [
        Job(number, options.photos, size, options.sensor, options.shot_noise)
        for number in numbers_of(options.seeds, per_family, options.first)
        if window_of(number, size, options.sensor).family in names
    ]
    try:
        # Read first: it may be the folder that is written to.
        before = None if options.against is None else earlier(options.against)
    except FileNotFoundError as error:
        parser.error(str(error))
    # Family by family, as tables and figures have them.
    jobs.sort(key=lambda job: names.index(job.window.family))
    frame = run_study(NAME, run, jobs, Row, options)
    publish(NAME, options, tables(frame), figures(frame))
    if before is not None:
        told = changes(before, frame)
        say_tables(told)
        (options.out / "changes.md").write_text(told + "\n", encoding="utf-8")


def look_at(options: argparse.Namespace, size: int) -> None:
    """Print and write all about one scene, and pictures of its layers."""
    window = window_of(options.only, size, options.sensor, options.shot_noise)
    sample = window.sample(options.photos, size)
    blind, known = DEFAULT.separation(sample), WITH_SCENE.separation(sample)
    row = row_of(window, size, sample, blind, known)
    told = "\n".join(told_of(window, row, blind))
    print(told)
    options.out.mkdir(parents=True, exist_ok=True)
    name = f"scene_{window.number}"
    (options.out / f"{name}.txt").write_text(told + "\n", encoding="utf-8")
    shown = {"true": sample.layers, "blind": blind.layers, "scene known": known.layers}
    pictures = {title: [planes_last(layer) for layer in layers] for title, layers in shown.items()}
    write_figures(options.out, {name: lambda: crops(pictures, len(pictures))})


def told_of(window: Window, row: Row, blind: Separation) -> Iterator[str]:
    """Lines about a scene: what it is, what came out, and why."""
    yield f"scene {window.number} ({window.family}, to {window.half}), made with the rung {window.rung}"
    for title, values in (("pane", window.scene), ("taking", window.taking), ("told", window.hint)):
        yield f"{title}: {_changed(values)}"
    yield f"found: {_changed(blind.scene)}"
    for name, true, value, error in compared(window.scene, blind.scene, stated_errors(blind)):
        sigmas = abs(value - true) / max(error, 1e-12)
        yield f"  {name}: {value:.4g} +- {error:.2g}, true {true:.4g} ({sigmas:.1f} errors off)"
    yield "rungs:"
    for rung in blind.tried:
        misfit = "-" if rung.misfit is None else f"{rung.misfit:.2f}"
        yield f"  {rung.rung}{' (taken)' if rung.taken else ''}: leaves {misfit}. {rung.reason}"
    estimate = blind.diagnostics.estimate
    if estimate is not None:
        yield (
            f"axis: margin {estimate.axis_margin:.3g} ({estimate.axis_margin / blind.diagnostics.noise:.1f} noise "
            f"levels), other's chance {estimate.axis_chance:.2g}; polarization {estimate.polarization_snr:.0f} errors"
        )
    (verdict,) = judged(frame_of(Row, [row])).itertuples()
    yield f"noise measured: {blind.diagnostics.noise:.4f}; misfit {row.misfit:.2f}"
    yield f"T {row.transmission:.1f} dB, known {row.known_transmission:.1f}, intensity {row.intensity:.1f}, " + (
        f"minimum {row.minimum:.1f}"
    )
    yield f"R {row.reflection:.1f} dB, known {row.known_reflection:.1f}; detail {row.detail:.2f}, " + (
        f"known {row.known_detail:.2f}"
    )
    yield f"covered: T {100 * row.covered_transmission:.0f} %, R {100 * row.covered_reflection:.0f} %"
    yield f"warnings: {', '.join(row.warnings) or '-'}"
    yield f"wrong: {what_is_wrong(verdict) or '-'}"


def _changed(values: Any) -> str:
    """The fields of a dataclass that are not as by default."""
    kept = [
        f"{field.name}={_short(getattr(values, field.name))}"
        for field in dataclasses.fields(values)
        if getattr(values, field.name) != field.default
    ]
    return ", ".join(kept) or "as by default"


def _short(value: Any) -> str:
    if isinstance(value, tuple):
        return f"({', '.join(map(_short, value))})"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


if __name__ == "__main__":
    main()
