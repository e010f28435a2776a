"""Closed-form layers: per pixel, and per frequency with all ghosts and a natural-image prior fitted to the capture.

Per frequency the photographs are a 2x2 mixture of the layers. The layers are taken as Gaussian with spectra that are
themselves estimated (expectation maximization), each colour of an opponent basis for itself: a Wiener filter.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture, least_squares_entries
from polaropt.inversion.canvas import Canvas
from polaropt.inversion.spectra import Bands, FittedSpectra, FrequencyBands, Power, Spectrum, fit_spectra, moments_of
from polaropt.inversion.transfer import plate_transfer
from polaropt.inversion.variance import Knowledge
from polaropt.inversion.whitening import AssumedHessian
from polaropt.numerics import Basis, each_plane, opponent_basis
from polaropt.optics import PSE, SceneParameters
from priors.natural_image import in_basis

Images = NDArray[np.float32]
Matrix = NDArray[np.float64]

# Standard deviation of a layer's mean before anything is measured, in units of the mean intensity, of which it expects
# all; a single pixel's, before a pane that varies, is a number of its own. Set by hand.
MEAN_SPREAD = 0.5
# Least difference of the two reflectances that is divided by: that of an incidence of 0.13 degrees. Set by hand.
_LEAST_DETERMINANT = 1e-6
# Gradient power of a colour from which the fit starts at least, as a share of the strongest colour's, so that grey
# pictures have chroma to start from; and that of a picture without any edges. Set by hand.
LEAST_COLOR_SHARE, LEAST_EDGE_POWER = 1e-4, 1e-12
# Mean intensity that is never fallen short of (white = 1), so that black photographs divide by something.
LEAST_INTENSITY = 1e-6


@dataclass(frozen=True)
class ClosedForm:
    """Layers on the canvas, and what is known of them.

    Attributes
    ----------
    layers : ndarray of float32, shape (2, channel, H, W)
    mean : ndarray of float32, shape (2, channel, 1, 1)
        Means of the layers in the colour basis.
    prior : ndarray of float32, shape (2, channel, H, W // 2 + 1)
        Power of each layer per frequency before the photographs are seen, in the colour basis, for an orthonormal
        transform.
    told : ndarray of float32, shape (2, H, W // 2 + 1)
        What the photographs tell of each layer per frequency (inverse variance).
    cross : ndarray of complex64, shape (H, W // 2 + 1)
        What they tell of both together: the entry in the transmission's row.
    basis : ndarray, shape (channel, channel)
        The colour basis.
    edges, unknown_edges : ndarray, shape (2, channel)
        Expected gradient energy of each layer before and after the photographs are seen.
    variance : ndarray, shape (2, channel)
        That the photographs leave to a pixel of each layer.
    sampled : Knowledge
        The same at a sample of the frequencies.
    gain_of_less_noise : float
        How many times as much of the reflection's detail a third of the noise would tell. Samples of a mosaic leave
        detail open themselves; infinite of photographs.
    """

    layers: Images
    mean: Images
    prior: Power
    told: Power
    cross: Spectrum
    basis: Basis
    edges: NDArray[np.float64]
    unknown_edges: NDArray[np.float64]
    variance: NDArray[np.float64]
    sampled: Knowledge
    gain_of_less_noise: float = math.inf

    def thinned(self, share: float) -> ClosedForm:
        """The same layers, of which only a share of the photographs' values tell."""
        told, cross = np.float32(share) * self.told, np.float32(share) * self.cross
        return replace(self, told=told, cross=cross, sampled=self.sampled.told_by(share))


def plate_entries(capture: Capture, pse: PSE) -> Images:
    """Least-squares (I_par, I_perp[, s2']) from the trusted photographs of each pixel, (entries, channel, h, w)."""
    return least_squares_entries(capture, pse.mixing[:, : pse.taps.shape[2]])


def per_pixel_layers(capture: Capture, scene: SceneParameters) -> Images:
    """Layers from each pixel's own photographs, all bounces summed in place (paper, Eqs. (3) to (5) at shift 0).

    Parameters
    ----------
    capture : Capture
    scene : SceneParameters
        A complete scene; its shift and the polarization of its light are not used.

    Returns
    -------
    ndarray of float32, shape (2, [channel,] h, w)
        Noise is amplified by the inverse of the difference of the two reflectances.
    """
    incidence_deg, azimuth_deg, _ = scene.values()
    plain = SceneParameters(
        incidence_deg,
        azimuth_deg,
        0.0,
        scene.index,
        single_surface=scene.single_surface,
        n_panes=scene.n_panes,
        absorption=scene.absorption,
    )
    engine = PSE(plain, capture.angles_deg)
    entries = plate_entries(capture, engine)
    (t_p, r_p), (t_s, r_s) = 2 * engine.taps.sum(axis=1).T
    determinant = max(t_p * r_s - r_p * t_s, _LEAST_DETERMINANT)
    inverse = 2 / determinant * np.array([[r_s, -r_p], [-t_s, t_p]])
    layers: Images = np.tensordot(inverse.astype(np.float32), entries, axes=1)
    return layers if capture.color else layers[:, 0]


def natural_image_layers(
    capture: Capture, pse: PSE, canvas: Canvas, noise: float, before: ClosedForm | None = None
) -> ClosedForm:
    """Layers per frequency, with all ghosts, as a Wiener filter whose spectra are fitted to the capture.

    Parameters
    ----------
    capture : Capture
    pse : PSE
    canvas : Canvas
    noise : float
        Standard deviation of one photograph's noise (white = 1).
    before : ClosedForm, optional
        Of other photographs of this size and noise, behind the same pane: its spectra are taken as they are.

    Returns
    -------
    ClosedForm
    """
    mixing = pse.mixing[:, : pse.taps.shape[2]]
    precision = mixing.T @ mixing / noise**2
    basis = opponent_basis(capture.intensities.shape[1] if capture.color else 1)
    entries = in_basis(basis.astype(np.float32), plate_entries(capture, pse), np)
    level = entries.mean(axis=(-1, -2), keepdims=True)
    equations = normal_equations(plate_transfer(pse, *canvas.shape), precision, half_spectra(entries, level, canvas))
    mean = flat_means(level[..., 0, 0], pse, precision * canvas.height * canvas.width, basis)
    if before is not None:
        return replace(before, mean=mean, layers=wiener_layers(equations, before.prior, mean, basis, canvas))
    return fitted_closed_form(equations, initial_power(entries[0] + entries[1]), mean, basis, canvas)


@dataclass(frozen=True)
class NormalEquations:
    """What spectra tell of the layers: (2, H, W // 2 + 1), its entry off the diagonal, and the right-hand side."""

    told: Power
    cross: Spectrum
    right: Spectrum


def fitted_closed_form(
    equations: NormalEquations, power: NDArray[np.float64], mean: Images, basis: Basis, canvas: Canvas
) -> ClosedForm:
    """Wiener filter with spectra fitted to what is seen.

    Parameters
    ----------
    equations : NormalEquations
    power : ndarray, shape (channel,)
        Gradient power per colour of the basis: where the fit starts.
    mean : ndarray, shape (2, channel, 1, 1)
        Of the layers, in the basis.
    basis : ndarray
    canvas : Canvas
    """
    bands = FrequencyBands(*canvas.shape)
    fitted = _fitted(equations, bands, power)
    known = knowledge_of(equations, fitted, bands, mean, basis)
    return replace(known, layers=wiener_layers(equations, known.prior, mean, basis, canvas))


def knowledge_of(
    equations: NormalEquations, fitted: FittedSpectra, bands: Bands, mean: Images, basis: Basis
) -> ClosedForm:
    """What is known of the layers under fitted spectra, without the layers themselves."""
    nothing = np.empty(0, dtype=np.float32)
    arrays = (nothing, mean, fitted.everywhere(bands), equations.told, equations.cross)
    return closed_form_of(arrays, fitted.uncertainty, _sampled(equations, bands, fitted.prior, basis))


def closed_form_of(arrays: tuple[Any, Any, Any, Any, Any], uncertainty: Power, sampled: Knowledge) -> ClosedForm:
    """A closed form from what is known at a sample of the frequencies.

    Parameters
    ----------
    arrays : tuple of ndarray
        Its `layers`, `mean`, `prior`, `told` and `cross`.
    uncertainty : ndarray, shape (2, channel, n)
        Power that remains open at the sample.
    sampled : Knowledge
    """
    edges = sampled.share * sampled.squared_frequency
    return ClosedForm(
        *arrays,
        basis=sampled.basis,
        edges=(sampled.prior * edges).sum(axis=-1, dtype=np.float64),
        unknown_edges=(uncertainty * edges).sum(axis=-1, dtype=np.float64),
        variance=(uncertainty * sampled.share).sum(axis=-1, dtype=np.float64),
        sampled=sampled,
    )


def half_spectra(entries: Images, level: Images, canvas: Canvas) -> Spectrum:
    """Half spectra (entries, channel, H, W // 2 + 1) of entries off their level, mirrored and fading in the margins."""
    from scipy.fft import rfft2

    height, width = canvas.shape
    window = canvas.window()
    spectra = np.empty((*entries.shape[:2], height, width // 2 + 1), dtype=np.complex64)

    def plane(where: tuple[int, int]) -> None:
        spectra[where] = rfft2(canvas.extend(entries[where] - level[where]) * window, norm="ortho")

    each_plane(plane, entries.shape)
    return spectra


def normal_equations(transfer: Spectrum, precision: Matrix, data: Spectrum) -> NormalEquations:
    """What spectra (entries, channel, ...) tell of layers that a pane with this transfer (entries, 2, ...) mixes."""
    weighted = np.tensordot(precision.astype(np.float32), transfer.conj(), axes=1)
    told = np.stack([(weighted[:, i] * transfer[:, i]).real.sum(axis=0) for i in (0, 1)])
    cross = (weighted[:, 0] * transfer[:, 1]).sum(axis=0)
    right = np.stack([sum(weighted[e, i] * data[e] for e in range(len(data))) for i in (0, 1)])
    return NormalEquations(told, cross, right)


def _fitted(equations: NormalEquations, bands: FrequencyBands, power: NDArray[np.float64]) -> FittedSpectra:
    """Spectra fitted at the bands' sample."""
    of_t, of_r = (layer.ravel()[bands.sample] for layer in equations.told)
    both = equations.cross.ravel()[bands.sample]
    information = np.array([[of_t, both], [both.conj(), of_r]])
    sampled = equations.right.reshape(*equations.right.shape[:2], -1)[..., bands.sample]
    return fit_spectra(moments_of(information, sampled), bands, power)


def _sampled(equations: NormalEquations, bands: Bands, prior: Power, basis: Basis) -> Knowledge:
    told = equations.told.reshape(2, -1)[:, bands.sample]
    cross = np.square(np.abs(equations.cross.ravel()[bands.sample]))
    return Knowledge(told, cross, prior, bands.share, bands.squared_frequency, basis)


def wiener_layers(equations: NormalEquations, prior: Power, mean: Images, basis: Basis, canvas: Canvas) -> Images:
    """The layers on the canvas that are most likely under Gaussian layers of these spectra."""
    from polaropt.inversion.compiled_whitening import FusedPreconditioner

    hessian = AssumedHessian(equations.told, equations.cross, np.float32(1) / prior, np.zeros(prior.shape[:2]))
    whitened = FusedPreconditioner(hessian, mean, basis, canvas.shape[1])
    layers = np.empty((*prior.shape[:2], *canvas.shape), dtype=np.float32)
    nothing = np.zeros(whitened.size, dtype=np.float32)
    whitened.layers(whitened.whitened(equations.right, nothing, np.eye(len(basis), dtype=np.float32), 0.0), layers)
    return layers


def initial_power(total: Images) -> NDArray[np.float64]:
    """Gradient power of the total intensity per colour, at least a trifle: where the fit starts, (channel,)."""
    across, down = (np.square(np.diff(total, axis=axis)).mean(axis=(-1, -2), dtype=np.float64) for axis in (-1, -2))
    return at_least_a_trifle(across + down)


def at_least_a_trifle(power: NDArray[np.float64]) -> NDArray[np.float64]:
    """Gradient power per colour from which a fit can start: none so weak that it has nothing to start from."""
    return np.asarray(np.maximum(power, LEAST_COLOR_SHARE * float(power.max()) + LEAST_EDGE_POWER))


def means_of(total: NDArray[np.float32], normal: Matrix, right: Matrix, basis: Basis) -> Images:
    """Means of the layers (2, channel, 1, 1): all bounces in place, with a weak prior at the mean intensity.

    Parameters
    ----------
    total : ndarray, shape (channel,)
        Mean intensity in the colour basis.
    normal : ndarray, shape (2, 2)
        What all pixels tell of the means, an inverse covariance.
    right : ndarray, shape (2, channel)
        The same of each colour times the means.
    basis : ndarray, shape (channel, channel)
    """
    intensity = float(np.linalg.norm(total))
    # Grey.
    expected = intensity * basis.mean(axis=1) * np.sqrt(len(basis))
    spread = np.eye(2) / (MEAN_SPREAD * max(intensity, LEAST_INTENSITY)) ** 2
    means = np.linalg.solve(normal + spread, right + spread @ np.stack([expected, expected]))
    return means.astype(np.float32)[:, :, None, None]


def flat_means(level: NDArray[np.float32], pse: PSE, precision: Matrix, basis: Basis) -> Images:
    """Means of the layers (2, channel, 1, 1) behind a pane that is the same everywhere.

    Parameters
    ----------
    level : ndarray, shape (2, channel)
        Means of the photographs along and across the plane of incidence, in the colour basis.
    pse : PSE
    precision : ndarray, shape (2, 2)
        Inverse covariance of these means.
    basis : ndarray, shape (channel, channel)
    """
    sums = pse.taps.sum(axis=1).T
    told = sums.T @ precision
    return means_of(level[0] + level[1], told @ sums, told @ level, basis)
