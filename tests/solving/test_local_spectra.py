"""Layers that are expected in each place: Wiener filters of windows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from polaropt import Capture, SceneParameters, Weights, separate, simulate
from polaropt.capture.noise import NoiseModel
from polaropt.simulation import psnr_db
from polaropt.solving.kernels.windows import limit_power, share_power
from polaropt.solving.local_spectra import TURNS, Windows, believed_share
from polaropt.solving.problem import Problem
from polaropt.solving.starts import take_start
from polaropt.solving.windows import COARSE, FINE, add_to, spectra_of
from solvers.base import StoppingRule
from solvers.registry import get_solver
from tests.blends import blend


def problem_of(height=96, width=80, weights=None, incidence=60, shift=3.0, noise=0.005, color=True):
    example = blend(incidence, max(height, width), color=color, ghost_shift=shift, noise=noise)
    part = example.capture.part(slice(0, height), slice(0, width))
    return example, Problem(part, example.scene, noise, weights or Weights())


def windows_of(problem):
    return Windows(problem.known, problem.canvas)


def error(layers, truth):
    inner = (..., slice(16, -16), slice(16, -16))
    return [float(np.mean((layers[i] - truth[i])[inner] ** 2)) for i in (0, 1)]


def assert_expected_is_nearer(example, problem):
    """Than the closed form's layers."""
    truth = example.layers.reshape(2, -1, *problem.capture.shape[-2:])
    known = error(problem.canvas.crop(problem.known.layers), truth)
    expected = error(problem.canvas.crop(problem.expected.in_colors(problem.known.basis)), truth)
    assert expected[0] < known[0]
    assert expected[1] < known[1]


def dark_specks(capture, growth):
    """A capture with dark pixels all over, in which noise that grows with the light is small."""
    dark = np.zeros(capture.shape[-2:], dtype=bool)
    dark[::9, ::7] = True
    random = np.random.default_rng(0).standard_normal(capture.intensities.shape)
    darker = np.where(dark, 0.02 * capture.intensities, capture.intensities)
    noisy = darker + np.sqrt(growth.variance(darker.astype(np.float32))) * random
    return capture.replace(intensities=noisy.astype(np.float32)), dark


def test_many_turns_do_not_drive_dark_pixels_off(monkeypatch):
    """A step with the precision of their window is many times too long for them."""
    growth = NoiseModel(0.0005, 1e-3)
    capture, dark = dark_specks(blend(40, 96, noise=0.0).capture, growth)
    ends = []
    for turns in (TURNS, ((COARSE, 12), (FINE, 6))):
        monkeypatch.setattr("polaropt.solving.local_spectra.TURNS", turns)
        problem = Problem(capture, blend(40, 96).scene, 0.02, Weights(), growth=growth)
        layers = problem.canvas.crop(problem.expected.in_colors(problem.known.basis))
        ends.append(np.abs(layers[0][..., dark]).mean())
    assert ends[1] < 1.2 * ends[0]


def test_windows_are_shown_no_more_of_a_pixel_than_of_those_around_it():
    precision = np.ones((2, 80, 80), dtype=np.float32)
    precision[1, 40, 40] = 1000.0
    share = believed_share(precision)
    around = precision.mean(axis=0)[24:57, 24:57].mean()
    assert share[1, 40, 40] == pytest.approx(around / 1000, rel=1e-3)
    assert share[0].min() == 1
    assert np.sort(share[1].ravel())[1] == 1


def test_windows_that_overlap_add_up_to_the_frame():
    """What all windows see of an image, put together again, is the image: no window counts twice."""
    _, problem = problem_of(70, 45)
    windows = windows_of(problem)
    windows._fast = np.ones_like(windows._fast)
    layers = problem.known.layers
    frame = windows._extended(layers)
    again = np.zeros_like(frame)
    for top in range(0, frame.shape[-2] - 31, 16):
        add_to(again[..., top : top + 32, :], spectra_of(frame[..., top : top + 32, :], COARSE), COARSE)
    inside = np.s_[..., 16 : 16 + 70, 16 : 16 + 45]
    np.testing.assert_allclose(again[inside], frame[inside], atol=1e-5)


def test_a_window_sees_of_a_filter_that_acts_on_single_pixels_the_same():
    _, problem = problem_of(shift=0.0)
    windows = windows_of(problem)
    everywhere = problem.known.told[:, :1, :1]
    told = windows._everywhere.photographed.told.reshape(2, 32, 17)
    np.testing.assert_allclose(told, np.broadcast_to(everywhere, (2, 32, 17)), rtol=1e-4)


