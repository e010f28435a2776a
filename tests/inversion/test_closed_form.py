"""Closed forms: exact where the model is, and a Wiener filter where noise rules."""

from __future__ import annotations

import numpy as np
import pytest

from polaropt.capture.capture import Capture
from polaropt.inversion.canvas import Canvas, canvas_for
from polaropt.inversion.closed_form import natural_image_layers, per_pixel_layers, plate_entries
from polaropt.inversion.compiled_whitening import whiten_gradient
from polaropt.inversion.spectra import FrequencyBands, fit_spectra, moments_of, posterior
from polaropt.numerics.spectrum import column_multiplicity, squared_frequencies
from polaropt.optics.engine import PSE
from polaropt.optics.scene import SceneParameters
from polaropt.separation import separate
from polaropt.simulation.metrics import psnr_db
from solvers.base import StoppingRule
from tests.blends import blend


@pytest.mark.parametrize("single_surface", [False, True])
@pytest.mark.parametrize("color", [False, True])
@pytest.mark.parametrize("angles", [(0, 45, 90, 135), (10, 70, 130)])
def test_each_pixel_is_inverted_exactly_without_noise_and_ghosts(single_surface, color, angles):
    example = blend(55, 32, ghost_shift=0.0, color=color, noise=0, angles_deg=angles, single_surface=single_surface)
    found = per_pixel_layers(example.capture, example.scene)
    assert found.shape == example.layers.shape
    np.testing.assert_allclose(found, example.layers, atol=2e-5)


def test_a_clipped_photograph_is_made_up_for_by_the_others():
    example = blend(50, 32, ghost_shift=0.0, noise=0)
    pse = PSE(example.scene, example.capture.angles_deg)
    expected = plate_entries(example.capture, pse)
    damaged = example.capture.intensities.copy()
    valid = np.ones(damaged.shape, dtype=bool)
    damaged[1, 0, 5:9, 5:9], valid[1, 0, 5:9, 5:9] = 0.9, False
    found = plate_entries(Capture.of_planes(damaged, example.capture.angles_deg, valid), pse)
    np.testing.assert_allclose(found, expected, atol=1e-5)


def test_the_posterior_is_that_of_the_dense_system():
    random = np.random.default_rng(0)
    mixing = random.standard_normal((2, 2)) + 1j * random.standard_normal((2, 2))
    information = (mixing.conj().T @ mixing)[:, :, None, None]
    right = (random.standard_normal((2, 1, 1, 1)) + 1j * random.standard_normal((2, 1, 1, 1))).astype(complex)
    prior = random.uniform(0.5, 2, (2, 1, 1, 1))
    coefficients, uncertainty = posterior(information, right, prior)
    dense = np.linalg.inv(information[..., 0, 0] + np.diag(1 / prior[:, 0, 0, 0]))
    np.testing.assert_allclose(coefficients[:, 0, 0, 0], dense @ right[:, 0, 0, 0])
    np.testing.assert_allclose(uncertainty[:, 0, 0, 0], np.diag(dense).real)


def test_spectra_of_random_layers_are_recovered():
    height, width, noise = 192, 200, 0.01
    bands = FrequencyBands(height, width)
    rows, columns = squared_frequencies(height, width)
    squared = rows[:, None] + columns + (2 * np.pi / width) ** 2
    true = np.stack([[0.02 / squared], [0.3 / squared**1.4]])
    random = np.random.default_rng(1)
    white = np.fft.rfft2(random.standard_normal((2, 1, height, width)), norm="ortho")
    mixing = np.array([[0.9, 0.1], [0.7, 0.3]])
    data = np.einsum("el,lchw->echw", mixing, white * np.sqrt(true))
    data += noise * np.fft.rfft2(random.standard_normal((2, 1, height, width)), norm="ortho")
    information = np.broadcast_to((mixing.T @ mixing / noise**2)[:, :, None], (2, 2, bands.sample.size))
    right = np.einsum("el,echw->lchw", mixing, data).reshape(2, 1, -1)[..., bands.sample] / noise**2
    found = fit_spectra(moments_of(information.astype(complex), right), bands, np.array([0.05])).everywhere(bands)
    slow = np.broadcast_to(squared < 1, true.shape)
    assert np.abs(np.log(found / true))[slow].mean() < 0.3


