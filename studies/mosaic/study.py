"""Raw mosaics of polarization cameras: layers against four full photographs and demosaicking, real mosaics, crops.

Run ``polaropt study mosaic -o OUT``; without ``--photos`` it uses photographs inside scikit-image. With ``--data DIR``,
which holds ``real_mosaics`` and ``real_polar``, demosaicking alone is judged on photographs of full resolution and on
mosaics of real cameras; ``OUT/pictures`` gets crops of these, of which only those with a free licence are in a figure
beside the tables.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from studies.kit.charts import write_figures
from studies.kit.run import effort_of, publish, run_study, study_parser
from studies.mosaic import cameras, full_resolution, layers
from studies.photographs import n_pairs_of

NAME, DEMOSAICKING, CAMERAS = "mosaic", "demosaicking", "real_mosaics"
"""Of the layers' rows, tables and figures; of demosaicking alone; of real mosaics."""
SENSORS = ("mono", "color")


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the study."""
    parser = study_parser(__doc__)
    parser.add_argument("--sensors", default=",".join(SENSORS), help="Mono, color or both, comma separated.")
    parser.add_argument("--data", metavar="DIR", help="Folder with real_mosaics and real_polar.")
    options = parser.parse_args(arguments)
    quick = effort_of(options) == "quick"
    jobs = [
        layers.Job(pair, incidence, sensor, lens, options.photos)
        for sensor in options.sensors.split(",")
        for lens in ((layers.USUAL,) if quick else layers.BLURS_PX)
        for incidence in (layers.QUICK_INCIDENCES_DEG if quick else layers.INCIDENCES_DEG)
        for pair in range(n_pairs_of(options, 1 if quick else layers.N_PAIRS, layers.SIZE_PX, layers.MARGIN_PX))
    ]
    frame = run_study(NAME, layers.run, jobs, layers.Row, options)
    publish(NAME, options, layers.tables(frame), layers.figures(frame))
    if options.data is not None:
        _run_on_data(options)


def _run_on_data(options: argparse.Namespace) -> None:
    """Demosaicking alone, on photographs of full resolution and on mosaics of real cameras."""
    quick, data = effort_of(options) == "quick", str(Path(options.data).resolve())
    full = [full_resolution.Job(data, sensor) for sensor in options.sensors.split(",")]
    frame = run_study(DEMOSAICKING, full_resolution.run, full, full_resolution.Row, options)
    publish(DEMOSAICKING, options, full_resolution.tables(frame), {})
    pictures = options.out / "pictures"
    pictures.mkdir(parents=True, exist_ok=True)
    mosaics = cameras.MOSAICS[: 1 if quick else None]
    jobs = [cameras.Job(data, str(pictures.resolve()), mosaic.name) for mosaic in mosaics]
    frame = run_study(CAMERAS, cameras.run, jobs, cameras.Row, options)
    free = [mosaic.name for mosaic in mosaics if mosaic.free]
    publish(CAMERAS, options, cameras.tables(frame), {CAMERAS: lambda: cameras.crops(pictures, free)})
    write_figures(pictures, {"all": lambda: cameras.crops(pictures, [mosaic.name for mosaic in mosaics])})
