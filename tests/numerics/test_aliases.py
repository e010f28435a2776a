"""Groups of aliases: their filter is the Gaussian posterior of images behind a mosaic, to the last frequency."""

import numpy as np
import pytest

from polaropt.capture.mosaic import sampling_of
from polaropt.numerics import AliasGroups, explained_groups, wiener_spectra


def stationary(power, shape):
    """Covariance (pixels, pixels) of a periodic image with a power per frequency of an orthonormal transform."""
    n = shape[0] * shape[1]
    basis = np.fft.ifft2(np.eye(n).reshape(n, *shape), norm="ortho").reshape(n, n)
    return (basis.T * power.ravel() @ basis.conj()).real


@pytest.mark.parametrize(("color", "shape"), [(False, (8, 12)), (True, (8, 8))])
def test_the_filter_is_the_posterior_mean_of_a_dense_solve(color, shape):
    random = np.random.default_rng(1)
    sampling, _ = sampling_of(color)
    n_images, noise = 2, 0.3
    weights = random.standard_normal((1, n_images, sampling.period**2))
    laid_out = np.array([sampling_weights(w, sampling.period, shape) for w in weights[0]])
    f = np.hypot(np.fft.fftfreq(shape[0])[:, None], np.fft.fftfreq(shape[1])) + 0.1
    powers = np.array([f**-2.0, 0.5 * f**-1.5])
    raw = random.standard_normal(shape)
    covariances = [stationary(power, shape) for power in powers]
    mixed = sum(w.ravel()[:, None] * c * w.ravel() for w, c in zip(laid_out, covariances, strict=True))
    solved = np.linalg.solve(mixed + noise * np.eye(raw.size), raw.ravel())
    expected = [(c @ (w.ravel() * solved)).reshape(shape) for w, c in zip(laid_out, covariances, strict=True)]

    groups = AliasGroups(*shape, sampling.period)
    half = powers[..., : shape[1] // 2 + 1]

    def system(members):
        own = members.of(half)
        return np.einsum("iag,ij->ijag", own, np.eye(2))[None].astype(np.complex64), lambda mean: own * mean

    data = np.fft.rfft2(raw, norm="ortho").astype(np.complex64)
    spectra = wiener_spectra(groups, groups.combs(weights), system, noise, data, n_images)
    np.testing.assert_allclose(np.fft.irfft2(spectra[0], shape, norm="ortho"), expected, atol=2e-4)


def sampling_weights(weights, period, shape):
    return np.tile(weights.reshape(period, period), (shape[0] // period, shape[1] // period))


def test_the_information_is_the_posterior_covariance():
    random = np.random.default_rng(2)
    groups = AliasGroups(8, 8, 2)
    combs = groups.combs(random.standard_normal((1, 1, 4)))
    members, counts = groups.sample(100)
    assert counts.tolist() == [1] * 16
    power = random.uniform(0.5, 2, members.index.shape)
    data = random.standard_normal((2, *members.index.shape)).T.copy().view(complex)[..., 0].T
    found = explained_groups(combs, power[None, None, None].astype(np.complex64), 0.4, data, information=True)
    for g in range(16):
        covariance = combs[0, 0] * power[:, g] @ combs[0, 0].conj().T + 0.4 * np.eye(4)
        solved = np.linalg.inv(covariance)
        information = np.diag(combs[0, 0].conj().T @ solved @ combs[0, 0])
        np.testing.assert_allclose(found.information[0, 0, 0, :, g], information, rtol=1e-4, atol=1e-5)
        np.testing.assert_allclose(found.mean[0, 0, :, g], combs[0, 0].conj().T @ solved @ data[:, g], atol=1e-4)


def test_samples_that_repeat_each_other_to_the_last_digit_are_not_magnified():
    # Slow frequencies a thousand million times stronger than the noise, and next to nothing else: single precision
    # cannot hold what is left of a sample once others are known, and layers of clipped mosaics became infinite.
    random = np.random.default_rng(3)
    sampling, _ = sampling_of(True)
    groups = AliasGroups(32, 32, sampling.period)
    combs = groups.combs(sampling.weights(np.array([[1, 0], [0.5, 0.5], [0, 1], [0.5, 0.5]]), np.eye(3)))
    members, _ = groups.sample(1000)
    shape = members.index.shape
    power = 10 ** random.uniform(-9, -6, shape)
    power[0] = 10 ** random.uniform(2, 5, shape[1])
    covariance = np.einsum("ag,ef->efag", power, np.eye(2))[None].repeat(3, axis=0).astype(np.complex64)
    data = 10 * (random.standard_normal(shape) + 1j * random.standard_normal(shape)).astype(np.complex64)
    found = explained_groups(combs, covariance, 1e-6, data, information=True)
    assert np.isfinite(found.mean).all()
    assert np.isfinite(found.information).all()
    known = np.einsum("ceeag->ceag", found.information).real[:, :, 0] * power[0]
    np.testing.assert_allclose(known, 1, atol=1e-4)


def test_a_frame_of_no_whole_patterns_is_refused():
    with pytest.raises(ValueError, match="no whole patterns"):
        AliasGroups(10, 9, 2)


@pytest.mark.parametrize(("shape", "period"), [((8, 12), 2), ((12, 10), 2), ((16, 24), 4), ((8, 12), 4)])
def test_every_frequency_is_written_by_one_group(shape, period):
    groups = AliasGroups(*shape, period)
    written = np.zeros(shape[0] * (shape[1] // 2 + 1), dtype=int)
    for row in range(groups.n_rows):
        members = groups.members(row, np.arange(groups.n_columns))
        np.add.at(written, members.index[members.own], 1)
    assert written.tolist() == [1] * written.size
