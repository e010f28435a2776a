"""Which rung of the ladder is taken on each family of scenes, and what it costs against the best fixed one.

Run ``python -m studies.model_ladder --photos DIR``; without ``--photos`` it uses photographs inside scikit-image.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from polaropt.capture import Capture
from polaropt.scene import SceneParameters, ghost_step
from polaropt.separation import Separation, separate
from polaropt.simulation import ANGLES_DEG, digitized, exact_photographs, stack_layers
from studies.paper_protocol import trivial_psnr
from studies.protocol import (
    BITS,
    EVALUATION_BORDER,
    NOISE,
    REFRACTIVE_INDEX,
    THICKNESS_PX,
    Pair,
    protocol_pairs,
    shipped_pairs,
)
from studies.record import write_study

MODELS = ("auto", "pixelwise", "ghosts", "perspective", "curved", "polarized", "known")
"""Those of `polaropt.separate`, and the true scene told."""
MOST_BENT_DEG = 8.0
"""From the middle to the end of the frame's longer side."""
CLIPPED = 0.05
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


def _polarized(screen: float, sky: float) -> Callable[[int, np.random.Generator], SceneParameters]:
    """The scenes with ghosts at 60 degrees, their layers' light polarized so much, at any angle."""

    def scene(size: int, random: np.random.Generator) -> SceneParameters:
        plain = _ghosts(60)(size, random)
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
    capture = Capture(seen, ANGLES_DEG)
    unclipped = capture.valid.all(axis=(0, 1))
    if family.headroom:
        high = pair.cropped(noisy)
        capture = Capture(np.where(capture.valid, seen, high), ANGLES_DEG, np.ones_like(capture.valid))
    return capture, (pair.cropped(layers[0]), pair.cropped(layers[1])), unclipped


def run(family: Family, pair: Pair, model: str) -> Row:
    """Separate one scene on one rung."""
    capture, layers, unclipped = family_capture(family, pair)
    told = family.true_scene(pair) if model == "known" else family.told
    result = separate(capture, told, model="auto" if model == "known" else model)
    return Row(
        family.name,
        pair.number,
        model,
        max(trivial_psnr(capture, np.moveaxis(layers[0], 0, -1))),
        *quality(result, layers, unclipped),
        result.scene.rung,
        result.scene.rung == family.rung,
        sum(result.seconds.values()),
        tuple(warning.name for warning in result.diagnostics.warnings),
    )


def quality(result: Separation, layers: Layers, unclipped: Mask) -> tuple[float, float]:
    """PSNR of both layers over the pixels that no photograph clips."""
    inner = (..., *(slice(EVALUATION_BORDER, -EVALUATION_BORDER),) * 2)
    error = np.square(result.layers - np.stack(layers))[inner][..., unclipped[inner]].mean(axis=(1, 2))
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


def main() -> None:
    """Print the table and write it with all rows."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--photos", type=Path, help="folder of photographs (default: those inside scikit-image)")
    parser.add_argument("--pairs", type=int, default=12, help="pairs at most")
    parser.add_argument("--family", default="", help="only families whose name contains this")
    parser.add_argument("--models", default=",".join(MODELS), help="names, comma separated")
    parser.add_argument("-o", "--out", type=Path, help="folder for table and rows (JSON, CSV)")
    options = parser.parse_args()
    families = [family for family in FAMILIES if options.family in family.name]
    pairs = (shipped_pairs() if options.photos is None else protocol_pairs(options.photos))[: options.pairs]
    models = options.models.split(",")
    rows = [run(family, pair, model) for family in families for model in models for pair in pairs]
    print(table(rows))
    if options.out:
        photos = None if options.photos is None else str(options.photos)
        asked = {"photos": photos, "models": models, "pairs": len(pairs)}
        write_study(options.out, "model_ladder", asked, rows, table(rows))


if __name__ == "__main__":
    main()