def test_a_share_that_is_the_same_at_all_frequencies_is_so_on_the_canvas():
    _, problem = problem_of()
    windows = windows_of(problem)
    share = windows.on_canvas(np.full((2, 3, 32, 17), 0.25, np.float32))
    height, width = problem.canvas.shape
    assert share.shape == (2, 3, height, width // 2 + 1)
    np.testing.assert_allclose(share, 0.25, rtol=1e-6)


@pytest.mark.parametrize("color", [False, True])
@pytest.mark.parametrize("incidence", [40, 60, 75])
def test_layers_expected_in_each_place_are_nearer_than_those_of_one_spectrum(incidence, color):
    example, problem = problem_of(128, 128, incidence=incidence, color=color)
    assert_expected_is_nearer(example, problem)


def test_what_is_expected_does_not_depend_on_the_start():
    """Starts that know no more than the closed form meet the same objective: its priors follow from the photographs."""
    _, first = problem_of()
    _, second = problem_of()
    first.compiled(take_start(first, "closed-form"))
    second.compiled(take_start(second, "cold"))
    np.testing.assert_array_equal(first.penalties.natural_image.mean, second.penalties.natural_image.mean)
    np.testing.assert_array_equal(first.penalties.natural_image.stiffness, second.penalties.natural_image.stiffness)


def test_better_layers_at_hand_tell_better_spectra():
    example, problem = problem_of(128, 128)
    truth = example.layers.reshape(2, -1, 128, 128)
    before = error(problem.canvas.crop(problem.best_known()), truth)
    problem.expect_around(problem.canvas.continued(truth))
    assert error(problem.canvas.crop(problem.best_known()), truth)[1] < 0.9 * before[1]


def test_layers_that_speak_against_the_photographs_tell_no_spectra():
    _, problem = problem_of(128, 128)
    before = problem.best_known()
    problem.expect_around(before * np.float32(0.5))
    np.testing.assert_array_equal(problem.best_known(), before)


def test_windows_are_left_out_where_they_cannot_tell():
    scene = SceneParameters(60.0, 20.0, 30.0)
    layers = np.random.default_rng(0).uniform(size=(2, 40, 40)).astype(np.float32)
    assert Problem(simulate(*layers, scene), scene, 0.005, Weights()).expected is None


@pytest.mark.parametrize("shift", [0.0, 3.0])
def test_a_pane_that_hardly_varies_tells_windows_what_one_does_that_is_the_same_everywhere(shift):
    example, flat = problem_of(64, 80, shift=shift)
    scene = example.scene.replace(focal_px=1e6)
    varying = Problem(flat.capture, scene, flat.noise, Weights())
    flat_windows = Windows(flat.known, flat.canvas)
    windows = Windows(flat.known, flat.canvas, varying=varying._varying_information())
    seen, same = windows._seen_in_row(2, 6), flat_windows._seen_in_row(2, 6)
    for name in ("told", "cross", "counted"):
        here, there = getattr(seen.photographed, name), getattr(same.photographed, name)
        np.testing.assert_allclose(here, np.broadcast_to(there, here.shape), rtol=2e-3, atol=2e-3 * np.abs(there).max())


@pytest.mark.parametrize("scene", [{"focal_px": 90.0}, {"focal_px": 90.0, "ghost_shift": 4.0}])
def test_windows_of_a_pane_that_varies_are_nearer_to_the_layers_than_one_spectrum(scene):
    example = blend(50.0, 96, color=False, noise=0.005, **scene)
    problem = Problem(example.capture, example.scene, 0.005, Weights())
    assert_expected_is_nearer(example, problem)


@pytest.mark.parametrize("focal_px", [120.0, None])
def test_windows_that_are_shown_fast_changes_alone_leave_slow_ones_as_they_are(focal_px):
    """Where photographs tell nothing windows drew what their profile makes of slow changes to nothing: a weave."""
    example = blend(50.0, 128, noise=0.005, ghost_shift=0.0, focal_px=focal_px)
    problem = Problem(example.capture, example.scene, 0.005, Weights())
    assert problem.slow_is_known
    windows = Windows(problem.known, problem.canvas, varying=problem._varying_information(), fast_alone=True)
    slow = np.cos(2 * np.pi * np.arange(problem.canvas.shape[1]) / problem.canvas.shape[1])
    layers = np.ones_like(problem.known.layers) * slow.astype(np.float32)
    nothing = np.zeros_like(windows.means(np.ones((128, 128), np.float32)))
    change = windows.step(layers, np.zeros_like(layers), nothing).change
    assert np.abs(change).max() < 0.01 * np.sqrt(3)


def test_windows_are_shown_all_where_slow_changes_are_not_known():
    near_normal, oblique = (blend(incidence, 64, noise=0.005, ghost_shift=0.0) for incidence in (15.0, 50.0))
    half = np.repeat(np.arange(64) < 32, 64).reshape(64, 64)
    photographs = oblique.capture
    clipped = Capture.of_planes(photographs.intensities, photographs.angles_deg, photographs.mask & half)
    captures = [(near_normal.capture, near_normal.scene), (clipped, oblique.scene)]
    assert not any(Problem(*capture, 0.005, Weights()).slow_is_known for capture in captures)


def test_windows_that_explain_less_than_the_closed_form_are_left_out(monkeypatch):
    """Close to grazing incidence the pane at one place of a window says little of that at another."""
    example = blend(50.0, 64, noise=0.005, focal_px=60.0)
    problem = Problem(example.capture, example.scene, 0.005, Weights())
    found = problem._expected_layers()
    monkeypatch.setattr(problem, "_expected_layers", lambda: replace(found, layers=2 * found.layers))
    assert problem.expected is None


def test_nothing_is_expected_of_photographs_that_do_not_count():
    assert problem_of(40, 40, Weights(misfit=0.0))[1].expected is None


@pytest.mark.parametrize("shape", [(16, 16), (17, 70), (33, 17)])
def test_frames_smaller_than_a_window(shape):
    _, problem = problem_of(*shape)
    assert np.isfinite(problem.expected.layers).all()
    assert (problem.expected.variance > 0).all()


def frames(*shifts):
    """Captures of one pane before which the scene moves down by so many pixels, with their layers, and the pane."""
    example = blend(60, 128, ghost_shift=3.0)
    layers = [np.moveaxis(layer, 0, -1) for layer in example.layers]
    found = []
    for seed, shift in enumerate(shifts):
        moved = [layer[shift : shift + 96, :96] for layer in layers]
        found.append((simulate(*moved, example.scene, seed=seed), [np.moveaxis(layer, -1, 0) for layer in moved]))
    return found, example.scene


@pytest.mark.parametrize("shift", [0, 8])
def test_a_frame_after_another_needs_one_turn(monkeypatch, shift):
    """With the spectra of the frame before, where it shows the same, it is as good as by itself; else nearly.

    Where all has moved the reflection is 0.7 dB worse at most.
    """
    (first, second), scene = frames(0, shift)
    capture, truth = second
    alone = Problem(capture, scene, 0.005, Weights())
    before = Problem(first[0], scene, 0.005, Weights(), remember=True)
    assert before.memory is not None
    counted = []
    step = Windows.step
    monkeypatch.setattr(Windows, "step", lambda *given, **named: counted.append(given) or step(*given, **named))
    after = Problem(capture, scene, 0.005, Weights(), memory=before.memory)
    errors = [
        error(problem.canvas.crop(problem.expected.in_colors(problem.known.basis)), truth) for problem in (after, alone)
    ]
    assert len(counted) == 1 + sum(times for _, times in TURNS)
    assert alone.memory is None
    worst = np.array([1.0, 1.01] if shift == 0 else [1.03, 10**0.07])
    assert (np.array(errors[0]) < worst * errors[1]).all()


@pytest.mark.parametrize("noise", [0.005, 0.03])
def test_photographs_that_the_expected_layers_know_of_count_once(noise: float) -> None:
    """Without the other terms a solve ends where it begins: at the layers that are expected."""
    weights = Weights(gradient_sparsity=0, edge_independence=0, nonnegativity=0)
    _, problem = problem_of(weights=weights, noise=noise)
    start = take_start(problem, "closed-form")
    objective = problem.compiled(start)
    result = get_solver("lbfgs").minimize(objective.value_and_grad, objective.coordinates(start), StoppingRule())
    end = objective.solution(result.x)[0]
    assert np.abs(problem.canvas.crop(end - start)).max() < 0.1 * noise


@pytest.mark.parametrize("size", [COARSE, FINE])
def test_frequencies_beside_one_lie_in_its_direction_before_and_after_it(size):
    side = size.side_px
    rows, columns = np.meshgrid(np.fft.fftfreq(side) * side, np.arange(side // 2 + 1.0), indexing="ij")
    places = (rows + 1j * columns).ravel()
    inner = (np.abs(places) > 2) & (np.abs(rows).ravel() < side // 2 - 1) & (columns.ravel() < side // 2 - 1)
    for step, beside in zip((1, -1), size.along, strict=True):
        moved = places[beside[inner]] - places[inner]
        onward = moved / (places[inner] / np.abs(places[inner]))
        # The nearest there are: within half a step down and across.
        np.testing.assert_allclose(onward.real, step, atol=np.sqrt(0.5))
        assert np.abs(onward.imag).max() <= np.sqrt(0.5)
    # The first and last columns of half spectra of real images repeat themselves upside down: so does what is shared.
    busy = np.random.default_rng(0).uniform(size=rows.shape)
    opposite = -np.arange(side) % side
    busy[:, [0, -1]] += busy[opposite][:, [0, -1]]
    for beside in size.along:
        shared = busy.ravel()[beside].reshape(rows.shape)[:, [0, -1]]
        np.testing.assert_array_equal(shared[1:], shared[opposite][1:])


def test_a_window_shares_its_power_between_colours_and_along_directions():
    # One row of frequencies: those beside the middle one are the first and the last.
    along = np.array([[1, 2, 2], [0, 0, 1]])
    random = np.random.default_rng(0)
    prior = random.uniform(1, 2, (2, 2, 3)).astype(np.float32)
    counted = (0.1 * prior)[:, :, None]
    power = np.repeat(random.uniform(1, 2, (2, 2, 1, 3)), 4, axis=2).astype(np.float32)
    busy = ((power + counted) / prior[:, :, None]).astype(np.float64)
    near = 0.8 * busy + 0.1 * (busy[..., along[0]] + busy[..., along[1]])
    near[:, 1] = 0.7 * near[:, 1] + 0.3 * near[:, 0]
    share_power(power, counted, prior, along, np.float32(0.2), np.float32(0.3))
    np.testing.assert_allclose(power, near * prior[:, :, None] - counted, rtol=1e-5)

    # As strong everywhere in units of the frame's own: nothing to share.
    power = np.repeat(2 * prior[:, :, None] - counted, 4, axis=2)
    before = power.copy()
    share_power(power, counted, prior, along, np.float32(0.2), np.float32(0.3))
    np.testing.assert_allclose(power, before, rtol=1e-6)


@pytest.mark.parametrize("size", [COARSE, FINE])
def test_what_repeats_with_a_mosaics_polarizers_is_bounded_by_its_direction(size):
    """A peak there is polarized light; as busy as its direction it is detail, and a peak elsewhere is texture."""
    weight, direction = size.of_pattern
    shape = size.side_px, size.side_px // 2 + 1
    half = size.side_px // 2
    bounded = ((weight == 0) & (direction >= 0)).reshape(shape)
    assert bounded[0, half]
    assert bounded[half, 0]
    assert bounded[half, half]
    assert not bounded[half // 2, half // 2]
    assert not bounded[0, half // 2]
    assert direction[0] == -1

    prior = np.random.default_rng(0).uniform(1, 2, (2, 1, weight.size)).astype(np.float32)
    counted = (0.1 * prior)[:, :, None]
    power = 3 * prior[:, :, None] - counted
    peaks = power.reshape(2, 1, 1, *shape).copy()
    peaks[..., 0, half] *= 100
    peaks[..., half // 2, half // 2] *= 2
    for before, texture in ((power, False), (peaks.reshape(power.shape), True)):
        after = before.copy()
        limit_power(after, counted, prior, weight, direction)
        busy = ((after + counted) / prior[:, :, None]).reshape(2, 1, 1, *shape)
        if texture:
            np.testing.assert_array_equal(after[..., ~bounded.ravel()], before[..., ~bounded.ravel()])
        np.testing.assert_allclose(busy[..., 0, half], 3, rtol=1e-4)
        np.testing.assert_allclose(busy[..., half, 0], 3, rtol=1e-4)


def test_layers_stay_bounded_where_double_images_reach_into_what_is_missing() -> None:
    """Steps that took a pixel for untold whose double image is seen grew by factors of thousands."""
    made = blend(60.0, 128, ghost_shift=8.2)
    frame = np.ones((128, 128), dtype=np.bool_)
    frame[16:-16, 16:-16] = False
    result = separate(made.capture.left_out(frame), made.scene, leave_out_unglazed=False)
    assert np.abs(result.layers).max() < 1.5
    for layer, least_db in enumerate((45, 30)):
        assert psnr_db(np.where(frame, 0, result.layers[layer]), np.where(frame, 0, made.layers[layer])) > least_db
