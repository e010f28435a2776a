"""Tiles of a mosaic's samples: azimuth, ghosts and incidence where its cells mislead."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.typing import NDArray

from polaropt import Capture, SceneParameters, estimate, read_capture
from polaropt.capture import StokesImages, registered_noise, stokes_images, write_png
from polaropt.estimation.flat.azimuth import principal_axis
from polaropt.estimation.flat.estimate import _asked_of_samples
from polaropt.estimation.flat.samples import tiles as sampled_tiles
from polaropt.estimation.flat.samples.ghosts import sampled_shift
from polaropt.estimation.flat.samples.light import polarized_pane
from polaropt.estimation.flat.samples.single import FARTHEST_PX
from polaropt.estimation.flat.samples.tiles import PaneOfTiles, SampledTileLikelihood, SampledTiles, tiles_of_mosaic
from polaropt.estimation.flat.search import Trial
from polaropt.estimation.flat.windows.likelihood import Window
from polaropt.estimation.flat.windows.tiles import TileFit
from polaropt.estimation.index_by_tiles import LikelierIndex, likelier_index_of_mosaic
from polaropt.numerics import turn_between
from polaropt.optics import Sampling
from polaropt.simulation import Camera, photograph_mosaic, simulated_mosaic
from studies.photographs import pairs_of

FAR, NOISE = SceneParameters(65.0, 30.0, 13.0), 0.005
MIDDLE, PLACE = SceneParameters(50.0, 112.0, 9.0), SceneParameters(60.0, 75.0, 0.0)
OPEN = SceneParameters(None, None, None)
SENSORS = ("mono", "color")


@cache
def raw_of(sensor: str, scene: SceneParameters, side: int = 384) -> NDArray[np.float32]:
    photographs = pairs_of(None, side)[0]
    camera = Camera(noise=NOISE, lens_blur_px=0.5)
    return photograph_mosaic(photographs.transmission, photographs.reflection, scene, camera, sensor == "color")


@cache
def mosaic(sensor: str, scene: SceneParameters, resolution: str = "sensor", side: int = 384) -> Capture:
    with TemporaryDirectory() as folder:
        values = np.round(65535 * np.clip(raw_of(sensor, scene, side), 0, 1))
        write_png(Path(folder, "raw.png"), values.astype(np.uint16))
        return read_capture(Path(folder, "raw.png"), sensor=sensor, resolution=resolution)


@cache
def tiles(sensor: str, scene: SceneParameters) -> SampledTiles:
    found = tiles_of_mosaic(mosaic(sensor, scene), NOISE)
    assert found is not None
    return found


@pytest.mark.parametrize("sensor", SENSORS)
@pytest.mark.parametrize("scene", [FAR, MIDDLE, PLACE], ids=["far", "middle", "place"])
def test_the_azimuth_of_a_mosaic_is_told_within_its_error(sensor: str, scene: SceneParameters) -> None:
    capture = mosaic(sensor, scene)
    axis = principal_axis(stokes_images(capture.registered, registered_noise(capture)))
    off = abs(turn_between(axis.azimuth_deg, scene.values()[1], 90.0))
    assert off < min(2.5 * axis.error_deg + 0.05, 1.0)


@pytest.mark.parametrize("azimuth", [10.0, 35.0, 80.0])
def test_what_aliases_in_one_component_does_not_turn_the_azimuth(azimuth: float) -> None:
    """Edges that lie alike leave as much in one of two components as a pane polarizes that hardly mirrors."""
    rng = np.random.default_rng(0)
    light = np.cumsum(np.cumsum(rng.standard_normal((1, 192, 192)), axis=1), axis=2)
    light *= 0.01 / light.std()
    twice = 2 * math.radians(azimuth)
    images = np.stack([light, math.cos(twice) * light, math.sin(twice) * light])
    images[1:] += np.array([0.03, 0.002])[:, None, None, None] * rng.standard_normal((2, *light.shape))
    valid, covariance = np.ones(light.shape, bool), 0.001**2 * np.eye(3)
    of_cells, of_photographs = (
        principal_axis(StokesImages(images.astype(np.float32), covariance, valid, aliased)) for aliased in (True, False)
    )
    assert abs(turn_between(of_cells.azimuth_deg, azimuth, 90.0)) < min(2.5 * of_cells.error_deg, 2.0)
    # As noise of photographs, which is alike in both, it would.
    assert abs(turn_between(of_photographs.azimuth_deg, azimuth, 90.0)) > 5


@pytest.mark.parametrize("sensor", SENSORS)
@pytest.mark.parametrize(("incidence", "azimuth"), [(15.0, 20.0), (18.0, 64.0)])
def test_a_pane_that_polarizes_little_is_not_found_too_steep(sensor: str, incidence: float, azimuth: float) -> None:
    """What aliases passes for light that a steeper pane polarizes, in fine blocks and beside the carriers."""
    found = estimate(mosaic(sensor, SceneParameters(incidence, azimuth, 0.0)), OPEN)
    assert found.scene.incidence_deg == pytest.approx(incidence, abs=1.0)
    assert found.scene.azimuth_deg == pytest.approx(azimuth, abs=2.0)


@pytest.mark.parametrize("sensor", SENSORS)
@pytest.mark.parametrize("scene", [FAR, MIDDLE], ids=["far", "middle"])
def test_ghosts_of_a_mosaic_are_found_where_its_cells_hardly_show_them(sensor: str, scene: SceneParameters) -> None:
    shift, error = PaneOfTiles(tiles(sensor, scene), scene.values()[1]).ghosts(OPEN, scene.values()[0] + 1.5)
    assert shift == pytest.approx(scene.values()[2], abs=min(1.0, 2.5 * error))


@pytest.mark.parametrize("sensor", SENSORS)
def test_the_pane_is_the_same_at_either_resolution(sensor: str) -> None:
    """Tiles of the samples tell it, be the layers asked for at the sensor's resolution or at that of its cells."""
    scene, of_cells = (
        estimate(mosaic(sensor, FAR, way, side=192), OPEN, model="ghosts").scene for way in ("sensor", "cell")
    )
    assert of_cells.scaled(2 if sensor == "mono" else 4).values() == pytest.approx(scene.values())


