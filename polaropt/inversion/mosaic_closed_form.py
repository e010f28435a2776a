"""Closed-form layers at a sensor's full resolution, straight from the samples of its mosaic.

Sampling mixes a frequency with its aliases, a flat pane is a small matrix at each of them: a group of aliases is one
small system in the samples. Under Gaussian layers whose spectra are fitted to the samples its solution is exact.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture, RawSamples
from polaropt.inversion.canvas import Canvas
from polaropt.inversion.closed_form import (
    ClosedForm,
    NormalEquations,
    flat_means,
    initial_power,
    knowledge_of,
    normal_equations,
    plate_entries,
)
from polaropt.inversion.directional_spectra import EQUIVALENT_TURNS, DirectionalBands, fit_directional_spectra
from polaropt.inversion.spectra import FittedSpectra, Moments, Power, Spectrum
from polaropt.inversion.transfer import plate_transfer
from polaropt.inversion.variance import Knowledge
from polaropt.numerics import AliasGroups, Basis, Members, explained_groups, principal_colors, wiener_spectra
from polaropt.optics import PSE
from priors.natural_image import in_basis

Images = NDArray[np.float32]

# Frequencies that the spectra are fitted to, as many as for four full photographs.
SAMPLED_ALIASES = 6144
# Blur before colours are seen to vary together, in pixels: what is finer was interpolated. By trial: 4 does as well.
COLORS_BLUR_PX = 2.0
# Share of a power that remains open at least, and of a determinant: rounding leaves no less. Set by hand.
LEAST_LEFT_OPEN = np.float32(1e-6)
# Of a layer (inverse variance): rounding leaves such numbers where powers lie many orders apart, and single precision
# does not hold their products.
_MOST_TOLD = np.float32(1e18)
# Noise, in units of the samples' own, of which it is asked whether less of it would tell more: of nine times the light.
# Set by hand.
_LESS_NOISE = 1 / 3


def mosaic_layers(capture: Capture, pse: PSE, canvas: Canvas, noise: float) -> ClosedForm:
    """Counterpart of `polaropt.inversion.closed_form.natural_image_layers` for samples of a mosaic.

    Parameters
    ----------
    capture : Capture
        With samples; its photographs continue them beyond the frame and stand where they cannot be trusted.
    pse : PSE
    canvas : Canvas
        Sides that are multiples of the pattern's.
    noise : float
        Standard deviation of a sample's noise (white = 1).
    """
    samples = capture.samples
    if samples is None:
        raise ValueError("the capture has no samples of a mosaic")
    seen = plate_entries(capture, pse)
    # Colours that are not told are told from the others by how they vary together.
    basis = principal_colors(seen[0] + seen[1], COLORS_BLUR_PX)
    entries = in_basis(basis.astype(np.float32), seen, np)
    level = entries.mean(axis=(-1, -2), keepdims=True)
    mixture = _Mixture(samples, pse, canvas, noise, basis)
    data = mixture.spectrum(capture, in_basis(basis.T.astype(np.float32), level, np)[..., 0, 0])
    fitted, bands, known, clearer = mixture.fitted(data, initial_power(entries[0] + entries[1]))
    prior = fitted.everywhere(bands)
    layers = mixture.layers(data, prior)
    precision = mixture.precision
    mean = flat_means(level[..., 0, 0], pse, precision * canvas.height * canvas.width, basis)
    nothing = np.zeros((len(mixture.transfer), 1, 1, 1), np.complex64)
    of_frequency = normal_equations(mixture.transfer, precision, nothing)
    equations = NormalEquations(of_frequency.told, of_frequency.cross, np.empty(0, np.complex64))
    closed = knowledge_of(equations, fitted, bands, mean, basis)
    layers += in_basis(basis.T.astype(np.float32), mean, np)
    told = known.told_detail()
    gain = clearer.told_detail() / told if told > 0 else math.inf
    return replace(closed, layers=layers, sampled=known, gain_of_less_noise=gain)


class _Mixture:
    """How a pane and a mosaic mix the frequencies of both layers."""

    def __init__(self, samples: RawSamples, pse: PSE, canvas: Canvas, noise: float, basis: Basis) -> None:
        self.transfer = plate_transfer(pse, *canvas.shape)
        self._samples, self._canvas, self._noise_power, self._basis = samples, canvas, noise**2, basis
        self._mixing = pse.mixing[:, : pse.taps.shape[2]]
        sampling = samples.sampling
        # Each pixel of a colour mosaic tells one colour of three, and one photograph of four.
        self.precision: NDArray[np.float64] = self._mixing.T @ self._mixing / noise**2
        self.precision /= sampling.n_channels * len(self._mixing)
        self.groups = AliasGroups(*canvas.shape, sampling.period)
        seen = sampling.moved(-canvas.top, -canvas.left)
        self.combs = self.groups.combs(seen.weights(self._mixing, basis))

    def spectrum(self, capture: Capture, level: NDArray[Any]) -> Spectrum:
        """Half spectrum of the samples off the level (entry, channel), mirrored and fading in the margins."""
        from scipy.fft import rfft2

        canvas, samples = self._canvas, self._samples
        sampling, levels = samples.sampling, self._mixing @ level
        photographs = capture.intensities.reshape(-1, sampling.n_channels, canvas.height, canvas.width)
        rows, columns = (
            np.pad(np.arange(side), margins, mode="symmetric")
            for side, margins in (
                (canvas.height, (canvas.top, canvas.bottom)),
                (canvas.width, (canvas.left, canvas.right)),
            )
        )
        whole = np.empty(canvas.shape, np.float32)
        period = sampling.period
        for photograph, channel, row, column in sampling.moved(-canvas.top, -canvas.left).places:
            here = (slice(row, None, period), slice(column, None, period))
            seen = photographs[photograph, channel][rows[here[0]]][:, columns[here[1]]]
            whole[here] = seen - np.float32(levels[photograph, channel])
        inside = canvas.crop(whole)
        own = samples.values - sampling.laid_out(levels, samples.values.shape)
        np.copyto(inside, own, where=samples.valid)
        whole *= canvas.window()
        return np.asarray(rfft2(whole, norm="ortho"), dtype=np.complex64)

    def fitted(
        self, data: Spectrum, power: NDArray[np.float64]
    ) -> tuple[FittedSpectra, DirectionalBands, Knowledge, Knowledge]:
        """Spectra under which the samples are likeliest, and what these, and clearer ones, then tell of the layers."""
        members, counts = self.groups.sample(SAMPLED_ALIASES // self.groups.period**2)
        height, width = self._canvas.shape
        shares = np.broadcast_to(counts, members.index.shape).ravel()
        bands = DirectionalBands(height, width, members.index.ravel(), shares)
        transfer, samples = members.of(self.transfer), members.of(data)
        fitted = fit_directional_spectra(self._moments(transfer, samples), bands, power)
        known, clearer = (
            Knowledge(
                *self._information(transfer, samples, fitted.prior, noise**2 * self._noise_power),
                fitted.prior,
                bands.share,
                bands.squared_frequency,
                self._basis,
                EQUIVALENT_TURNS,
            )
            for noise in (1.0, _LESS_NOISE)
        )
        return fitted, bands, known, clearer

    def _moments(self, transfer: Spectrum, samples: Spectrum) -> Moments:
        """Of the layers at some groups: transfer (entry, 2, alias, group), samples (alias, group)."""

        def moments(prior: Power) -> tuple[Power, Power]:
            power = prior.reshape(*prior.shape[:2], *samples.shape)
            found = explained_groups(
                self.combs, _covariance(transfer, power), self._noise_power, samples, information=True
            )
            mean = power * np.einsum("elag,ceag->lcag", transfer.conj(), found.mean)
            told = np.einsum("elag,cefag,flag->lcag", transfer.conj(), found.information, transfer, optimize=True).real
            # What remains is positive but for rounding.
            left = np.maximum(power - power * told * power, LEAST_LEFT_OPEN * power)
            expected = np.square(mean.real) + np.square(mean.imag) + left
            return expected.reshape(prior.shape), left.reshape(prior.shape)

        return moments

    def _information(
        self, transfer: Spectrum, samples: Spectrum, prior: Power, noise_power: float
    ) -> tuple[Power, Power]:
        """What is told of each layer, (2, color, n), and of both together, (color, n), beside all aliases.

        As if there were none: the difference of the layers' inverse covariances after and before.
        """
        power = prior.reshape(*prior.shape[:2], *samples.shape)
        found = explained_groups(self.combs, _covariance(transfer, power), noise_power, samples, information=True)
        told = np.einsum("elag,cefag,fmag->clmag", transfer.conj(), found.information, transfer, optimize=True)
        p_t, p_r = power
        v_t = np.maximum(p_t - p_t * told[:, 0, 0].real * p_t, LEAST_LEFT_OPEN * p_t)
        v_r = np.maximum(p_r - p_r * told[:, 1, 1].real * p_r, LEAST_LEFT_OPEN * p_r)
        v_x = p_t * np.abs(told[:, 0, 1]) * p_r
        determinant = np.maximum(v_t * v_r - v_x**2, LEAST_LEFT_OPEN * v_t * v_r)
        of_both = [np.clip(v / determinant - 1 / p, 0, _MOST_TOLD) for v, p in ((v_r, p_t), (v_t, p_r))]
        cross = np.square(np.minimum(v_x / determinant, np.sqrt(of_both[0] * of_both[1])))
        n_colors = prior.shape[1]
        return np.stack(of_both).reshape(2, n_colors, -1), cross.reshape(n_colors, -1)

    def layers(self, data: Spectrum, prior: Power) -> Images:
        """The likeliest layers (2, channel, H, W) off their means."""
        from scipy.fft import irfft2

        def system(members: Members) -> tuple[Spectrum, Callable[[Spectrum], Spectrum]]:
            transfer, power = members.of(self.transfer), members.of(prior)

            def images(mean: Spectrum) -> Spectrum:
                t, r = (sum(transfer[e, i].conj() * mean[:, e] for e in range(len(transfer))) for i in (0, 1))
                return np.stack([power[0] * t, power[1] * r], axis=1)

            return _covariance(transfer, power), images

        spectra = wiener_spectra(self.groups, self.combs, system, self._noise_power, data, 2)
        colors, _ = spectra.shape[:2]
        own = np.empty((2, colors, *self._canvas.shape), np.float32)
        for c, layer in np.ndindex(colors, 2):
            own[layer, c] = irfft2(spectra[c, layer], s=self._canvas.shape, norm="ortho", overwrite_x=True)
        return np.asarray(in_basis(self._basis.T.astype(np.float32), own, np), dtype=np.float32)


def _covariance(transfer: Spectrum, power: Power) -> Spectrum:
    """Covariance (color, entry, entry, ...) of entries of layers with this power (2, color, ...)."""
    n_entries = len(transfer)
    covariance = np.empty((power.shape[1], n_entries, n_entries, *power.shape[2:]), np.complex64)
    for e in range(n_entries):
        for f in range(e + 1):
            t, r = transfer[e, 0] * transfer[f, 0].conj(), transfer[e, 1] * transfer[f, 1].conj()
            covariance[:, e, f] = power[0] * t + power[1] * r
            if e != f:
                covariance[:, f, e] = covariance[:, e, f].conj()
    return covariance
