"""Things that are polarized each by itself do not tell the pane: the rest of the frame does."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from polaropt import Capture, SceneParameters, estimate, separate
from polaropt.capture import ANGLES_DEG, closure_share, stokes_images
from polaropt.estimation.polarized_things import PolarizedThings, polarized_things
from polaropt.estimation.wide.blocks import PolarizedBlocks
from polaropt.judging import SeparationWarning
from polaropt.numerics import turn_between
from polaropt.simulation import dead_leaves, digitized, exact_engine, psnr_db

SIDE_PX, NOISE, THINGS_PX = 144, 0.004, 12.0
# Of one clear pane.
BLIND = SceneParameters(None, None, None)


@dataclass(frozen=True)
class Blend:
    """A capture with things behind the pane that are polarized, all in one direction."""

    capture: Capture
    scene: SceneParameters
    layers: NDArray[np.float32]
    things: NDArray[np.bool_]

    @property
    def blocks(self) -> PolarizedBlocks:
        return PolarizedBlocks(stokes_images(self.capture, NOISE))


@cache
def pictures() -> NDArray[np.float32]:
    """Layers of leaves, (2, 3, h, w)."""
    layers = np.stack([np.moveaxis(dead_leaves(SIDE_PX, number), -1, 0) for number in (3, 8)])
    soft = gaussian_filter(layers.astype(np.float32), (0, 0, 0.7, 0.7)) * np.float32(0.8)
    soft.flags.writeable = False
    return soft


def with_things(incidence_deg: float, dolp: float, direction_deg: float = 20.0, *, share: float = 0.4) -> Blend:
    """A share of the frame is polarized, wherever the edges of the scene are."""
    layers = pictures()
    scene = SceneParameters(incidence_deg, 70.0, 3.0)
    engine = exact_engine(scene, ANGLES_DEG)
    random = np.random.default_rng(4)
    field = gaussian_filter(random.standard_normal((SIDE_PX, SIDE_PX)), THINGS_PX)
    things = field > np.quantile(field, 1 - share)
    cosines = np.cos(2 * np.radians(np.subtract(ANGLES_DEG, direction_deg)))
    extra = dolp * gaussian_filter(things.astype(float), 1.0) * engine.components(layers)[0].mean(axis=0)
    light = engine.forward(layers) + np.multiply.outer(cosines, extra)
    photographs = digitized(light + NOISE * random.standard_normal(light.shape), 12).astype(np.float32)
    return Blend(Capture.of_planes(photographs, ANGLES_DEG), scene, layers, things)


def things_of(blend: Blend) -> PolarizedThings | None:
    capture = blend.capture
    return polarized_things(blend.blocks, closure_share(capture.intensities, capture.angles_deg, capture.mask))


@pytest.mark.parametrize("incidence_deg", [40.0, 55.0, 70.0])
@pytest.mark.parametrize("dolp", [0.05, 0.15])
def test_the_frame_agrees_on_the_axis_beside_the_things(incidence_deg: float, dolp: float) -> None:
    blend = with_things(incidence_deg, dolp)
    found = things_of(blend)
    assert found is not None
    assert abs(turn_between(found.azimuth_deg, blend.scene.values()[1], 90.0)) < 0.5
    assert np.mean(found.where[blend.things]) > 0.7
    assert np.mean(found.where[~blend.things]) < 0.35


def test_without_things_nothing_is_left_out() -> None:
    blend = with_things(55.0, 0.0)
    assert things_of(blend) is None


def test_where_nearly_all_is_polarized_nothing_is_left_out() -> None:
    blend = with_things(55.0, 0.2, share=0.95)
    assert things_of(blend) is None


@pytest.mark.parametrize(("incidence_deg", "dolp"), [(60.0, 0.06)])
def test_the_pane_is_found_beside_things(incidence_deg: float, dolp: float) -> None:
    """Which exchanged both layers, or turned the pane by tens of degrees."""
    blend = with_things(incidence_deg, dolp, direction_deg=115.0)
    found, told = separate(blend.capture, BLIND), separate(blend.capture, blend.scene)
    assert found.scene.values()[0] == pytest.approx(incidence_deg, abs=2)
    assert abs(turn_between(found.scene.values()[1], blend.scene.values()[1], 180.0)) < 1
    truth = np.moveaxis(blend.layers[0], 0, -1)
    assert psnr_db(found.transmission, truth) > psnr_db(told.transmission, truth) - 1
    assert SeparationWarning.POLARIZED_SOURCE in found.diagnostics.warnings
    assert any("polarized by themselves" in rung.reason for rung in found.tried if rung.taken)


def test_a_given_azimuth_is_kept() -> None:
    blend = with_things(55.0, 0.1, direction_deg=115.0)
    found = estimate(blend.capture, blend.scene.replace(incidence_deg=None, ghost_shift=None))
    assert found.scene.azimuth_deg == blend.scene.azimuth_deg
    assert not any("polarized by themselves" in rung.reason for rung in found.tried)
