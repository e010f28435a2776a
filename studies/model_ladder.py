"""Which rung of the ladder is taken on each family of scenes, and what it costs against the best fixed one.

Run ``polaropt study model_ladder -o OUT``; without ``--photos`` it uses photographs inside scikit-image.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from polaropt.capture import ANGLES_DEG, Capture
from polaropt.optics import SceneParameters, ghost_step
from polaropt.separation import separate
from polaropt.simulation import digitized, exact_photographs, stack_layers
from studies.command import effort_of, hands_of, n_pairs_of, pairs_of, study_parser
from studies.model_ladder_figure import draw
from studies.paper_protocol import trivial_psnr
from studies.protocol import (
    BITS,
    EVALUATION_BORDER,
    NOISE,
    REFRACTIVE_INDEX,
    THICKNESS_PX,
    Pair,
)
from studies.record import write_tables
from studies.work import row_of, run_jobs

MODELS = ("auto", "pixelwise", "ghosts", "perspective", "curved", "polarized", "known")
"""Those of `polaropt.separate`, and the true scene told."""
MOST_BENT_DEG = 8.0
"""From the middle to the end of the frame's longer side."""
CLIPPED = 0.05
QUICK_SIZE, SIZE = 128, 256
# On all families and models, that is 504 separations.
MOST_PAIRS = 4
Layers = tuple[np.ndarray, np.ndarray]
Mask = np.ndarray
_HALF_VIEW = math.tan(math.radians(22.5))


BLIND = SceneParameters(None, None, None)


@dataclass(frozen=True)
class Family:
    """Scenes of one kind.

    Attributes
    ----------
    name : str
    rung : str
        The lowest adequate one.
    scene : callable
        From the pair's size and a random generator to the true scene.
    told : SceneParameters
        What the software is told of it; None is estimated.
    clipped : float
        Share of the pixels that some photograph clips.
    headroom : bool
        The sensor shows what is brighter than white, too; figures are of the same pixels.
    """

    name: str
    rung: str
    scene: Callable[[int, np.random.Generator], SceneParameters]
    told: SceneParameters = BLIND
    clipped: float = 0.0
    headroom: bool = False

    def true_scene(self, pair: Pair) -> SceneParameters:
        """The scene of a pair."""
        size = pair.cropped(pair.transmission).shape[0]
        return self.scene(size, np.random.default_rng(pair.number))


def _ghosts(
    incidence_deg: float, index: float = REFRACTIVE_INDEX
) -> Callable[[int, np.random.Generator], SceneParameters]:
    shift = ghost_step(incidence_deg, index, THICKNESS_PX, "paper")
    return lambda size, random: SceneParameters(incidence_deg, float(random.uniform(0, 180)), shift, index)


def _in_place(incidence_deg: float) -> Callable[[int, np.random.Generator], SceneParameters]:
    return lambda size, random: SceneParameters(incidence_deg, float(random.uniform(0, 180)), 0.0)


def _wide(size: int, random: np.random.Generator) -> SceneParameters:
    return SceneParameters(55.0, float(random.uniform(0, 360)), 0.0, focal_px=size / 2 / _HALF_VIEW)


def _bent(size: int, random: np.random.Generator) -> SceneParameters:
    b_xx, b_xy, b_yy = random.uniform(-MOST_BENT_DEG, MOST_BENT_DEG, 3) / (size / 2)
    return _wide(size, random).replace(bend_deg_per_px=(float(b_xx), float(b_xy), float(b_yy)))


def _wide_with_ghosts(size: int, random: np.random.Generator) -> SceneParameters:
    return _wide(size, random).replace(ghost_shift=ghost_step(55, REFRACTIVE_INDEX, THICKNESS_PX, "paper"))


def _water(size: int, random: np.random.Generator) -> SceneParameters:
    return SceneParameters(60.0, float(random.uniform(0, 180)), 0.0, 1.33, single_surface=True)


