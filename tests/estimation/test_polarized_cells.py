"""Light that arrives polarized before a polarization camera: what its cells show, though fine detail aliases there."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from polaropt import SceneParameters, estimate
from polaropt.capture import StokesImages
from polaropt.estimation.rung import Evidence
from polaropt.estimation.wide.blocks import PolarizedBlocks
from polaropt.numerics import turn_between
from polaropt.simulation import Camera, photograph_mosaic, simulated_mosaic
from studies.photographs import pairs_of

NOISE, SIDE = 0.002, 192
OPEN = SceneParameters(None, None, None)


def test_a_polarized_screen_behind_a_pane_is_found_though_it_aliases() -> None:
    """A plain pane across explained as much in units of what aliases, and exchanged the layers."""
    photographs, camera = pairs_of(None, 256)[0], Camera(noise=0.003, lens_blur_px=0.5)
    scene = SceneParameters(60.0, 170.0, 6.0, transmission_polarization=(0.42, 82.0))
    raw = photograph_mosaic(photographs.transmission, photographs.reflection, scene, camera, False)
    found = estimate(simulated_mosaic(raw, False), OPEN)
    degree, angle = found.scene.transmission_polarization
    assert degree == pytest.approx(0.42, abs=0.03)
    assert abs(turn_between(angle, 82.0, 180.0)) < 2
    assert abs(turn_between(found.scene.values()[1], 170.0, 180.0)) < 1
    assert found.scene.values()[0] == pytest.approx(60.0, abs=1.5)
    # It explains all: no lens, and no bent pane, is looked for.
    assert {rung.rung for rung in found.tried} == {"ghosts", "polarized"}


def coarse_light(vectors: NDArray[np.float64], seed: int) -> NDArray[np.float64]:
    """Images of two layers without detail that show these Stokes vectors, (3, 1, side, side)."""
    rng = np.random.default_rng(seed)
    down, right = np.pi * np.indices((SIDE, SIDE)) / SIDE
    waves = np.stack([np.cos(i * down) * np.cos(j * right) for i in range(4) for j in range(4)])
    layers = np.einsum("lk,kyx->lyx", rng.uniform(-0.2, 0.2, (2, len(waves))), waves) + 0.5
    return np.einsum("li,lyx->iyx", vectors, layers)[:, None]


def stokes_of(images: NDArray[np.float64], seed: int, aliases: float = 0.0) -> StokesImages:
    """With white noise, and with as strong aliases as that, which are white as well."""
    rng = np.random.default_rng(seed + 1)
    spread = np.array([NOISE, *2 * [np.hypot(NOISE, aliases)]])[:, None, None, None]
    seen = images + spread * rng.standard_normal(images.shape)
    covariance = NOISE**2 * np.eye(3)
    return StokesImages(seen.astype(np.float32), covariance, np.ones(seen.shape[1:], bool), aliases > 0)


@given(
    degrees=st.tuples(*2 * [st.floats(0.1, 0.9)]),
    angles=st.tuples(st.floats(0.0, 60.0), st.floats(90.0, 150.0)),
    aliases=st.sampled_from([0.0, 0.01]),
    seed=st.integers(0, 9),
)
def test_two_layers_leave_nothing_beside_the_plane_of_what_they_show(
    degrees: tuple[float, float], angles: tuple[float, float], aliases: float, seed: int
) -> None:
    twice = 2 * np.radians(angles)
    vectors = np.stack([np.ones(2), degrees * np.cos(twice), degrees * np.sin(twice)], axis=1)
    blocks = PolarizedBlocks(stokes_of(coarse_light(vectors, seed), seed, aliases))
    # Strong light that changes from block to block counts among what aliases.
    assert (0.3 if aliases else 0.7) < blocks.plane_misfit(vectors) < 1.3
    assert blocks.plane_misfit(vectors[::-1] * [[2.0], [0.3]]) == pytest.approx(blocks.plane_misfit(vectors))
    off = np.cross(*vectors)
    first = vectors[0] + 0.2 * off / np.linalg.norm(off)
    assert blocks.plane_misfit(np.stack([first, vectors[1]])) > 2


def evidence_of(stokes: StokesImages, azimuth_deg: float) -> Evidence:
    blocks, anything = PolarizedBlocks(stokes), SimpleNamespace()
    plain: Any = SimpleNamespace(scene=SceneParameters(50.0, azimuth_deg, 0.0))
    misfit = blocks.constant_misfit(azimuth_deg)
    return Evidence(anything, NOISE, stokes, blocks, OPEN, plain, misfit, "auto")  # type: ignore[arg-type]


@pytest.mark.parametrize(("across", "explained"), [(0.0, True), (0.02, False)])
def test_large_blocks_show_light_across_that_small_ones_count_as_aliases(across: float, explained: bool) -> None:
    vectors = np.array([[1.0, 0.1, across], [1.0, -0.4, -across]])
    evidence = evidence_of(stokes_of(coarse_light(vectors, 3), 3, aliases=0.05), 0.0)
    assert evidence.misfit < evidence.most_unexplained
    assert evidence.explained is explained
    assert (evidence.most_shown > evidence.misfit + 0.5) is not explained


def test_photographs_have_no_aliases_to_look_beneath() -> None:
    evidence = evidence_of(stokes_of(coarse_light(np.array([[1.0, 0.1, 0.0], [1.0, -0.4, 0.0]]), 5), 5), 0.0)
    assert evidence.explained
    assert evidence.most_shown == evidence.misfit
