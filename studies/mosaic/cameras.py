"""Mosaics of real polarization cameras: polarization that is not there, and how well two pairs of angles agree.

Nobody knows the truth of them. Where the light of a neighbourhood is not polarized, its detail hardly is, so what a
demosaicking shows there is false. I0 + I90 and I45 + I135 are the same intensity; ways whose photographs are made of
Stokes vectors close by construction, and their residual says nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pandas import DataFrame

from polaropt.capture import ANGLES_DEG, Capture, read_capture
from polaropt.optics import stokes_from_intensities
from studies.kit.charts import CROP_PX, new_figure
from studies.kit.frames import Cell, markdown, mean, summary
from studies.mosaic.demosaicking import LENS_BLUR_PX, bilinear, trained
from studies.mosaic.full_resolution import polarization
from studies.scores import BORDER_PX

Images = NDArray[np.float32]
Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Mosaic:
    """A file below the data's folder, and whether its licence lets crops of it be kept with the results."""

    name: str
    file: str
    free: bool = False


MOSAICS = (
    Mosaic("house", "real_mosaics/mono_mosaic/hagen_buildings_and_sky.tif", free=True),
    Mosaic("polarizers", "real_polar/maeda_polarizers_mosaic8.png", free=True),
    Mosaic("carps", "real_polar/maeda_carps_mosaic8.png", free=True),
    Mosaic("desk", "real_mosaics/mono_mosaic/lucid_desk_mono8.png"),
    Mosaic("facade", "real_mosaics/mono_mosaic/ahsan_06_facade.png"),
    Mosaic("IMG_0287", "real_polar/lei2020_IMG_0287_mosaic16.png"),
    Mosaic("color 01", "real_mosaics/color_mosaic_pidsr/01.png"),
    Mosaic("color 02", "real_mosaics/color_mosaic_pidsr/02.png"),
    Mosaic("color 03", "real_mosaics/color_mosaic_pidsr/03.png"),
)
BILINEAR, LMMSE, WIENER, CELL = WAYS = ("polanalyser, bilinear", "LMMSE", "polaropt", "polaropt, cell")
NEIGHBORHOOD_CELLS = 4.0
"""Standard deviation of the Gaussian over which light is averaged to see whether it is polarized."""
UNPOLARIZED = 0.03
"""Degree of polarization of a neighbourhood below which its detail counts. Set by hand."""
DETAIL_SHARE = 0.2
"""Of the unpolarized cells: those with the steepest intensity for its size are detail. Set by hand."""
DARK_SHARE = 0.05
"""Of the intensity that 99 % of the cells have: what is darker is left out, since noise is most of it. Set by hand."""
FALSE = 0.1
"""Degree of polarization that is false where there is none. Set by hand."""
FEWEST_CELLS = 200
"""Of unpolarized detail, that a percentile needs. Set by hand."""
_SHOWN_DEGREE = 0.3
_WHITE_QUANTILE = 0.99


@dataclass(frozen=True)
class Job:
    """One mosaic, and the folder for its crops."""

    data: str
    pictures: str
    name: str


@dataclass(frozen=True)
class Row:
    """What one way makes of one mosaic.

    Attributes
    ----------
    name, sensor, way : str
    detail_share : float
        Of the picture: unpolarized detail. Where there is hardly any, the next two are not a number.
    false_degree : float
        95th percentile of the degree of polarization there.
    false_share : float
        Share of it that is shown with a degree of `FALSE` or more.
    closure : float
        Root mean square of half the difference of I0 + I90 and I45 + I135, over the mean intensity; 0 by construction
        but for bilinear photographs and cells.
    """

    name: str
    sensor: str
    way: str
    detail_share: float
    false_degree: float
    false_share: float
    closure: float