def _polarized(
    screen: float, sky: float, pane: Callable[[int, np.random.Generator], SceneParameters] | None = None
) -> Callable[[int, np.random.Generator], SceneParameters]:
    """Scenes of a pane (default: with ghosts at 60 degrees), their layers' light polarized so much, at any angle."""

    def scene(size: int, random: np.random.Generator) -> SceneParameters:
        plain = (pane or _ghosts(60))(size, random)
        behind, mirrored = (float(angle) for angle in random.uniform(0, 180, 2))
        return plain.replace(
            transmission_polarization=(screen, behind if screen else 0.0),
            reflection_polarization=(sky, mirrored if sky else 0.0),
        )

    return scene


SCREEN, SKY = 0.6, 0.3
"""Degrees of polarization of a screen behind the glass and of the sky that it mirrors."""
WATER = SceneParameters(None, None, None, 1.33, single_surface=True)
FAMILIES = (
    Family("in place, 60 deg", "pixelwise", _in_place(60)),
    Family("ghosts, 40 deg", "ghosts", _ghosts(40)),
    Family("ghosts, 70 deg", "ghosts", _ghosts(70)),
    Family("wide lens, 45 deg of view", "perspective", _wide),
    Family("wide lens with ghosts", "perspective", _wide_with_ghosts),
    Family("bent pane, 45 deg of view", "curved", _bent),
    Family("water, single surface", "pixelwise", _water, WATER),
    Family("index 1.6 told as 1.5", "ghosts", _ghosts(60, 1.6)),
    Family("ghosts, 60 deg", "ghosts", _ghosts(60)),
    *(
        Family(f"ghosts, {angle} deg, 5 % {how}", "ghosts", _ghosts(angle), clipped=CLIPPED, headroom=headroom)
        for angle in (40, 60, 80)
        for how, headroom in (("beyond white but seen", True), ("clipped", False))
    ),
    Family("screen behind", "polarized", _polarized(SCREEN, 0)),
    Family("sky reflected", "polarized", _polarized(0, SKY)),
    Family("screen and sky", "polarized", _polarized(SCREEN, SKY)),
    Family("wide lens, screen behind", "polarized", _polarized(SCREEN, 0, _wide)),
    Family("wide lens, sky reflected", "polarized", _polarized(0, SKY, _wide)),
    Family("wide lens with ghosts, screen and sky", "polarized", _polarized(SCREEN, SKY, _wide_with_ghosts)),
)


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


def family_capture(family: Family, pair: Pair) -> tuple[Capture, Layers, Mask]:
    """Photographs of a pair on the frame, both layers (channel, h, w), and the pixels (h, w) that figures are of."""
    scene = family.true_scene(pair)
    layers = stack_layers(pair.transmission, pair.reflection)
    exact = exact_photographs(layers, scene, ANGLES_DEG)
    if family.clipped:
        exposure = 1 / np.quantile(pair.cropped(exact).max(axis=(0, 1)), 1 - family.clipped)
        layers, exact = layers * np.float32(exposure), exact * np.float32(exposure)
    noisy = exact + NOISE * np.random.default_rng(pair.number).standard_normal(exact.shape)
    seen = pair.cropped(digitized(noisy, BITS))
    capture = Capture.of_planes(seen, ANGLES_DEG)
    unclipped = capture.valid.all(axis=(0, 1))
    if family.headroom:
        high = pair.cropped(noisy)
        capture = Capture.of_planes(np.where(capture.valid, seen, high), ANGLES_DEG, np.ones_like(capture.valid))
    return capture, (pair.cropped(layers[0]), pair.cropped(layers[1])), unclipped


@dataclass(frozen=True)
class Job:
    """One scene on one rung."""

    photos: str | None
    family: str
    model: str
    pair: int
    size: int


