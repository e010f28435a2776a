"""The side of double images, by the edges that they leave in the layers."""

from __future__ import annotations

import dataclasses

import pytest

from polaropt import SceneParameters
from polaropt.estimation import LadderResult, SceneEstimate, find_scene, ghost_side
from polaropt.estimation.ghost_side import with_likelier_side
from polaropt.solving import edges_of_layers
from tests.blends import blend

NOISE = 0.005


def edges(example):
    return lambda scene: sum(edges_of_layers(example.capture, scene, noise=NOISE))


def estimate_of(example, scene: SceneParameters, **changes) -> LadderResult:
    """What was found of a capture, as if another scene had been."""
    found = find_scene(example.capture, SceneParameters(None, None, None), NOISE)
    assert isinstance(found.estimate, SceneEstimate)
    estimate = dataclasses.replace(found.estimate, scene=scene, **changes)
    return LadderResult(scene, estimate, found.tried)


@pytest.mark.parametrize(("shift", "incidence_deg"), [(5.0, 65), (-9.0, 45)])
def test_images_on_the_wrong_side_are_put_on_the_right_one(shift: float, incidence_deg: float) -> None:
    example = blend(incidence_deg, 128, ghost_shift=shift, noise=NOISE)
    wrong = estimate_of(example, example.scene.opposite())
    mended = with_likelier_side(wrong, example.capture, edges(example), NOISE)
    assert mended.scene == mended.estimate.scene == example.scene
    assert [rung.reason for rung in mended.tried if rung.taken] != [rung.reason for rung in wrong.tried if rung.taken]
    again = with_likelier_side(mended, example.capture, edges(example), NOISE)
    assert again.scene == example.scene
    assert again.tried == mended.tried


def test_what_is_certain_of_the_side_has_the_error_of_one_side() -> None:
    example = blend(60, 128, ghost_shift=6.0, noise=NOISE)
    found = estimate_of(example, example.scene, shift_error_of_side=0.2)
    open_error = dataclasses.replace(found.estimate.errors, ghost_shift=6.0)
    of_both = dataclasses.replace(found, estimate=dataclasses.replace(found.estimate, errors=open_error))
    assert with_likelier_side(of_both, example.capture, edges(example), NOISE).errors.ghost_shift == 0.2


@pytest.mark.parametrize(("incidence_deg", "noise", "sure"), [(50, 0.001, True), (30, 0.03, False)])
def test_edges_that_hardly_differ_do_not_overrule_tiles_that_are_sure(
    incidence_deg: float, noise: float, sure: bool
) -> None:
    example = blend(incidence_deg, 112, ghost_shift=6.0, noise=noise)

    def misleading(scene: SceneParameters) -> float:
        """As of a layer with hardly any edges: slightly fewer with its images on the wrong side."""
        return 0.01 if scene == example.scene else 0.008

    found = estimate_of(example, example.scene, shift_error_of_side=0.2)
    known = dataclasses.replace(found.estimate.errors, ghost_shift=0.2)
    found = dataclasses.replace(found, estimate=dataclasses.replace(found.estimate, errors=known))
    checked = with_likelier_side(found, example.capture, misleading, noise)
    assert (checked.scene == example.scene) == sure
    # What neither tells surely may as well lie on the other side.
    assert checked.errors.ghost_shift == (0.2 if sure else 6.0)


@pytest.mark.parametrize(("of_side", "of_none", "more_edges", "stay"), [
    (2.6, 3.0, 0.0, True), (2.4, 3.0, 0.0, False), (1.5, 3.0, 0.0029, False), (-1.5, 3.0, -0.0031, True),
    (1.9, 0.9, 0.1, False), (1.9, 1.1, 0.1, True), (2.1, -3.0, 0.1, True),
])  # fmt: skip
def test_images_that_lie_on_either_side_are_none(
    of_side: float, of_none: float, more_edges: float, stay: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    told = ghost_side._TilesTell(of_side, of_none)
    monkeypatch.setattr(ghost_side, "_told_by_tiles", lambda capture, scene, noise: told)
    example = blend(50, 96, ghost_shift=4.0, noise=NOISE)
    found = estimate_of(example, example.scene)
    # Spectra speak against images in place, of which nobody was told.
    against = dataclasses.replace(found.estimate, doubtful_shift=True)
    without = dataclasses.replace(found, tried=(), estimate=against)

    def told_by_edges(scene: SceneParameters) -> float:
        return 0.0 if scene == example.scene else more_edges

    kept = with_likelier_side(found, example.capture, told_by_edges, NOISE, lambda: without)
    assert (kept.tried == ()) is not stay
    assert not kept.estimate.doubtful_shift
    assert with_likelier_side(found, example.capture, told_by_edges, NOISE).tried != ()


def test_images_of_a_frame_of_few_tiles_stay() -> None:
    example = blend(50, 64, ghost_shift=4.0, noise=NOISE)
    assert ghost_side._told_by_tiles(example.capture, example.scene, NOISE).of_none is None
    assert ghost_side._TilesTell().show_none(0.0) is False


def test_images_in_place_and_panes_that_vary_are_left_as_they_are() -> None:
    example = blend(60, 96, ghost_shift=0.0, noise=NOISE)
    for scene in (example.scene, example.scene.replace(ghost_shift=4.0, focal_px=90.0)):
        found = estimate_of(example, scene)
        assert with_likelier_side(found, example.capture, edges(example), NOISE) is found


def test_all_images_change_sides_and_come_back() -> None:
    window = SceneParameters(50.0, 10.0, 0.5, transmission_ghost_shift=0.7, n_panes=2, gap_shift=-3.0)
    other = window.opposite()
    assert (other.ghost_shift, other.transmission_ghost_shift, other.gap_shift) == (-0.5, -0.7, 3.0)
    assert other.opposite() == window