@pytest.mark.parametrize("size", [(12, 14), (40, 15), (300, 310)])
def test_the_sampled_frequencies_stand_for_all(size):
    bands = FrequencyBands(*size)
    rows, columns = squared_frequencies(*size)
    squared = rows[:, None] + columns + (2 * np.pi / max(size)) ** 2
    power = column_multiplicity(size[1]) / squared
    assert bands.share.sum() == pytest.approx(1, rel=1e-3)
    expected = power.sum() / np.prod(size)
    assert (bands.share / bands.squared_frequency).sum() == pytest.approx(expected, rel=0.02)


def test_the_sample_does_not_hang_on_the_order_of_equal_frequencies(monkeypatch):
    partitioned = np.partition
    monkeypatch.setattr(np, "partition", lambda values, kth: partitioned(values[::-1].copy(), kth))
    other = FrequencyBands(300, 311)
    monkeypatch.undo()
    bands = FrequencyBands(300, 311)
    np.testing.assert_array_equal(other.sample, bands.sample)
    assert bands.share.sum() == pytest.approx(1, rel=1e-6)


@pytest.mark.parametrize("incidence_deg", [10, 40, 70])
def test_all_ghosts_at_once_beat_doing_nothing(incidence_deg):
    example = blend(incidence_deg, 96)
    pse = PSE(example.scene, example.capture.angles_deg)
    canvas = canvas_for(pse, 96, 96)
    known = natural_image_layers(example.capture, pse, canvas, 0.005)
    transmission = canvas.crop(known.layers)[0]
    assert psnr_db(transmission, example.layers[0]) > psnr_db(example.capture.stokes[0], example.layers[0]) + 3


def test_what_the_photographs_do_not_tell_stays_uncertain():
    shares = []
    for incidence in (5, 65):
        example = blend(incidence, 64)
        pse = PSE(example.scene, example.capture.angles_deg)
        known = natural_image_layers(example.capture, pse, canvas_for(pse, 64, 64), 0.005)
        shares.append(float(known.unknown_edges[1].sum() / known.edges[1].sum()))
    assert shares[0] > 0.5 > shares[1]


@pytest.mark.parametrize(("height", "width", "shift"), [(16, 16, 3.0), (41, 90, -11.5), (64, 33, 0.0)])
def test_the_canvas_holds_the_frame_and_its_ghosts(height, width, shift):
    pse = PSE(SceneParameters(70, 20, shift), (0, 45, 90, 135))
    canvas = canvas_for(pse, height, width)
    images = np.random.default_rng(0).standard_normal((2, height, width)).astype(np.float32)
    for extended in (canvas.extend(images), canvas.pad_zeros(images), canvas.continued(images)):
        assert extended.shape[-2:] == canvas.shape
        np.testing.assert_array_equal(canvas.crop(extended), images)
    window = canvas.window()
    assert (canvas.crop(window) == 1).all()
    assert window.min() >= 0
    assert min(canvas.top, canvas.left) >= min(abs(shift), height // 2, width // 2)


@pytest.mark.parametrize(("height", "width"), [(16, 16), (41, 90)])
def test_smooth_margins_are_harmonic_between_opposite_edges(height, width):
    canvas = Canvas(height, width, 9, 12, 11, 10)
    images = np.random.default_rng(0).standard_normal((1, height, width)).astype(np.float32)
    extended = canvas.continued(images)[0].astype(np.float64)
    around = sum(np.roll(extended, step, axis) for step in (-1, 1) for axis in (0, 1)) / 4
    assert extended.min() >= images.min()
    assert extended.max() <= images.max()
    deep = np.abs(around - extended)[canvas.top + height + 3 : -1]
    assert deep.max() < 0.1 * images.std()


def test_smooth_margins_pass_straight_from_edge_to_edge():
    canvas = Canvas(20, 30, 4, 5, 6, 7)
    images = np.broadcast_to(np.linspace(0, 1, 30, dtype=np.float32), (20, 30))
    across = canvas.continued(images)[10]
    np.testing.assert_allclose(np.concatenate([across[36:], across[:6]]), np.linspace(1, 0, 15)[1:-1], atol=1e-5)


def test_a_canvas_without_margins_is_the_frame():
    canvas = Canvas(20, 30, 0, 0, 0, 0)
    assert canvas.shape == (20, 30)
    assert (canvas.window() == 1).all()
    images = np.random.default_rng(0).standard_normal((3, 20, 30)).astype(np.float32)
    np.testing.assert_array_equal(canvas.continued(images), images)


def test_no_layout_of_the_basis_is_compiled_by_itself():
    example = blend(55, 48, color=True)
    separate(example.capture, example.scene, stopping=StoppingRule(max_evaluations=2))
    assert len(whiten_gradient.signatures) == 1