def run(job: Job) -> list[Row]:
    """Separate one scene on one rung."""
    (family,) = [family for family in FAMILIES if family.name == job.family]
    pair, model = pairs_of(job.photos, job.size, job.size // 2)[job.pair], job.model
    capture, layers, unclipped = family_capture(family, pair)
    told = family.true_scene(pair) if model == "known" else family.told
    result = separate(capture, told, model="auto" if model == "known" else model)
    row = Row(
        family.name,
        pair.number,
        model,
        max(trivial_psnr(capture, np.moveaxis(layers[0], 0, -1))),
        *quality(result.layers, layers, unclipped),
        result.scene.rung,
        result.scene.rung == family.rung,
        sum(result.seconds.values()),
        tuple(warning.name for warning in result.diagnostics.warnings),
    )
    return [row]


def quality(found: np.ndarray, layers: Layers, unclipped: Mask) -> tuple[float, float]:
    """PSNR of both layers (2, channel, h, w) over the pixels that no photograph clips."""
    inner = (..., *(slice(EVALUATION_BORDER, -EVALUATION_BORDER),) * 2)
    error = np.square(found - np.stack(layers))[inner][..., unclipped[inner]].mean(axis=(1, 2))
    return float(-10 * np.log10(error[0])), float(-10 * np.log10(error[1]))


def table(rows: Sequence[Row]) -> str:
    """Means per family and model, as a Markdown table."""
    lines = ["| family | model | T nothing | T | R | rungs taken | s | warned |", "|" + "---|" * 8]
    for family, model in dict.fromkeys((row.family, row.model) for row in rows):
        part = [row for row in rows if (row.family, row.model) == (family, model)]
        rungs = [row.rung for row in part]
        taken = ", ".join(f"{rung} {rungs.count(rung)}" for rung in dict.fromkeys(rungs))
        means = [np.mean([getattr(row, name) for row in part]) for name in ("nothing", "transmission", "reflection")]
        warned = sum("MODEL_DOES_NOT_EXPLAIN" in row.warnings for row in part)
        lines.append(
            f"| {family} | {model} | "
            + " | ".join(f"{mean:.2f}" for mean in means)
            + f" | {taken} | {np.mean([row.seconds for row in part]):.2f} | {warned}/{len(part)} |"
        )
    return "\n".join(lines)


def summary(rows: Sequence[Row]) -> str:
    """How often the lowest adequate rung is taken, and what the choice costs against the best fixed one, at most."""
    auto = [row for row in rows if row.model == "auto"]
    lines = [f"Lowest adequate rung taken: {sum(row.adequate for row in auto)} of {len(auto)} scenes."]
    for family in dict.fromkeys(row.family for row in auto):

        def mean(model: str, family: str = family) -> float:
            part = [row.transmission for row in rows if (row.family, row.model) == (family, model)]
            return float(np.mean(part)) if part else -math.inf

        best = max((model for model in MODELS[1:-1]), key=mean)
        if mean(best) > -math.inf:
            lines.append(f"{family}: auto {mean('auto') - mean(best):+.2f} dB (T) against the best fixed rung, {best}.")
    return "\n\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table and write it with all rows."""
    parser = study_parser(__doc__)
    parser.add_argument("--family", default="", help="only families whose name contains this")
    parser.add_argument("--models", help=f"names, comma separated, of: {', '.join(MODELS)} (quick: auto)")
    options = parser.parse_args(arguments)
    quick = effort_of(options) == "quick"
    size = QUICK_SIZE if quick else SIZE
    models = (options.models or ("auto" if quick else ",".join(MODELS))).split(",")
    jobs = [
        Job(options.photos, family.name, model, pair, size)
        for family in FAMILIES
        if options.family in family.name
        for model in models
        for pair in range(n_pairs_of(options, 1 if quick else MOST_PAIRS, size, size // 2))
    ]
    made = run_jobs(run, jobs, options.out / "model_ladder.json", {}, hands_of(options))
    rows = [row_of(Row, row) for row in made]
    text = f"{table(rows)}\n\n{summary(rows)}"
    print(text)
    write_tables(options.out, "model_ladder", made, text)
    draw(rows, options.out)


if __name__ == "__main__":
    main()