@pytest.mark.parametrize(("incidence", "side"), [(65.0, 256), (80.0, 384)])
def test_ghosts_of_a_mosaic_beyond_the_reach_of_tiles_are_those_of_its_cells(incidence: float, side: int) -> None:
    scene = SceneParameters(incidence, 25.0, FARTHEST_PX + 4)
    found = estimate(mosaic("mono", scene, side=side), OPEN).scene
    assert abs(turn_between(found.values()[1], 25.0, 180.0)) < 1
    assert found.values()[0] == pytest.approx(scene.values()[0], abs=3)
    assert found.values()[2] == pytest.approx(scene.values()[2], abs=0.5)


@pytest.mark.parametrize(("scene", "tells"), [(FAR, True), (PLACE, False)], ids=["far", "place"])
def test_only_ghosts_that_are_surely_there_speak_by_their_side(scene: SceneParameters, tells: bool) -> None:
    incidence, azimuth, shift = scene.values()
    asked = OPEN.replace(refractive_index=1.5)
    fitted, sure_of_side = _asked_of_samples(tiles("mono", scene), azimuth, Trial(incidence, shift / 2, 0.0), asked)
    assert (sure_of_side(fitted()) > 2) is tells
    assert sure_of_side(tiles_at(scene, 3.0)) == 0
    assert sure_of_side(tiles_at(scene, 0.2)) == 0


def tiles_at(scene: SceneParameters, shift: float) -> TileFit:
    """How likely ghosts are where there are none."""
    incidence, azimuth, _ = scene.values()
    return SampledTileLikelihood(tiles("mono", scene), azimuth).fitted(Window(incidence, shift), 1.5)


@pytest.mark.parametrize("sensor", SENSORS)
def test_images_in_place_are_given_no_ghosts(sensor: str) -> None:
    shift, _ = PaneOfTiles(tiles(sensor, PLACE), PLACE.values()[1]).ghosts(OPEN, 61.0)
    assert shift == 0.0


