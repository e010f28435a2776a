"""Real captures and measured layers, separated blind: scene, seconds, warnings, and shared edges of the layers.

Run ``polaropt study real_captures --data DIR -o OUT``; DIR holds ``real_polar`` and ``layer_pairs``. ``OUT/pictures``
gets intensity, transmission and reflection of each: they are others' photographs, and not kept with the results.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pandas import DataFrame

from polaropt.capture import Capture, planes_first, planes_last, read_capture, write_png_view
from polaropt.optics import SceneParameters
from polaropt.separation import separate
from polaropt.simulation import simulate, stack_layers
from studies.kit.frames import Cell, markdown, mean, summary
from studies.kit.run import effort_of, publish, run_study, study_parser
from studies.photographs import GAMMA
from studies.scenes import BITS, NOISE, REFRACTIVE_INDEX, WATER_INDEX
from studies.scores import both_psnr, psnr

Image = NDArray[np.float32]

NAME = "real_captures"
REAL, MEASURED = "real_polar", "layer_pairs"
"""Folders of captures, and of layers that were measured behind real glass."""
INCIDENCES_DEG = (20.0, 45.0, 65.0)
"""At which the engine polarizes measured layers."""
AZIMUTH_DEG, GHOST_SHIFT_PX = 30.0, 4.2
WHITE_QUANTILE = 0.99
"""Of a picture: this value is shown white."""
PEER = ("IMG_0287", "lei2020_IMG_0287_peerT16.png")
"""A capture of which there is the transmission that another's network gives."""
PEER_SHARE = (0.4, 0.7)
"""Of its rows and columns: the part, at the upper left, where the reflection has edges."""


@dataclass(frozen=True)
class Job:
    """One capture.

    Attributes
    ----------
    data, pictures : str
        Folder of the data, and folder for the pictures.
    name : str
    files : tuple of str
        Of a real capture; none of measured layers.
    refractive_index : float
    single_surface : bool
    incidence_deg : float
        At which measured layers are polarized.
    """

    data: str
    pictures: str
    name: str
    files: tuple[str, ...] = ()
    refractive_index: float = REFRACTIVE_INDEX
    single_surface: bool = False
    incidence_deg: float = math.nan


def captures(data: str, pictures: str) -> list[Job]:
    """The real ones, each with what is known of the pane."""
    glass = tuple(f"lapray_glass_nir_{angle}.png" for angle in ("000", "045", "090", "135"))
    return [
        Job(data, pictures, PEER[0], ("lei2020_IMG_0287_mosaic16.png",)),
        Job(data, pictures, "carps", ("maeda_carps_mosaic8.png",), WATER_INDEX, True),
        Job(data, pictures, "glass", glass),
    ]


@dataclass(frozen=True)
class Row:
    """One separation; not a number is what is not known of real captures, or not asked of measured layers.

    Attributes
    ----------
    name : str
    true_incidence_deg : float
        Of measured layers, as `nothing`, `transmission` and `reflection`.
    incidence_deg, azimuth_deg, ghost_shift, misfit, seconds
        As estimated; mean squared residual in units of the noise; the seconds of a capture include reading.
    edges_before, edges_after : float
        Correlation of the edges of the plain intensity and of the transmission with those of the reflection.
    edges_here, edges_peer : float
        The same of the upper left of the transmission, and of another's.
    nothing, transmission, reflection : float
        PSNR in dB, of the plain intensity first.
    warnings : tuple of str
    """

    name: str
    true_incidence_deg: float
    incidence_deg: float
    azimuth_deg: float
    ghost_shift: float
    misfit: float
    edges_before: float
    edges_after: float
    edges_here: float
    edges_peer: float
    nothing: float
    transmission: float
    reflection: float
    seconds: float
    warnings: tuple[str, ...]


def run(job: Job) -> list[Row]:
    """Read or simulate one capture, separate it and write its pictures."""
    began = time.perf_counter()
    true = None if job.files else _measured(job)
    capture = _read(job) if true is None else _simulated(job, true)
    result = separate(capture, refractive_index=job.refractive_index, single_surface=job.single_surface)
    seconds = time.perf_counter() - began
    intensity = capture.stokes[0]
    edges, levels = [math.nan] * 4, [math.nan] * 3
    if true is None:
        shared = [edge_correlation(image, result.layers[1]) for image in (intensity, result.layers[0])]
        edges = [*shared, *_beside_peer(job, result.layers)]
    else:
        truth = stack_layers(*true)
        levels = [psnr(intensity, truth[0]), *both_psnr(result.layers, truth)]
    _write_side_by_side(_picture(job), [planes_last(intensity), result.transmission, result.reflection])
    warnings = tuple(warning.name for warning in result.diagnostics.warnings)
    of_scene = (*result.scene.values(), result.diagnostics.misfit_ratio)
    return [Row(job.name, job.incidence_deg, *of_scene, *edges, *levels, seconds, warnings)]


