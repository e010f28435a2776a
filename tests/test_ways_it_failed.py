"""Ways in which it failed before: each is now at least as good as doing nothing, or says what is wrong."""

from __future__ import annotations

import math
from functools import lru_cache

import pytest

from polaropt import SceneParameters, Separation, SeparationWarning, estimate, separate
from polaropt.capture import match_photographs, noise_level
from polaropt.estimation.flat.estimate import estimate_scene
from polaropt.numerics import turn_between
from polaropt.simulation.metrics import psnr_db
from studies.camera import Sample, photograph
from studies.photographs import Pair, shipped_pairs
from studies.random_windows.judging import SAYS_NOTHING, WORSE_DB
from studies.random_windows.windows import window_of
from studies.scenes import Taking
from studies.scores import psnr
from studies.ways import minimum_over_angles, plain_intensity
from tests.blends import blend


@lru_cache(maxsize=2)
def pairs(size: int) -> list[Pair]:
    return shipped_pairs(size, 64)


def photographed(pair: int, scene: SceneParameters, told_index: float = 1.5, *, size: int = 128, **taking) -> Sample:
    """Photographs that ship with scikit-image behind a pane of which the index is told."""
    hint = SceneParameters(None, None, None, told_index)
    return photograph(pairs(size)[pair], scene, Taking(below_white=True, **taking), hint)


def found_or_announced(sample: Sample, result: Separation | None = None) -> float:
    """How many dB better than doing nothing the transmission is: not less than none, or it is said what is wrong.

    Default: it is told that there is one clear pane.
    """
    result = result or separate(sample.capture, sample.hint)
    true, seen = sample.layers[0], sample.unclipped
    nothing = max(psnr(way(sample)[0], true, seen) for way in (plain_intensity, minimum_over_angles))
    gain = psnr(result.layers[0], true, seen) - nothing
    announced = {warning.name for warning in result.diagnostics.warnings} - SAYS_NOTHING
    assert gain >= -WORSE_DB or announced
    return gain


def off_deg(found: SceneParameters, azimuth_deg: float) -> float:
    return abs(turn_between(found.values()[1], azimuth_deg))


def test_steep_glass_with_double_images_far_apart_is_no_pane_across() -> None:
    """Both layers were exchanged, at 64 degrees and 90 degrees beside the azimuth, without a word."""
    sample = photographed(3, SceneParameters(84.6, 24.0, 16.0), noise=0.004, reflection_gain=2.5)
    result = separate(sample.capture, sample.hint)
    assert result.scene.incidence_deg == pytest.approx(84.6, abs=0.5)
    assert off_deg(result.scene, 24.0) < 1
    assert SeparationWarning.AXIS_DOUBTFUL not in result.diagnostics.warnings
    assert psnr(result.layers[0], sample.layers[0]) > psnr(plain_intensity(sample)[0], sample.layers[0]) + 10


def test_a_reflection_ten_times_as_bright_hides_no_steep_pane() -> None:
    """One of 39 degrees was found, tinted."""
    sample = photographed(3, SceneParameters(72.0, 110.0, 4.0), size=256, noise=0.005, reflection_gain=10.0)
    assert estimate_scene(sample.capture, sample.hint).scene.incidence_deg == pytest.approx(72, abs=0.5)


@pytest.fixture(scope="module")
def bright() -> tuple[Sample, Separation]:
    """A reflection ten times as bright at Brewster's angle, separated blind."""
    sample = photographed(1, SceneParameters(57.0, 110.0, 4.0), noise=0.005, reflection_gain=10.0)
    return sample, separate(sample.capture)


def test_nor_is_it_left_in_the_transmission(bright: tuple[Sample, Separation]) -> None:
    """At Brewster's angle twice the minimum over all polarizer angles is free of it, too: 41 dB."""
    assert found_or_announced(*bright) > 0


def test_a_bright_reflection_at_brewsters_angle_does_not_hide_the_incidence(bright: tuple[Sample, Separation]) -> None:
    """Of whatever pane it may be: 62.3 degrees were found, and the transmission was worse than doing nothing."""
    _, found = bright
    assert found.scene.values()[0] == pytest.approx(57.0, abs=1.0)
    assert found.errors.incidence_deg < 2


def test_in_strong_noise_an_axis_that_edges_alone_tell_is_doubted() -> None:
    """Without double images at 80 degrees the layers were exchanged in silence."""
    found_or_announced(photographed(2, SceneParameters(79.6, 110.0, 0.0), noise=0.02))


SCREEN, SKY = {"transmission_polarization": (0.5, 80.0)}, {"reflection_polarization": (0.4, 20.0)}
MIXES = {
    "dense glass before a screen, clipped, of 8 bits": (
        0, SceneParameters(45.0, 30.0, 4.0, 1.7, **SCREEN), 1.7, {"clipped": 0.05, "bits": 8}
    ),
    "an index told wrongly before a screen, clipped, of 8 bits": (
        3, SceneParameters(60.0, 110.0, 6.0, 1.6, **SCREEN), 1.5, {"clipped": 0.05, "bits": 8}
    ),
    "thin glass mirrors the sky, much clipped, of 8 bits": (
        2, SceneParameters(60.0, 110.0, 6.0, 1.4, **SKY), 1.4, {"clipped": 0.1, "bits": 8}
    ),
}  # fmt: skip


@pytest.mark.parametrize("mix", MIXES)
def test_several_things_at_once(mix: str) -> None:
    pair, scene, told, taking = MIXES[mix]
    assert found_or_announced(photographed(pair, scene, told, noise=0.005, **taking)) > 3


def test_double_images_lie_on_the_side_that_takes_them_out_of_the_reflection() -> None:
    """They were doubled again: the reflection lost 5 dB without a word."""
    window = window_of(218, 256)
    sample = window.sample(None, 256)
    found = estimate(sample.capture, window.hint)
    along = math.cos(math.radians(found.scene.azimuth_deg - window.scene.azimuth_deg))
    assert found.scene.ghost_shift * round(along) == pytest.approx(window.scene.ghost_shift, abs=0.5)
    assert found.errors.ghost_shift < 1


@pytest.mark.parametrize("color", [False, True])
def test_photographs_without_any_noise(color: bool) -> None:
    # As a renderer makes them: their rounding was taken for blurs, and no noise at all was left.
    made = blend(60, 112, color=color, noise=0.0)
    result = separate(made.capture, SceneParameters(None, None, None))
    assert result.matching is None
    assert psnr_db(result.layers[0], made.layers[0], 16) > 70
    assert psnr_db(result.layers[1], made.layers[1], 16) > 35


def test_double_images_in_hardly_any_noise_are_no_polarized_light() -> None:
    """Nor layers that moved between the photographs, as was found: pictures leave more unexplained than such noise."""
    sample = photographed(0, SceneParameters(50.0, 30.0, 5.0), size=96, noise=0.0, bits=16)
    found = estimate(sample.capture, sample.hint).scene
    assert found.rung == "ghosts"
    assert found.values() == pytest.approx((50, 30, 5), abs=0.5)
    sample = photographed(0, SceneParameters(45.0, 30.0, 6.0), noise=0.0, bits=16)
    assert match_photographs(sample.capture, noise_level(sample.capture)) is None