def test_ghosts_that_lie_on_neither_side_of_the_layers_are_none() -> None:
    """Tiles find some 3 px apart in this mosaic of a pane whose images are in place."""
    photographs, scene = pairs_of(None, 192)[1], SceneParameters(42.0, 115.0, 0.0)
    camera = Camera(noise=0.003, lens_blur_px=0.5)
    raw = photograph_mosaic(photographs.transmission, photographs.reflection, scene, camera, False)
    capture = simulated_mosaic(raw, False)
    seen = tiles_of_mosaic(capture, 0.003)
    assert seen is not None
    shift, _ = PaneOfTiles(seen, 115.0).ghosts(OPEN, 42.0)
    assert abs(shift) > 2
    assert estimate(capture, OPEN).scene.ghost_shift == 0


@pytest.mark.parametrize(
    ("sure", "of_side", "fewer", "shift", "believed"),
    [
        # Likelier on their side than on the other, and edges say so.
        (2.5, 2.5, 0.01, 3.0, True),
        # On neither side.
        (3.5, 0.5, 0.001, 3.0, False),
        # Tiles are sure of the side, whatever the edges say.
        (3.5, 4.0, -0.01, 3.0, True),
        (3.5, 1.0, -0.01, 3.0, False),
        # Hardly likelier than none, and clearly on their side.
        (1.0, 2.5, 0.1, 6.0, True),
        # What lies far off hardly passes for ghosts.
        (6.0, 0.2, -0.02, 17.0, True),
        (2.5, 0.2, -0.02, 17.0, False),
    ],
)
def test_ghosts_of_tiles_must_lie_on_a_side(
    sure: float, of_side: float, fewer: float, shift: float, believed: bool
) -> None:
    assert sampled_tiles._are_likely(sure, of_side, fewer, shift) is believed
    assert sampled_tiles._are_likely(sure, of_side, fewer, -shift) is believed


@pytest.mark.parametrize(("sure", "believed"), [(2.5, True), (1.5, False)])
def test_where_no_edges_are_asked_tiles_must_be_sure_of_ghosts(sure: float, believed: bool) -> None:
    ghosts = SimpleNamespace(surer_than=lambda place: sure, window=Window(60.0, 4.0))
    assert PaneOfTiles._are_believed(SimpleNamespace(edges=None), None, ghosts, OPEN) is believed


CLEAR = SceneParameters(78.0, 60.0, 8.0)
TINTED = CLEAR.replace(absorption=0.3)


def test_tiles_of_a_mosaic_tell_tinted_glass_by_how_dim_its_ghosts_are() -> None:
    dark, clear = (PaneOfTiles(tiles("mono", scene), scene.values()[1]) for scene in (TINTED, CLEAR))
    told = dark.tint(TINTED.replace(absorption=0.0))
    assert told is not None
    absorption, error = told
    assert absorption == pytest.approx(0.3, abs=2 * error)
    assert error < 0.15
    assert clear.tint(CLEAR) is None


def test_a_mosaic_of_tinted_glass_is_found_tinted_unless_that_is_told_otherwise() -> None:
    capture, open_tint = mosaic("mono", TINTED), OPEN.replace(absorption=None)
    found = estimate(capture, open_tint)
    assert found.scene.absorption == pytest.approx(0.3, abs=2 * (found.errors.absorption or 0.0))
    assert found.scene.values()[0] == pytest.approx(78.0, abs=1)
    assert not found.estimate.rivals
    assert estimate(capture, open_tint.replace(absorption=0.0)).scene.absorption == 0
    clear = estimate(mosaic("mono", CLEAR), open_tint)
    assert clear.scene.absorption == 0
    assert clear.errors.absorption is None


ALONG = SceneParameters(50.0, 135.0, 0.0, transmission_polarization=(0.4, 135.0))
ACROSS = SceneParameters(36.0, 75.0, 0.0, reflection_polarization=(0.85, 165.0))


