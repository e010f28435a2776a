"""Ghost shift of a flat pane by the likelihood of a mosaic's samples as a function of the shift.

A scene is estimated from one pixel per pattern, low-passed against aliases: ghosts a few pixels apart are hardly
resolved there, and the low pass is taken for ghosts close together. The samples themselves tell where the ghosts are,
once the rest of the pane is known: like `polaropt.estimation.flat.ghosts`, by Welch's mean periodograms and Student's
likelihood, but of whole groups of frequencies that the mosaic mixes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture, RawSamples
from polaropt.estimation.flat.ghosts import (
    DEGREES_OF_FREEDOM,
    FIRST_LEVEL,
    LEAST_FACTOR,
    LEAST_SHIFT_PX,
    LOWEST_CYCLES,
    spectral_shapes,
    tile_corners,
)
from polaropt.inversion import ghost_transfer_at
from polaropt.numerics import (
    AliasGroups,
    Members,
    frequencies,
    hann_window,
    local_minimum,
    minimum_error,
    opponent_basis,
)
from polaropt.optics import PSE, SceneParameters

Matrices = NDArray[np.complex64]
Levels = NDArray[np.float64]

_TILE_PX = {2: (64, 128), 4: (64,)}
"""Sides of tiles for a pattern's period, the least that serves is taken: groups of a colour mosaic are large, so that
larger tiles would take seconds. By trial."""
_FARTHEST_IN_TILE = 0.25
"""Farthest ghosts in units of a tile's side: beyond, its window tells them from the direct light, but pixels of a
pattern each resolve them. By trial."""
_TRUSTED_NOISE = 1.4
"""Noise that the samples are taken to have, in units of their own. By trial: tiles are no exact part of a scene."""
_SHAPES = (6, 2)
"""Radii and directions into which the layers' spectra are split: the roll-off of a lens needs more than a few. By
trial."""
_FIRST_ROUNDS, _ROUNDS = 12, 4
"""Rounds of the fit of the spectra without ghosts, and from there with them. By trial."""
_BANDS = 6
"""Bands of tiles that are left out in turn for the standard error. Set by hand."""
_NEAREST, _FARTHEST, _ROOM_PX = 0.4, 2.5, 1.5
"""Distances that are tried: between so many times that of the cells, less or more so many pixels. By trial."""
_NO_GHOSTS_PX = 6.0
"""Farthest ghosts that are tried where the cells show none. Set by hand."""
_STEP_PX, _TOLERANCE_PX = 1.0, 0.1
"""Between the shifts that are tried, and of the least of them."""


@dataclass(frozen=True)
class SampledShift:
    """Ghost shift in pixels of the sensor, signed, and its standard error."""

    shift_px: float
    error_px: float


def sampled_shift(
    samples: RawSamples,
    angles_deg: tuple[float, ...],
    scene: SceneParameters,
    noise: float,
    *,
    sense_only: bool = False,
) -> SampledShift | None:
    """Where a mosaic's samples have the ghosts of a flat pane; None if farther off than they need to be asked.

    Parameters
    ----------
    samples : RawSamples
    angles_deg : tuple of float
        Of the photographs that they sample.
    scene : SceneParameters
        Complete, in pixels of the sensor; its ghost shift says where about to look, to both sides.
    noise : float
        Standard deviation of a sample's noise.
    sense_only : bool
        Whether the distance is known.
    """
    about = abs(scene.values()[2])
    sides = _TILE_PX[samples.sampling.period]
    if about > _FARTHEST_IN_TILE * sides[-1]:
        return None
    farthest = min(_FARTHEST * about + _ROOM_PX, _FARTHEST_IN_TILE * sides[-1]) if about else _NO_GHOSTS_PX
    tile = next(side for side in sides if farthest <= _FARTHEST_IN_TILE * side)
    tile = min(tile, *samples.values.shape)
    likelihood = SampledShiftLikelihood(samples, angles_deg, scene, _TRUSTED_NOISE * noise, tile)
    if sense_only:
        return SampledShift(min(about, -about, key=likelihood.misfit), 0.0)
    nearest = max(_STEP_PX, _NEAREST * about - _STEP_PX / 2)
    distances = np.arange(nearest, max(farthest, nearest + 2 * _STEP_PX), _STEP_PX)
    shifts = [0.0, *distances, *(-distances)]
    best = min(shifts, key=likelihood.misfit)
    side = (-farthest, 0.0) if best < 0 else (0.0, farthest)
    if best:
        best = local_minimum(likelihood.misfit, best, side, _STEP_PX / 2, _TOLERANCE_PX)
    if abs(best) < LEAST_SHIFT_PX:
        return SampledShift(0.0, LEAST_SHIFT_PX)
    around = [likelihood.left_out(best + step) for step in (-_STEP_PX / 2, 0.0, _STEP_PX / 2)]
    return SampledShift(float(best), minimum_error(around, _STEP_PX / 2))


class SampledShiftLikelihood:
    """Likelihood of ghost shifts given a mosaic's samples, the rest of a flat pane known.

    Parameters
    ----------
    samples : RawSamples
    angles_deg : tuple of float
        Of the photographs that they sample.
    scene : SceneParameters
        Complete but for its ghost shift, in pixels of the sensor.
    noise : float
        Standard deviation that a sample's noise is taken to have.
    tile_px : int
        Side of the tiles that are looked at.
    """

    def __init__(
        self,
        samples: RawSamples,
        angles_deg: tuple[float, ...],
        scene: SceneParameters,
        noise: float,
        tile_px: int,
    ) -> None:
        sampling = samples.sampling
        self._angles_deg, self._scene, self._noise = angles_deg, scene, noise
        self._side = tile_px // sampling.period * sampling.period
        self._groups = AliasGroups(self._side, self._side, sampling.period)
        self._members, self._multiplicity = _usable(self._groups)
        self._data = self._mean_products(samples)
        """(band, group, alias, alias): mean products of the samples' spectra."""
        self._mean = self._data.mean(axis=0)
        rows, columns = np.divmod(self._members.index, self._side // 2 + 1)
        down, across = frequencies(self._side, self._side)
        shapes = spectral_shapes(across[0, columns.ravel()], down[rows.ravel(), 0], *_SHAPES)
        self._shapes = shapes.reshape(len(shapes), *rows.shape)
        colors = opponent_basis(sampling.n_channels)
        mixing = PSE(scene.replace(ghost_shift=0.0), angles_deg).mixing[:, :2]
        self._combs = self._groups.combs(sampling.weights(mixing, colors))
        first = np.full((len(colors), 2, len(shapes)), FIRST_LEVEL)
        self._levels = self._fitted(self._responses(0.0), first, _FIRST_ROUNDS)

    def misfit(self, shift_px: float) -> float:
        """Minus log likelihood per frequency of a shift (signed), up to a constant."""
        return float(self._misfits(shift_px, self._mean[None])[0])

    def left_out(self, shift_px: float) -> NDArray[np.float64]:
        """The same without each band of tiles in turn, (band,)."""
        n = len(self._data)
        rest = (self._data.sum(axis=0) - self._data) / max(1, n - 1)
        return self._misfits(shift_px, rest if n > 1 else self._data)

    def _misfits(self, shift_px: float, data: Matrices) -> NDArray[np.float64]:
        responses = self._responses(shift_px)
        covariance = self._covariance(responses, self._fitted(responses, self._levels, _ROUNDS))
        inverse = np.linalg.inv(covariance)
        _, determinant = np.linalg.slogdet(covariance)
        n, nu = covariance.shape[-1], DEGREES_OF_FREEDOM
        distance = np.einsum("gmn,bgnm->bg", inverse, data).real
        value = (determinant + (nu / 2 + n) * np.log(nu + 2 * distance)) @ self._multiplicity
        return np.asarray(value / self._multiplicity.sum())

    def _mean_products(self, samples: RawSamples) -> Matrices:
        from scipy.fft import rfft2

        side, period = self._side, samples.sampling.period
        profile = hann_window(side)
        window = np.outer(profile, profile)
        window /= np.sqrt(np.sum(window**2))
        corners = tile_corners(samples.valid, side, period)
        sums = np.zeros((min(_BANDS, len(corners)), self._multiplicity.size, period**2, period**2), np.complex64)
        counts = np.zeros(len(sums))
        for i, (top, left) in enumerate(corners):
            part = (slice(top, top + side), slice(left, left + side))
            tile = _off_level(samples.values[part], samples.valid[part], window, period)
            spectrum = self._members.of(rfft2(tile * window)).T
            band = i * len(sums) // len(corners)
            sums[band] += spectrum[:, :, None] * spectrum[:, None].conj()
            counts[band] += 1
        return np.asarray(sums / counts[:, None, None, None].astype(np.float32), dtype=np.complex64)

    def _responses(self, shift_px: float) -> Matrices:
        """What each frequency of each layer leaves in the samples: (group, alias, color, layer, frequency)."""
        pse = PSE(self._scene.replace(ghost_shift=shift_px), self._angles_deg)
        index = self._members.index
        shape = (self._side, self._side)
        transfer = ghost_transfer_at(pse.taps, pse.displacements, shape, index.ravel())[:2]
        transfer = self._members.conjugated(transfer.reshape(2, 2, *index.shape))
        responses = np.einsum("cemt,eltg->gmclt", self._combs, transfer, optimize=True)
        return np.asarray(responses, dtype=np.complex64)

    def _covariance(self, responses: Matrices, levels: Levels) -> Matrices:
        n_groups, n = responses.shape[:2]
        power = np.einsum("clk,ktg->gclt", levels.astype(np.float32), self._shapes).reshape(n_groups, 1, -1)
        flat = responses.reshape(n_groups, n, -1)
        covariance = (flat * power) @ flat.conj().swapaxes(1, 2)
        covariance += np.float32(self._noise**2) * np.eye(n, dtype=np.float32)
        return np.asarray(covariance)

    def _fitted(self, responses: Matrices, levels: Levels, rounds: int) -> Levels:
        """Levels of the layers' spectra, by multiplicative steps towards the maximum of the likelihood."""
        n_groups, n = responses.shape[:2]
        flat, data, nu = responses.reshape(n_groups, n, -1), self._mean, DEGREES_OF_FREEDOM

        def sums(values: NDArray[Any]) -> Levels:
            weighted = (values * self._multiplicity[:, None].astype(np.float32)).reshape(n_groups, *responses.shape[2:])
            return np.asarray(np.einsum("gclt,ktg->clk", weighted, self._shapes))

        for _ in range(rounds):
            inverse = np.linalg.inv(self._covariance(responses, levels))
            distance = np.einsum("gmn,gnm->g", inverse, data).real
            surprise = (nu + 2 * n) / (nu + 2 * distance)
            toward = inverse @ flat
            explained = np.einsum("gmu,gmu->gu", flat.conj(), toward).real
            found = np.einsum("gmu,gmu->gu", toward.conj(), data @ toward).real * surprise[:, None]
            levels = levels * np.maximum(sums(found) / sums(explained), LEAST_FACTOR)
        return levels


def _usable(groups: AliasGroups) -> tuple[Members, NDArray[np.float64]]:
    """Members of the groups that are looked at, and for how many groups each stands: itself and its conjugate."""
    side = groups.n_rows
    rows, columns = (grid.ravel() for grid in np.mgrid[:side, : groups.n_columns])
    use = np.hypot(np.minimum(rows, side - rows), columns) > LOWEST_CYCLES
    multiplicity = np.where((columns == 0) | (2 * columns == side), 1.0, 2.0)
    return groups.members(rows[use], columns[use]), multiplicity[use]


def _off_level(values: NDArray[Any], valid: NDArray[Any], window: NDArray[Any], period: int) -> NDArray[Any]:
    """A tile less the level of each pixel of the pattern, which stands for what is not valid."""
    shape = (values.shape[0] // period, period, values.shape[1] // period, period)
    weights = np.where(valid, window, 0).reshape(shape)
    of_pattern = values.reshape(shape)
    total = np.maximum(weights.sum(axis=(0, 2), keepdims=True), np.finfo(np.float64).tiny)
    level = (of_pattern * weights).sum(axis=(0, 2), keepdims=True) / total
    return np.where(valid.reshape(shape), of_pattern - level, 0).reshape(values.shape)


def shift_of_samples(
    capture: Capture, scene: SceneParameters, noise: float, *, sense_only: bool = False
) -> SampledShift | None:
    """The ghost shift in pixels of the capture that its samples tell; None where they are not asked.

    Parameters
    ----------
    capture : Capture
        Of a mosaic.
    scene : SceneParameters
        Complete, in pixels of the capture.
    noise : float
        Standard deviation of a sample's noise.
    sense_only : bool
        Whether the distance is known.
    """
    cells = capture.cells
    flat = scene.rung in ("pixelwise", "ghosts") and not scene.single_surface and scene.n_bounces != 0
    if cells is None or not flat or scene.stacked or scene.transmission_ghost_shift is not None:
        return None
    of_sensor = cells.samples.sampling.period / cells.scale
    found = sampled_shift(cells.samples, capture.angles_deg, scene.scaled(of_sensor), noise, sense_only=sense_only)
    return None if found is None else SampledShift(found.shift_px / of_sensor, found.error_px / of_sensor)
