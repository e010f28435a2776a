"""The default and the solver torch on a GPU against the same on the processor, all by the clock.

``python -m studies.speed_accuracy.gpu -o OUT`` runs this part of the study alone.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from importlib.util import find_spec

import numpy as np
from pandas import DataFrame

from studies.kit.frames import markdown, values_of, where
from studies.kit.run import Effort, effort_of, publish, run_study, study_parser
from studies.photographs import Size
from studies.speed_accuracy.jobs import FEW, Job, Row, run
from studies.speed_accuracy.marks import ON_GPU, SUBJECTS, with_ways
from studies.ways import DEFAULT, GPU

NAME = "speed_accuracy_gpu"
NO_GPU = "no GPU here"
_ALL = (Size(256, 256), Size(512, 512), Size(1024, 1224), Size(2048, 2448))
SIZES: dict[Effort, tuple[Size, ...]] = {"quick": (Size(64, 64),), "default": _ALL[:3], "full": _ALL}
_REPEATS: dict[Effort, int] = {"quick": 1, "default": 3, "full": 5}
_NOTE = (
    "Seconds by the clock, median over repeats (least to largest), all cores and threads at work: those of the "
    "processor would not count what the GPU does. The scene is found on the processor by all."
)


def there() -> bool:
    """Whether torch finds a GPU."""
    if find_spec("torch") is None:
        return False
    import torch

    return bool(torch.cuda.is_available())


def jobs_of(photos: str | None, effort: Effort, device: str = GPU) -> list[Job]:
    """The first scene in each size, as four photographs and as mosaics."""
    return [
        Job(photos, ON_GPU, size, FEW[0], 0, sensor, repeats=_REPEATS[effort], device=device)
        for sensor in SUBJECTS
        for size in SIZES[effort]
    ]


def run_part(options: argparse.Namespace) -> None:
    """Run it and write its rows and table, where there is a GPU; else say that there is none."""
    if not there():
        publish(NAME, options, NO_GPU, {})
        return
    frame = run_study(NAME, run, jobs_of(options.photos, effort_of(options)), Row, options)
    publish(NAME, options, table(frame), {})


def table(frame: DataFrame) -> str:
    """A line for each way, size and subject."""
    frame = with_ways(frame)
    lines = []
    for sensor, size in values_of(frame, "sensor", "size"):
        part = where(frame, sensor=sensor, size=size)
        default = _median(where(part, way=DEFAULT))
        for way in values_of(part, "way"):
            rows = where(part, way=way)
            ran = rows[rows.not_run == ""]
            lines.append([SUBJECTS[sensor], size, way.label, *(_cells(ran, default) if len(ran) else [""] * 4)])
    names = ("photographs", "size", "way", "s", "times the default", "T", "R")
    return f"{_NOTE}\n\n{markdown(DataFrame(lines, columns=list(names)))}"


def _cells(rows: DataFrame, default: float) -> list[str]:
    every = [value for values in rows.elapsed for value in values]
    seconds = _median(rows)
    return [
        f"{seconds:.3g} ({min(every):.3g} to {max(every):.3g})",
        f"{seconds / default:.2f}",
        *(f"{rows[layer].mean():.2f}" for layer in ("transmission", "reflection")),
    ]


def _median(rows: DataFrame) -> float:
    return float(rows.elapsed.map(np.median).mean())


def main(arguments: Sequence[str] | None = None) -> None:
    """Run this part alone."""
    run_part(study_parser(__doc__).parse_args(arguments))


if __name__ == "__main__":
    main()