@pytest.mark.parametrize("scene", [ALONG, ACROSS], ids=["screen along", "sky across"])
def test_tiles_of_a_mosaic_tell_light_polarized_along_the_plane_of_incidence_or_across(scene: SceneParameters) -> None:
    """No light is polarized between these: a plain pane explains the polarized light of the cells."""
    plain = scene.replace(transmission_polarization=(0.0, 0.0), reflection_polarization=(0.0, 0.0))
    found = polarized_pane(tiles("mono", scene), scene, OPEN)
    assert found is not None
    for name in ("transmission_polarization", "reflection_polarization"):
        assert getattr(found.scene, name) == pytest.approx(getattr(scene, name), abs=0.1)
    assert polarized_pane(tiles("mono", plain), plain, OPEN) is None


def test_detail_that_aliases_in_cells_is_no_polarized_light() -> None:
    """Edges and mean spectra of these cells find a polarized sky, and the pane at 7 degrees."""
    photographs, scene = pairs_of(None, 256)[3], SceneParameters(33.0, 108.0, 0.0)
    camera = Camera(noise=0.004, lens_blur_px=0.3)
    raw = photograph_mosaic(photographs.transmission, photographs.reflection, scene, camera, False)
    found = estimate(simulated_mosaic(raw, False), OPEN).scene
    assert not found.polarized
    assert found.values()[0] == pytest.approx(33.0, abs=3)


@pytest.mark.parametrize("sensor", SENSORS)
@pytest.mark.parametrize("scene", [FAR, PLACE], ids=["far", "place"])
def test_the_incidence_of_a_mosaic_is_told_within_its_error(sensor: str, scene: SceneParameters) -> None:
    incidence, azimuth, _ = scene.values()
    told = PaneOfTiles(tiles(sensor, scene), azimuth).incidence(scene.replace(incidence_deg=incidence + 1))
    assert told is not None
    assert abs(told[0] - incidence) < 2.5 * told[1] < 4


def test_photographs_and_small_mosaics_have_no_tiles() -> None:
    cells = mosaic("mono", FAR)
    assert tiles_of_mosaic(cells.registered, NOISE) is None
    assert tiles_of_mosaic(cells.part(slice(0, 96), slice(0, 64)), NOISE) is None


@pytest.mark.parametrize("order", [(90.0, 45.0, 135.0, 0.0), (0.0, 90.0, 45.0, 135.0)], ids=["across", "beside"])
def test_polarized_light_is_found_beside_the_carriers_of_any_order(order: tuple[float, ...]) -> None:
    """Of detail that is all polarized the two carriers, weighed, give back the difference of par and perp."""
    angles = (0.0, 45.0, 90.0, 135.0)
    pattern = tuple(tuple(angles.index(order[2 * y + x]) for x in (0, 1)) for y in (0, 1))
    sampling = Sampling(pattern, ((0, 0), (0, 0)))
    rows, columns = np.mgrid[:192, :192]
    light = 1 + 0.2 * np.cos(2 * np.pi * (6 * columns + 4 * rows) / 64)
    azimuth, degree = 20.0, 0.3
    photographs = np.array([
        light / 2 * (1 + degree * math.cos(2 * math.radians(angle - azimuth))) for angle in angles
    ])[:, None]  # fmt: skip
    samples = SimpleNamespace(values=sampling.sample(photographs), valid=np.ones(light.shape, bool), sampling=sampling)
    found = SampledTiles(samples, angles, 1e-4)  # type: ignore[arg-type]
    likelihood = sampled_tiles.SampledTileLikelihood(found, azimuth)
    of_light, of_difference, cross, imaginary = likelihood._data.sum(axis=(1, 2))
    assert cross / of_light == pytest.approx(degree, rel=1e-3)
    assert of_difference / of_light == pytest.approx(degree**2, rel=1e-3)
    assert abs(imaginary) < 1e-3 * cross