def _read(job: Job) -> Capture:
    return read_capture([Path(job.data) / REAL / file for file in job.files])


def _measured(job: Job) -> list[Image]:
    """Layers (h, w, 3) in linear light."""
    from skimage.io import imread

    files = [Path(job.data) / MEASURED / f"{job.name}_{part}.png" for part in "TR"]
    return [(imread(file)[..., :3] / 255.0) ** GAMMA for file in files]


def _simulated(job: Job, layers: Sequence[Image]) -> Capture:
    scene = SceneParameters(job.incidence_deg, AZIMUTH_DEG, GHOST_SHIFT_PX)
    return simulate(layers[0], layers[1], scene, noise=NOISE, bits=BITS, seed=1)


def edge_correlation(first: Image, second: Image) -> float:
    """Correlation of the root gradient magnitudes of two images (h, w), smoothed by one pixel against shared noise."""
    from scipy.ndimage import gaussian_gradient_magnitude

    sizes = [np.sqrt(gaussian_gradient_magnitude(image, 1.0)).ravel() for image in (first, second)]
    return float(np.corrcoef(sizes[0], sizes[1])[0, 1])


def _beside_peer(job: Job, layers: Image) -> tuple[float, float]:
    """Edges of the reflection that are left in the transmission, here and in the peer network's output."""
    from skimage.io import imread

    if job.name != PEER[0]:
        return math.nan, math.nan
    peer = imread(Path(job.data) / REAL / PEER[1]).astype(np.float32)
    rows, columns = (int(share * side) for share, side in zip(PEER_SHARE, peer.shape, strict=True))
    here, there, reflection = (image[:rows, :columns] for image in (layers[0], peer, layers[1]))
    return edge_correlation(here, reflection), edge_correlation(there, reflection)


def _picture(job: Job) -> Path:
    ending = "" if job.files else f"_{job.incidence_deg:g}"
    return Path(job.pictures) / f"{job.name}{ending}.png"


def _write_side_by_side(path: Path, images: Sequence[Image]) -> None:
    """Images next to each other, each at its own exposure."""
    shown = [np.clip(image / np.quantile(image, WHITE_QUANTILE), 0, 1) for image in images]
    write_png_view(path, planes_first(np.concatenate(shown, axis=1).astype(np.float32)))


def tables(frame: DataFrame) -> str:
    """The captures with what was found, beside a peer; measured layers beside the truth."""
    if frame.empty:
        return f"No captures were given: `--data DIR`, a folder with {REAL} and {MEASURED} in it."
    of_captures: dict[str, Cell] = {
        "theta": mean("incidence_deg", ".1f"),
        "azimuth": mean("azimuth_deg", ".1f"),
        "shift": mean("ghost_shift"),
        "misfit": mean("misfit", ".1f"),
        "edges s0-R": mean("edges_before", ".3f"),
        "edges T-R": mean("edges_after", ".3f"),
        "s": mean("seconds", ".1f"),
        "warnings": lambda part: ", ".join(part.warnings.iloc[0]) or "none",
    }
    of_layers = {
        "s0": mean("nothing"),
        "T blind": mean("transmission"),
        "R blind": mean("reflection"),
        "theta found": mean("incidence_deg", ".1f"),
    }
    of_peer = frame[frame.edges_peer.notna()].itertuples()
    real, measured = frame[frame.true_incidence_deg.isna()], frame[frame.true_incidence_deg.notna()]
    return "\n\n".join([
        markdown(summary(real, {"capture": "name"}, of_captures)),
        *(
            f"{row.name}, upper left: edge correlation with the reflection {row.edges_here:.3f} "
            f"(peer network: {row.edges_peer:.3f})"
            for row in of_peer
        ),
        markdown(summary(measured, {"layers": "name", "theta": "true_incidence_deg"}, of_layers)),
    ])  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the study; without data it says what it wants."""
    parser = study_parser(__doc__)
    parser.add_argument("--data", metavar="DIR", help=f"Folder with {REAL} and {MEASURED}.")
    options = parser.parse_args(arguments)
    jobs = []
    if options.data is not None:
        quick = effort_of(options) == "quick"
        pictures = options.out / "pictures"
        pictures.mkdir(parents=True, exist_ok=True)
        folders = str(Path(options.data).resolve()), str(pictures.resolve())
        jobs = captures(*folders)[: 1 if quick else None]
        jobs += [
            Job(*folders, name, incidence_deg=incidence)
            for name in (("mtr1",) if quick else ("mtr1", "mtr2"))
            for incidence in INCIDENCES_DEG[: 1 if quick else None]
        ]
    frame = run_study(NAME, run, jobs, Row, options)
    publish(NAME, options, tables(frame), {})


if __name__ == "__main__":
    main()
