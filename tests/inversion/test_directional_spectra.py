import numpy as np
import pytest

from polaropt.inversion.directional_spectra import DirectionalBands, fit_directional_spectra
from polaropt.inversion.spectra import moments_of
from polaropt.numerics import column_multiplicity, frequencies, natural_frequencies

HEIGHT, WIDTH, NOISE = 96, 100, 0.01


def all_bands():
    counts = np.tile(column_multiplicity(WIDTH), HEIGHT)
    return DirectionalBands(HEIGHT, WIDTH, np.arange(counts.size), counts)


def test_nodes_share_all_frequencies_and_are_linear_between():
    bands = all_bands()
    assert bands.share.sum() == pytest.approx(1, rel=1e-6)
    assert bands.sums(bands.share).sum() == pytest.approx(1, rel=1e-6)
    np.testing.assert_allclose(bands.at_sample(np.full(bands.n_nodes, 0.7)), np.exp(0.7), rtol=1e-5)


def test_a_table_has_the_power_of_the_sample():
    bands = all_bands()
    logarithms = np.random.default_rng(0).standard_normal(bands.n_nodes)
    law = natural_frequencies(HEIGHT, WIDTH).ravel() ** -1.2
    expected = np.log(3 * law * bands.at_sample(logarithms))
    found = np.log(bands.power_law(3.0, logarithms)).ravel()
    assert np.abs(found - expected).mean() < 0.02


def test_directions_and_a_lens_are_found():
    bands = all_bands()
    squared = natural_frequencies(HEIGHT, WIDTH)
    down, across = frequencies(HEIGHT, WIDTH)
    # One layer of edges across, one blurred by a lens.
    along = 1 + 3 * across**2 / (down**2 + across**2 + 1e-9)
    true = np.stack([[0.02 * along / squared**1.2], [0.1 * np.exp(-squared / 3) / squared**1.2]])
    random = np.random.default_rng(1)
    white = np.fft.rfft2(random.standard_normal((2, 1, HEIGHT, WIDTH)), norm="ortho")
    mixing = np.array([[0.9, 0.1], [0.7, 0.3]])
    data = np.einsum("el,lchw->echw", mixing, white * np.sqrt(true))
    data += NOISE * np.fft.rfft2(random.standard_normal((2, 1, HEIGHT, WIDTH)), norm="ortho")
    information = np.broadcast_to((mixing.T @ mixing / NOISE**2)[:, :, None], (2, 2, squared.size)).astype(complex)
    right = np.einsum("el,echw->lchw", mixing, data).reshape(2, 1, -1) / NOISE**2
    found = fit_directional_spectra(moments_of(information, right), bands, np.array([0.05]))
    off = np.abs(np.log(found.everywhere(bands) / true))
    assert off[:, :, squared < 4].mean() < 0.25
