"""The incidence before what has no edges: a dark room, a blank wall, the sky; only what is mirrored shows some."""

from __future__ import annotations

import numpy as np
import pytest

from polaropt import SceneParameters, estimate, separate
from polaropt.capture import Capture, noise_level, planes_first, plate_frame, stokes_images
from polaropt.estimation.flat.lone_edges import mirrored_incidences
from polaropt.estimation.refractive_index import likelier_index
from polaropt.simulation import Camera, photograph_pair
from studies.photographs import pairs_of
from studies.scores import psnr

NOISE, AZIMUTH_DEG = 0.004, 25.0


def wall(brightness: float, shaded: float = 0.0) -> np.ndarray:
    """A wall of 192 px and its surroundings, on which light may fall off from the left to the right."""
    size = pairs_of(None, 192)[0].transmission.shape
    return np.broadcast_to(brightness * (1 - shaded * np.linspace(0, 1, size[1]))[:, None], size).copy()


def taken(
    scene: SceneParameters, behind: np.ndarray | None, *, mirrors: np.ndarray | None = None, pair: int = 0
) -> Capture:
    photographs = pairs_of(None, 192)[pair]
    behind = photographs.transmission if behind is None else behind
    mirrors = photographs.reflection if mirrors is None else mirrors
    return photograph_pair(behind, mirrors, scene, Camera(noise=NOISE), margin=photographs.margin)


def told(capture: Capture, scene: SceneParameters) -> list[float]:
    frame = plate_frame(stokes_images(capture, noise_level(capture)), scene.azimuth_deg)
    return [one.incidence_deg for one in mirrored_incidences(frame, scene)]


@pytest.mark.parametrize("pair", [0, 2])
@pytest.mark.parametrize(("brightness", "shaded"), [(0.5, 0.0), (0.8, 0.4)])
@pytest.mark.parametrize("incidence_deg", [34.0, 45.0, 66.0, 74.0])
def test_mirrored_edges_tell_the_incidence_before_a_wall(
    incidence_deg: float, brightness: float, shaded: float, pair: int
) -> None:
    scene = SceneParameters(incidence_deg, AZIMUTH_DEG, 0.0)
    first, second = told(taken(scene, wall(brightness, shaded), pair=pair), scene)
    assert first == pytest.approx(incidence_deg, abs=0.5)
    # On the other side of Brewster's angle, 56.3 degrees.
    assert (first - 56.3) * (second - 56.3) < 0


@pytest.mark.parametrize("shift", [0.0, 6.0])
@pytest.mark.parametrize("incidence_deg", [38.0, 68.0])
def test_before_a_dark_room_either_pane_may_be_the_true_one_and_the_error_says_so(
    incidence_deg: float, shift: float
) -> None:
    scene = SceneParameters(incidence_deg, AZIMUTH_DEG, shift)
    found = estimate(taken(scene, wall(0.0)))
    panes = [found.scene, *(rival.scene for rival in found.estimate.rivals)]
    assert len(panes) == 2
    assert min(abs(pane.incidence_deg - incidence_deg) for pane in panes) < 0.5
    assert abs(found.scene.incidence_deg - incidence_deg) < 3 * found.errors.incidence_deg
    assert sum("All edges are mirrored ones" in rung.reason for rung in found.tried if rung.taken) == 1


def test_a_wall_behind_one_pane_is_not_behind_several_and_is_seen_without_what_is_mirrored() -> None:
    scene, behind = SceneParameters(64.7, AZIMUTH_DEG, 0.0), wall(0.5, 0.3)
    capture, margin = taken(scene, behind), pairs_of(None, 192)[0].margin
    result = separate(capture)
    assert (result.scene.n_panes, result.scene.absorption) == (1, 0.0)
    assert result.scene.incidence_deg == pytest.approx(64.7, abs=0.5)
    seen = behind[margin:-margin, margin:-margin]
    assert psnr(planes_first(result.transmission), planes_first(seen)) > 45


@pytest.mark.parametrize("incidence_deg", [40.0, 70.0])
def test_where_both_layers_or_only_what_is_behind_have_edges_nothing_is_told(incidence_deg: float) -> None:
    scene = SceneParameters(incidence_deg, AZIMUTH_DEG, 0.0)
    assert not told(taken(scene, None), scene)
    assert not told(taken(scene, None, mirrors=wall(0.5)), scene)
    assert not told(taken(scene, wall(0.5), mirrors=wall(0.3)), scene)


def test_one_layer_s_edges_tell_no_index() -> None:
    scene = SceneParameters(62.0, AZIMUTH_DEG, 0.0, refractive_index=1.7)
    capture = taken(scene, wall(0.5))
    assert likelier_index(capture, scene.replace(refractive_index=1.5, incidence_deg=60.0), NOISE) is None