def run(job: Job) -> list[Row]:
    """Interpolate one mosaic in all ways, and write crops where its detail is."""
    mosaic = next(mosaic for mosaic in MOSAICS if mosaic.name == job.name)
    capture = read_capture(Path(job.data) / mosaic.file)
    scale, sensor = capture.scale, "color" if capture.color else "mono"
    detail = unpolarized_detail(capture.registered, BORDER_PX // scale)
    rows, degrees = [], {}
    for way in WAYS:
        photographs = _photographs(capture, way)
        stokes = np.asarray(stokes_from_intensities(photographs, ANGLES_DEG), dtype=np.float64)
        degrees[way] = polarization(stokes).degree
        here = detail if way == CELL else np.repeat(np.repeat(detail, scale, axis=0), scale, axis=1)
        shown = degrees[way][..., here]
        false = (math.nan, math.nan)
        if detail.sum() >= FEWEST_CELLS:
            false = (float(np.quantile(shown, 0.95)), float((shown >= FALSE).mean()))
        rows.append(Row(job.name, sensor, way, float(detail.mean()), *false, closure(photographs)))
    _write_crops(Path(job.pictures) / f"{job.name}.npz", capture, degrees, detail)
    return rows


def _photographs(capture: Capture, way: str) -> Images:
    """Photographs (k, [channel,] h, w) of a way, all from the same samples, without the gain of the 45/135 pair."""
    assert capture.samples is not None
    assert capture.origin is not None
    raw, noise = capture.samples.values, capture.origin.raw_noise or 0
    ways: dict[str, Callable[[], Images]] = {
        BILINEAR: lambda: bilinear(raw, capture.color),
        LMMSE: lambda: trained(capture.color, LENS_BLUR_PX).interpolate(raw, noise),
        WIENER: lambda: capture.intensities,
        CELL: lambda: capture.registered.intensities,
    }
    return ways[way]()


def unpolarized_detail(cells: Capture, border: int) -> Mask:
    """Cells (h, w) whose neighbourhood is not polarized and whose intensity changes steeply; colours together.

    It is seen on the cells of a mosaic, whose samples went through one and the same low pass, and no way's photographs.
    """
    from scipy.ndimage import gaussian_filter

    stokes = np.asarray(cells.stokes, dtype=np.float64)
    if cells.color:
        stokes = stokes.mean(axis=1)
    around = gaussian_filter(stokes, NEIGHBORHOOD_CELLS, axes=(-1, -2))
    trusted = cells.valid.all(axis=tuple(range(cells.valid.ndim - 2)))
    trusted &= stokes[0] > DARK_SHARE * np.quantile(stokes[0], 0.99)
    inner = np.zeros_like(trusted)
    inner[border:-border, border:-border] = True
    unpolarized = trusted & inner & (polarization(around).degree < UNPOLARIZED)
    if not unpolarized.any():
        return unpolarized
    steep = steepness(stokes[0])
    return np.asarray(unpolarized & (steep > np.quantile(steep[unpolarized], 1 - DETAIL_SHARE)))


def steepness(intensity: Floats) -> Floats:
    """Gradient of an intensity (h, w) over that of its neighbourhood."""
    from scipy.ndimage import gaussian_filter, gaussian_gradient_magnitude

    around = gaussian_filter(intensity, NEIGHBORHOOD_CELLS)
    return np.asarray(gaussian_gradient_magnitude(intensity, 1.0) / np.maximum(around, 1e-6))


def closure(photographs: Images) -> float:
    """Root mean square of half of I0 + I90 - I45 - I135 over the mean intensity."""
    first, second = (photographs[i].astype(np.float64) + photographs[i + 2] for i in (0, 1))
    return float(np.sqrt(np.square((first - second) / 2).mean()) / ((first + second) / 2).mean())


def tables(frame: DataFrame) -> str:
    """A line for each mosaic and way."""
    cells: dict[str, Cell] = {
        "unpolarized detail (%)": lambda part: f"{100 * part.detail_share.mean():.1f}",
        "false degree (95 %)": mean("false_degree", ".3f"),
        f"above {FALSE:g} (%)": lambda part: f"{100 * part.false_share.mean():.1f}",
        "closure (%)": lambda part: "-" if part.way.iloc[0] in (LMMSE, WIENER) else f"{100 * part.closure.mean():.2f}",
    }
    return markdown(summary(frame, {"mosaic": "name", "sensor": "sensor", "way": "way"}, cells)).replace(" nan ", " - ")


def _write_crops(path: Path, capture: Capture, degrees: Mapping[str, Floats], detail: Mask) -> None:
    """Where the unpolarized detail is steepest: the intensity, and the degree by each way, means of the colours."""
    from scipy.ndimage import uniform_filter

    scale, intensity = capture.scale, capture.registered.stokes[0].astype(np.float64)
    steep = steepness(intensity.mean(axis=0) if capture.color else intensity)
    # Where all is polarized, detail is.
    weights = steep * (detail if detail.sum() >= FEWEST_CELLS else 1)
    side = CROP_PX // scale
    half = side // 2
    inside = uniform_filter(weights, side)[half : weights.shape[0] - half, half : weights.shape[1] - half]
    top, left = (int(index) for index in np.unravel_index(np.argmax(inside), inside.shape))

    def crop(image: Any, pixels: int) -> Images:
        flat = image.mean(axis=0) if image.ndim == 3 else image
        here = flat[top * pixels : (top + side) * pixels, left * pixels : (left + side) * pixels]
        return np.asarray(here, dtype=np.float32)

    images = {"intensity": crop(capture.stokes[0], scale)}
    images |= {way: crop(degree, 1 if way == CELL else scale) for way, degree in degrees.items()}
    np.savez(path, **images)


def crops(pictures: Path, names: list[str]) -> Any:
    """A figure of the crops of mosaics: the intensity, then what each way shows of the degree of polarization."""
    figure = new_figure(2 * (1 + len(WAYS)) + 1, 0.3 + 2.05 * len(names))
    grid = figure.subplots(len(names), 1 + len(WAYS), squeeze=False)
    for axes, name in zip(grid, names, strict=True):
        images = np.load(pictures / f"{name}.npz")
        white = float(np.quantile(images["intensity"], _WHITE_QUANTILE))
        axes[0].imshow(images["intensity"], cmap="gray", vmin=0, vmax=white, interpolation="nearest")
        axes[0].set_ylabel(name)
        for panel, way in zip(axes[1:], WAYS, strict=True):
            shown = panel.imshow(images[way], cmap="magma", vmin=0, vmax=_SHOWN_DEGREE, interpolation="nearest")
    for panel, title in zip(grid[0], ("intensity", *WAYS), strict=True):
        panel.set_title(title)
    for panel in grid.flat:
        panel.set_xticks([])
        panel.set_yticks([])
        panel.grid(visible=False)
    figure.colorbar(shown, ax=grid, label="degree of polarization", fraction=0.02, aspect=30)
    return figure
