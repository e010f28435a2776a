"""How often the true layers lie within two of the standard errors that are stated, per incidence and noise.

Run ``polaropt study coverage -o OUT``; without ``--photos`` it uses photographs inside scikit-image.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pandas import DataFrame

from studies.camera import SceneJob
from studies.kit.charts import BLUE, GREEN, VERMILION, Style, legend_below, new_figure
from studies.kit.frames import Cell, markdown, mean, summary, values_of, where
from studies.kit.run import effort_of, publish, run_study, study_parser
from studies.photographs import N_PAIRS, n_pairs_of
from studies.scenes import INCIDENCES_DEG, NOISE, protocol
from studies.scores import LAYERS
from studies.ways import DEFAULT, WITH_SCENE

Images = NDArray[np.float32]

NAME = "coverage"
NOISES = (NOISE, 0.02)
WAYS = {"known": WITH_SCENE, "blind": DEFAULT}
"""By what is known of the scene."""
QUICK_INCIDENCES_DEG, QUICK_SIZE, SIZE = (10, 60), 128, 256
BLUR_PX = 1.0
"""Over so much around a pixel its gradient is averaged."""
FLAT, TEXTURED = 0.33, 0.67
"""Up to the one quantile of the gradients pixels are flat, from the other on they are textured."""


@dataclass(frozen=True)
class Job(SceneJob):
    """One scene, separated with the scene known or blind."""

    way: str = "blind"


@dataclass(frozen=True)
class Row:
    """One layer of one separation.

    Attributes
    ----------
    covered, covered_flat, covered_textured : float
        Share of the values within two standard errors of the truth: of all pixels, of the third of them where the
        true layer is flattest, and of the third where it is busiest.
    sharpness : float
        Root mean square of the stated errors in units of the true ones.
    rank_correlation : float
        Of stated and true errors over the pixels: whether the picture tells where the errors are.
    known : float
        Mean share of the reflection's detail that is said to be told.
    """

    pair: int
    incidence_deg: float
    noise: float
    scene: str
    layer: str
    covered: float
    covered_flat: float
    covered_textured: float
    sharpness: float
    rank_correlation: float
    known: float


def run(job: Job) -> list[Row]:
    """Separate one scene and compare both layers."""
    sample = job.sample()
    result = WAYS[job.way].separation(sample)
    known = float(result.reflection_known.mean())
    of_job = (job.pair, job.scene.value, job.scene.taking.noise, job.way)
    return [
        Row(*of_job, name, *compared(result.layers[i], result.uncertainty[i], sample.layers[i]), known)
        for i, name in enumerate(LAYERS)
    ]


def compared(layer: Images, stated: Images, true: Images) -> tuple[float, float, float, float, float]:
    """Coverage of all, flat and textured pixels, sharpness and rank correlation of a layer (channel, h, w)."""
    from scipy.stats import spearmanr

    error = np.abs(layer - true)
    within = error <= 2 * stated
    busy = busyness(true)
    flat, textured = busy <= np.quantile(busy, FLAT), busy >= np.quantile(busy, TEXTURED)
    return (
        float(within.mean()),
        float(within[:, flat].mean()),
        float(within[:, textured].mean()),
        float(np.sqrt(np.mean(np.square(stated)) / np.mean(np.square(error)))),
        float(spearmanr(stated.ravel(), error.ravel()).statistic),
    )


def busyness(layer: Images) -> NDArray[np.float64]:
    """Size of the gradient around each pixel of a layer (channel, h, w), mean over colours, (h, w)."""
    from scipy.ndimage import gaussian_filter

    down, across = np.gradient(layer.mean(axis=0))
    return np.asarray(gaussian_filter(np.hypot(down, across), BLUR_PX))


def tables(frame: DataFrame) -> str:
    """Means per scene, noise and incidence, in per cent but for sharpness and correlation."""
    cells: dict[str, Cell] = {
        "covered": _per_cent("covered"),
        "flat": _per_cent("covered_flat"),
        "textured": _per_cent("covered_textured"),
        "least of a pair": lambda part: f"{100 * part.covered.min():.1f}",
        "sharpness": mean("sharpness"),
        "rank correlation": mean("rank_correlation"),
    }
    of_transmission = {f"T {head}" if head == "covered" else head: _of(LAYERS[0], cell) for head, cell in cells.items()}
    of_reflection = {f"R {head}": _of(LAYERS[1], cell) for head, cell in cells.items()}
    groups = {"scene": "scene", "noise": "noise", "theta": "incidence_deg"}
    columns = {**of_transmission, **of_reflection, "R told": _per_cent("known", ".0f")}
    return markdown(summary(frame, groups, columns))


def _per_cent(column: str, form: str = ".1f") -> Cell:
    return lambda part: f"{100 * part[column].mean():{form}}"


def _of(layer: str, cell: Cell) -> Cell:
    return lambda part: cell(where(part, layer=layer))


_STYLES = (
    Style("black", "-", "o", 2.0),
    Style(BLUE, "--", "s"),
    Style(VERMILION, ":", "^"),
    Style(GREEN, "-.", "v"),
)
_WITHIN_TWO = 95.4
"""Per cent of a normal distribution within two standard deviations."""


def figures(frame: DataFrame) -> dict[str, Callable[[], Any]]:
    """How often the truth lies within two stated errors, over incidence."""
    return {NAME: lambda: _shares(frame)}


def _shares(frame: DataFrame) -> Any:
    figure = new_figure(10, 4.4)
    panels = figure.subplots(1, len(LAYERS), sharey=True)
    for panel, layer in zip(panels, LAYERS, strict=True):
        _panel(panel, where(frame, layer=layer), layer)
    panels[0].set_ylabel("pixels within two stated errors (%)")
    legend_below(figure, *panels[0].get_legend_handles_labels(), 3, handlelength=4)
    return figure


def _panel(panel: Any, frame: DataFrame, layer: str) -> None:
    """Means over pairs, and bars down to the least pair."""
    kinds = values_of(frame, "scene", "noise")
    for i, (scene, noise) in enumerate(kinds):
        shares = 100 * where(frame, scene=scene, noise=noise).groupby("incidence_deg").covered.agg(["mean", "min"])
        # Side by side, so that bars do not hide one another.
        places = shares.index + 0.7 * (i - (len(kinds) - 1) / 2)
        below = shares["mean"] - shares["min"]
        panel.errorbar(
            places, shares["mean"], yerr=[below, 0 * below], elinewidth=0.8, capsize=2,
            label=f"scene {scene}, noise {noise:g}", **_STYLES[i % len(_STYLES)].line,
        )  # fmt: skip
    panel.axhline(_WITHIN_TWO, color="grey", linewidth=1, label=f"{_WITHIN_TWO:g} %: normal errors")
    incidences = sorted(values_of(frame, "incidence_deg"))
    panel.set_xticks(incidences, [f"{incidence:g}" for incidence in incidences])
    panel.set_xlabel("angle of incidence (deg); bars: down to the least pair")
    panel.set_title(layer)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the study."""
    parser = study_parser(__doc__)
    parser.add_argument("--size", type=int, help="Side of the frame in pixels.")
    parser.add_argument("--noises", help="Standard deviations, comma separated.")
    options = parser.parse_args(arguments)
    quick = effort_of(options) == "quick"
    size = options.size or (QUICK_SIZE if quick else SIZE)
    jobs = [
        Job(protocol(incidence, noise=noise), pair, options.photos, size, way)
        for way in WAYS
        for noise in ([float(text) for text in options.noises.split(",")] if options.noises else NOISES)
        for incidence in (QUICK_INCIDENCES_DEG if quick else INCIDENCES_DEG)
        for pair in range(n_pairs_of(options, 1 if quick else N_PAIRS, size))
    ]
    frame = run_study(NAME, run, jobs, Row, options)
    publish(NAME, options, tables(frame), figures(frame))


if __name__ == "__main__":
    main()