def test_a_carrier_that_fine_detail_covers_counts_for_little() -> None:
    rng = np.random.default_rng(1)
    polarized, detail, n = rng.standard_normal((3, 40, 30)), 10 * rng.standard_normal((3, 40, 30)), 30

    def moments(first: int, second: int) -> np.ndarray:
        beside = {1: polarized + detail, 2: polarized}
        return (beside[first] * beside[second]).sum(axis=-1)[None]

    tiles = SimpleNamespace(
        counts=np.full(40, n), shares=lambda _: (1.0, 1.0), moments=moments, detail=np.ones((2, 40))
    )
    ((covered,), (clean,)), (noise,) = sampled_tiles._cleanest(tiles, 0.0, 1e-3)  # type: ignore[arg-type]
    assert np.median(np.abs(covered)) < 0.05
    np.testing.assert_allclose(covered + clean, 1)
    assert np.median(noise) < 0.5


@pytest.mark.parametrize("cell", [0, 3])
def test_detail_of_a_cell_is_told_by_its_frequencies_and_by_the_tile(cell: int) -> None:
    """Cells that have what the whole tile makes expect keep it; of one that has more by itself few frequencies count
    less than many."""
    counts, shape = np.array([5.0, 10.0, 20.0, 200.0]), np.array([1.0, 2.0, 4.0, 8.0])
    usual = 3.0 * shape[None]
    np.testing.assert_allclose(sampled_tiles._detail(usual, counts, shape), usual)
    more = usual.copy()
    more[0, cell] *= 2
    kept = sampled_tiles._detail(more, counts, shape) / usual
    own = counts[cell] / (counts[cell] + sampled_tiles._OF_TILE)
    of_tile = 1 + counts[cell] / counts.sum()
    assert kept[0, cell] == pytest.approx(2 * own + of_tile * (1 - own))
    others = np.arange(4) != cell
    np.testing.assert_allclose(
        kept[0, others], 1 + (of_tile - 1) * sampled_tiles._OF_TILE / (counts[others] + sampled_tiles._OF_TILE)
    )


def test_samples_look_for_ghosts_that_tiles_tell_near_these_only() -> None:
    cells = mosaic("mono", FAR).cells
    assert cells is not None
    angles = mosaic("mono", FAR).angles_deg
    shift, error = sampled_shift(cells.samples, angles, FAR.replace(ghost_shift=12.5), NOISE, 0.4)
    assert shift == pytest.approx(13.0, abs=0.4)
    assert 0.2 < error < 0.5
    shift, _ = sampled_shift(cells.samples, angles, FAR.replace(ghost_shift=-6.0), NOISE, 0.4)
    assert shift == pytest.approx(-6.0, abs=1.6)


@pytest.mark.parametrize(
    ("index", "incidence", "shift"), [(1.5, 75.0, 9.0), (1.5, 65.0, 0.0), (1.72, 75.0, 9.0), (1.72, 75.0, 0.0)]
)
def test_tiles_of_a_mosaic_tell_an_index_and_let_none_pass_that_its_cells_make_up(
    index: float, incidence: float, shift: float
) -> None:
    scene = SceneParameters(incidence, 25.0, shift, refractive_index=index)
    seen = tiles("mono", scene)
    told = scene.replace(refractive_index=1.5)
    made_up = LikelierIndex(1.8, 0.1)
    for of_cells in (None, made_up):
        found = likelier_index_of_mosaic(seen, told, of_cells)
        if index == 1.5:
            assert found is None
        else:
            assert found is not None
            assert abs(found.index - index) < 2 * found.error < 0.3
    # Nor do they say anything against the right one, even where images in place were given ghosts.
    assert likelier_index_of_mosaic(seen, scene, None) is None
    assert likelier_index_of_mosaic(seen, scene.replace(n_panes=2, gap_shift=3.0), made_up) is None


def test_an_index_of_cells_that_tiles_bear_out_is_told() -> None:
    """Near Brewster's angle tiles alone cannot tell on which side of it the pane stands."""
    scene = SceneParameters(63.0, 25.0, 9.0, refractive_index=1.72)
    seen, of_cells = tiles("mono", scene), LikelierIndex(1.72, 0.1)
    told = scene.replace(refractive_index=1.5, incidence_deg=68.0)
    assert likelier_index_of_mosaic(seen, told, None) is None
    assert likelier_index_of_mosaic(seen, told, of_cells) is of_cells
    assert likelier_index_of_mosaic(seen, told, LikelierIndex(1.4, 0.1)) is None
