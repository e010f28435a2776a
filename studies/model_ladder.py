"""Which rung of the ladder is taken on each family of scenes, and what it costs against the best fixed one.

Run ``polaropt study model_ladder -o OUT``; without ``--photos`` it uses photographs inside scikit-image.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from pandas import DataFrame

from studies.camera import SceneJob
from studies.kit.charts import BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILION, legend_below, new_figure
from studies.kit.frames import markdown, mean, n_with, summary, values_of, where
from studies.kit.run import effort_of, publish, run_study, study_parser
from studies.photographs import n_pairs_of
from studies.scenes import LADDER
from studies.scores import both_psnr, psnr
from studies.ways import DEFAULT, WITH_SCENE, minimum_over_angles, plain_intensity

NAME = "model_ladder"
KNOWN = "known"
MODELS = ("auto", "pixelwise", "ghosts", "perspective", "curved", "polarized", KNOWN)
"""Those of `polaropt.separate`, and the true scene given."""
QUICK_SIZE, SIZE = 128, 256
MOST_PAIRS = 4
"""On all families and models, that is 588 separations."""


@dataclass(frozen=True)
class Job(SceneJob):
    """One scene on one rung."""

    model: str = "auto"


@dataclass(frozen=True)
class Row:
    """One separation: PSNR in dB of the pixels that are not clipped, the rung taken and the seconds."""

    family: str
    pair: int
    model: str
    nothing: float
    transmission: float
    reflection: float
    rung: str
    adequate: bool
    seconds: float
    warnings: tuple[str, ...]


def run(job: Job) -> list[Row]:
    """Separate one scene on one rung."""
    sample = job.sample()
    way = WITH_SCENE if job.model == KNOWN else replace(DEFAULT, rung=job.model)
    result = way.separation(sample)
    row = Row(
        job.scene.family,
        job.pair,
        job.model,
        max(psnr(method(sample)[0], sample.layers[0]) for method in (plain_intensity, minimum_over_angles)),
        *both_psnr(result.layers, sample.layers, sample.unclipped),
        result.scene.rung,
        result.scene.rung == job.scene.rung,
        sum(result.seconds.values()),
        tuple(warning.name for warning in result.diagnostics.warnings),
    )
    return [row]


def tables(frame: DataFrame) -> str:
    """Means per family and model, and what the choice of a model costs."""
    cells = {
        "T nothing": mean("nothing"),
        "T": mean("transmission"),
        "R": mean("reflection"),
        "rungs taken": _rungs_taken,
        "s": mean("seconds"),
        "warned": lambda part: f"{n_with(part, 'warnings', 'MODEL_DOES_NOT_EXPLAIN')}/{len(part)}",
    }
    return f"{markdown(summary(frame, {'family': 'family', 'model': 'model'}, cells))}\n\n{cost_of_choice(frame)}"


def _rungs_taken(part: DataFrame) -> str:
    return ", ".join(f"{rung} {len(where(part, rung=rung))}" for rung in values_of(part, "rung"))


def cost_of_choice(frame: DataFrame) -> str:
    """How often the lowest adequate rung is taken, and what the choice costs against the best fixed one, at most."""
    auto = where(frame, model="auto")
    lines = [f"Lowest adequate rung taken: {auto.adequate.sum()} of {len(auto)} scenes."]
    for family in values_of(auto, "family"):
        levels = where(frame, family=family).groupby("model").transmission.mean()
        fixed = [model for model in MODELS if model not in ("auto", KNOWN) and model in levels]
        if fixed:
            best = max(fixed, key=levels.__getitem__)
            cost = levels["auto"] - levels[best]
            lines.append(f"{family}: auto {cost:+.2f} dB (T) against the best fixed rung, {best}.")
    return "\n\n".join(lines)


_MARKS = {
    KNOWN: ("|", "black", "scene known"),
    "auto": ("o", BLUE, "auto"),
    "pixelwise": ("v", SKY, "pixelwise"),
    "ghosts": ("s", ORANGE, "ghosts"),
    "perspective": ("D", GREEN, "perspective"),
    "curved": ("X", PURPLE, "curved"),
    "polarized": ("*", VERMILION, "polarized"),
    "none": ("x", "#999999", "none"),
}


def figures(frame: DataFrame) -> dict[str, Callable[[], Any]]:
    """What each rung makes of each family of scenes, beside doing nothing."""
    return {NAME: lambda: _rungs(frame)}


def _rungs(frame: DataFrame) -> Any:
    families = values_of(frame, "family")
    figure = new_figure(10, 0.34 * len(families) + 1.6)
    axis = figure.subplots()
    nothing = frame.groupby("family").nothing.mean()[families]
    places = np.arange(len(families))
    axis.barh(places, nothing, 0.8, color="#dddddd", label="doing nothing")
    for model, (marker, color, label) in _MARKS.items():
        levels = where(frame, model=model).groupby("family").transmission.mean().reindex(families, fill_value=math.nan)
        if np.isfinite(levels).any():
            chosen = model == "auto"
            axis.plot(
                levels, places, marker, color=color, label=label, zorder=3 if chosen else 4,
                markersize=11 if chosen else 6, markerfacecolor="none" if chosen else color,
                markeredgewidth=1.8 if chosen else 1,
            )  # fmt: skip
    axis.set_yticks(places, families)
    axis.invert_yaxis()
    axis.set_xlim(left=0.8 * nothing.min())
    axis.set_xlabel("PSNR of the transmission (dB), mean over the pairs")
    axis.grid(visible=False, axis="y")
    legend_below(figure, *axis.get_legend_handles_labels(), 5)
    return figure


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the study."""
    parser = study_parser(__doc__)
    parser.add_argument("--family", default="", help="Only families whose name contains this.")
    parser.add_argument("--models", help=f"Names, comma separated, of: {', '.join(MODELS)} (quick: auto).")
    options = parser.parse_args(arguments)
    quick = effort_of(options) == "quick"
    size = QUICK_SIZE if quick else SIZE
    models = (options.models or ("auto" if quick else ",".join(MODELS))).split(",")
    jobs = [
        Job(scene, pair, options.photos, size, model)
        for scene in LADDER
        if options.family in scene.family
        for model in models
        for pair in range(n_pairs_of(options, 1 if quick else MOST_PAIRS, size))
    ]
    frame = run_study(NAME, run, jobs, Row, options)
    publish(NAME, options, tables(frame), figures(frame))


if __name__ == "__main__":
    main()
