"""Ghost shift and incidence of a flat pane by the likelihood of a mosaic's samples as a function of them.

A scene is estimated from one pixel per pattern, low-passed against aliases: ghosts a few pixels apart are hardly
resolved there, and the low pass is taken for ghosts close together. The samples themselves tell where the ghosts are,
once the rest of the pane is known: like `polaropt.estimation.flat.ghosts`, by Welch's mean periodograms and Student's
likelihood, but of whole groups of frequencies that the mosaic mixes.

They tell the incidence, too, by how bright the ghosts are and by what both polarizations have in common. Edges that
both layers share mislead the overlap of their edges, and what aliases does; a likelihood of whole spectra cares for
neither, but for what the spectra's shape is taken to be. So both have a say, each as far as it is sure.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture, RawSamples
from polaropt.estimation.flat.errors import weighted_mean, widened_incidence
from polaropt.estimation.flat.ghosts import (
    DEGREES_OF_FREEDOM,
    FIRST_LEVEL,
    LEAST_FACTOR,
    LEAST_SHIFT_PX,
    LOWEST_CYCLES,
    is_of_two_faces,
    spectral_shapes,
    tile_corners,
)
from polaropt.inversion import ghost_transfer_at
from polaropt.numerics import (
    AliasGroups,
    Members,
    frequencies,
    hann_tile,
    local_minimum,
    minimum_error,
    opponent_basis,
    vertex,
)
from polaropt.optics import INCIDENCE_LIMITS_DEG, INCIDENCE_SEARCH_DEG, PSE, SceneParameters

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
_FIRST_ROUNDS, _ROUNDS, _TRIAL_ROUNDS = 12, 4, 3
"""Rounds of the fit of the spectra without ghosts, from there with them, and where many shifts are tried. By trial."""
_BANDS = 6
"""Bands of tiles that are left out in turn for the standard error. Set by hand."""
_NEAREST, _FARTHEST, _ROOM_PX = 0.4, 2.5, 1.5
"""Distances that are tried: between so many times that of the cells, less or more so many pixels. By trial."""
_NO_GHOSTS_PX = 6.0
"""Farthest ghosts that are tried where the cells show none. Set by hand."""
_STEP_PX, _TOLERANCE_PX = 1.0, 0.1
"""Between the shifts that are tried, and of the least of them."""
_STEP_DEG, _ROUGHLY_DEG, _TOLERANCE_DEG = 2.0, 1.0, 0.3
"""Between the first incidences that are tried, of the least of them where shifts are compared, and at the end."""
_APART_DEG = 3.0
"""Between incidences at which shifts are compared: what the one explains the other may, too. By trial."""
_NEAR_DEG = 12.0
"""Farthest from the cells' incidence that is tried. Set by hand."""
_SUREST_PX = 0.2
"""Standard error of a shift in pixels below which none is believed. Set by hand."""
_MODEL_PX = {2: 0.15, 4: 0.55}
"""Standard error of a shift in pixels that a jackknife does not see, by the side of the sensor's pattern: patterns of
the scene draw the shift their way in all tiles alike. Of 40 simulated mosaics of training photographs (35 to 75
degrees, shifts of 2 to 10 px, noise 0.3 to 1.5 %) 28 told one, off by 0.15 (mono) and 0.58 px (colour), the median."""
_MODEL_DEG = 0.6
"""Standard error of the incidence that a jackknife does not see, as all tiles share it: spectra are not quite of the
shape that they are taken to have. By trial on mosaics of photographs that no figure is taken of."""


@dataclass(frozen=True)
class SampledPane:
    """Ghost shift in pixels, signed, and incidence in degrees; with standard errors, None where it is not told.

    Attributes
    ----------
    shift_px : float
    shift_error_px : float or None
    incidence_deg : float
    incidence_error_deg : float or None
    """

    shift_px: float
    shift_error_px: float | None
    incidence_deg: float
    incidence_error_deg: float | None

    @property
    def incidence(self) -> tuple[float, float] | None:
        """Incidence and its standard error; None where it is not told."""
        error = self.incidence_error_deg
        return None if error is None else (self.incidence_deg, error)


def sampled_pane(
    samples: RawSamples,
    angles_deg: tuple[float, ...],
    scene: SceneParameters,
    noise: float,
    *,
    incidence_error_deg: float = math.inf,
    open_shift: bool = True,
    open_incidence: bool = True,
    sense_only: bool = False,
) -> SampledPane | None:
    """Where a mosaic's samples have the ghosts of a flat pane, and its incidence; None if ghosts are too far off.

    Parameters
    ----------
    samples : RawSamples
    angles_deg : tuple of float
        Of the photographs that they sample.
    scene : SceneParameters
        Complete, in pixels of the sensor; its ghost shift says where about to look, to both sides, and so does its
        incidence.
    noise : float
        Standard deviation of a sample's noise.
    incidence_error_deg : float
        Standard error of the scene's incidence: it has a say where shifts are compared.
    open_shift, open_incidence : bool
        Which of both is to be told.
    sense_only : bool
        Whether the ghosts' distance is known, and nothing but their side is to be told.
    """
    start, _, shift = scene.values()
    about, reach = abs(shift), _FARTHEST_IN_TILE * _TILE_PX[samples.sampling.period][-1]
    if about > reach:
        return None
    farthest = min(_FARTHEST * about + _ROOM_PX, reach) if about else _NO_GHOSTS_PX
    likelihood = _likelihood(samples, angles_deg, scene, noise, farthest)
    if sense_only:
        return SampledPane(min(about, -about, key=likelihood.misfit), None, start, None)
    best = 0.0 if open_shift else shift
    search = _Search(likelihood, (best, start), incidence_error_deg if open_incidence else None)
    incidence, error = search.first_deg, None
    if open_shift:
        nearest = max(_STEP_PX, _NEAREST * about - _STEP_PX / 2)
        distances = np.arange(nearest, max(farthest, nearest + 2 * _STEP_PX), _STEP_PX)
        panes = (search.with_incidence(0.0, incidence), search.with_ghosts(distances, farthest))
        best, incidence = min(panes, key=lambda pane: search.score(*pane))
        best = best if abs(best) >= LEAST_SHIFT_PX else 0.0
        error = _shift_error(likelihood, best, incidence)
    if open_incidence:
        incidence = search.likeliest_incidence(best, incidence)
    return SampledPane(
        best,
        error,
        incidence,
        _incidence_error(likelihood, best, incidence) if open_incidence else None,
    )


def sampled_shift(
    samples: RawSamples, angles_deg: tuple[float, ...], scene: SceneParameters, noise: float, error_px: float
) -> tuple[float, float]:
    """Ghost shift of a flat pane near that of a scene, as this and a mosaic's samples have it; and its standard error.

    Parameters
    ----------
    samples, angles_deg, noise
        As of `sampled_pane`.
    scene : SceneParameters
        Complete, in pixels of the sensor, with ghosts that lie apart.
    error_px : float
        Standard error of its ghost shift.
    """
    incidence, _, shift = scene.values()
    likelihood = _likelihood(samples, angles_deg, scene, noise, abs(shift) + _ROOM_PX)
    low, high = shift - _ROOM_PX, shift + _ROOM_PX
    misfit = cache(lambda trial: likelihood.misfit(trial, incidence))
    near = float(local_minimum(misfit, shift, (low, high), _STEP_PX / 2, _TOLERANCE_PX))
    if not low + _TOLERANCE_PX < near < high - _TOLERANCE_PX:
        return shift, error_px
    mean, error = weighted_mean((near, _shift_error(likelihood, near, incidence)), (shift, error_px), _SUREST_PX)
    return mean, math.hypot(error, _MODEL_PX[samples.sampling.period])


def _likelihood(
    samples: RawSamples, angles_deg: tuple[float, ...], scene: SceneParameters, noise: float, farthest_px: float
) -> SampledLikelihood:
    """Of ghosts up to a distance: the smallest tiles serve in which these do not lie too far apart."""
    sides = _TILE_PX[samples.sampling.period]
    tile = next((side for side in sides if farthest_px <= _FARTHEST_IN_TILE * side), sides[-1])
    return SampledLikelihood(samples, angles_deg, scene, _TRUSTED_NOISE * noise, min(tile, *samples.values.shape))


class _Search:
    """Search for the likeliest ghost shift and incidence near what the cells tell.

    Parameters
    ----------
    likelihood : SampledLikelihood
    pane : (float, float)
        Shift in pixels where the search begins, and incidence of the cells in degrees.
    error_deg : float or None
        Standard error of that incidence; None where it is given.

    Attributes
    ----------
    first_deg : float
        Likeliest incidence at that shift. Even without ghosts it is nearly right, and there they show.
    """

    def __init__(self, likelihood: SampledLikelihood, pane: tuple[float, float], error_deg: float | None) -> None:
        shift_px, incidence_deg = pane
        self._misfit = cache(likelihood.misfit)
        self._given = error_deg is None
        self._of_cells, self._prior, self.first_deg = incidence_deg, 0.0, incidence_deg
        low, high = INCIDENCE_SEARCH_DEG
        self._bounds = (max(low, incidence_deg - _NEAR_DEG), min(high, incidence_deg + _NEAR_DEG))
        if error_deg is not None:
            # The prior is nothing yet.
            _, self.first_deg = self.with_incidence(shift_px, incidence_deg)
            self._prior = 0.5 * likelihood.unit(shift_px, self.first_deg) / error_deg**2

    def score(self, shift_px: float, incidence_deg: float, rounds: int = _ROUNDS) -> float:
        """Misfit with what the cells have against the incidence: another one and other ghosts may explain the same."""
        return self._misfit(shift_px, incidence_deg, rounds) + self._prior * (incidence_deg - self._of_cells) ** 2

    def with_incidence(self, shift_px: float, about_deg: float) -> tuple[float, float]:
        """A shift, and the incidence that suits it."""
        if self._given:
            return shift_px, about_deg
        score = partial(self.score, shift_px)
        return shift_px, local_minimum(score, about_deg, self._bounds, _STEP_DEG, _ROUGHLY_DEG)

    def with_ghosts(self, distances: NDArray[np.float64], farthest: float) -> tuple[float, float]:
        """The best shift to either side, and the incidence that suits it."""
        trials = [self._nearby(float(shift)) for shift in (*distances, *(-distances))]
        _, shift, incidence = min(trials)
        shift, incidence = self.with_incidence(shift, incidence)
        side = (-farthest, 0.0) if shift < 0 else (0.0, farthest)

        def misfit(trial: float) -> float:
            return self._misfit(trial, incidence, _ROUNDS)

        return float(local_minimum(misfit, shift, side, _STEP_PX / 2, _TOLERANCE_PX)), incidence

    def likeliest_incidence(self, shift_px: float, about_deg: float) -> float:
        """What the samples alone tell of it."""

        def misfit(trial: float) -> float:
            return self._misfit(shift_px, trial, _ROUNDS)

        return local_minimum(misfit, about_deg, self._bounds, _ROUGHLY_DEG, _TOLERANCE_DEG)

    def _nearby(self, shift_px: float) -> tuple[float, float, float]:
        """Score of a shift at the incidence that suits it, by a parabola; the shift and that incidence."""
        here, (low, high) = self.first_deg, self._bounds
        step = 0.0 if self._given else min(_APART_DEG, here - low, high - here)
        if not step:
            return self.score(shift_px, here), shift_px, here
        before, middle, after = (self.score(shift_px, here + k * step, _TRIAL_ROUNDS) for k in (-1, 0, 1))
        x = vertex(before, middle, after)
        least = middle + x * (after - before) / 2 + x**2 * (before - 2 * middle + after) / 2
        return least, shift_px, here + x * step


def _shift_error(likelihood: SampledLikelihood, shift_px: float, incidence_deg: float) -> float:
    """Standard error in pixels of the likeliest shift at an incidence."""
    if not shift_px:
        return LEAST_SHIFT_PX
    step = _STEP_PX / 2
    return minimum_error([likelihood.left_out(shift_px + k * step, incidence_deg) for k in (-1, 0, 1)], step)


def _incidence_error(likelihood: SampledLikelihood, shift_px: float, incidence_deg: float) -> float | None:
    """Standard error in degrees of the likeliest incidence at a shift; None where it is no likelier than others."""
    error, curvature = likelihood.incidence_error(shift_px, incidence_deg)
    if not (curvature > 0 and math.isfinite(error)):
        return None
    return math.hypot(widened_incidence(error), _MODEL_DEG)


class SampledLikelihood:
    """Likelihood of ghost shift and incidence given a mosaic's samples, the rest of a flat pane known.

    Parameters
    ----------
    samples : RawSamples
    angles_deg : tuple of float
        Of the photographs that they sample.
    scene : SceneParameters
        Complete, in pixels of the sensor; its ghost shift is not used.
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

    def misfit(self, shift_px: float, incidence_deg: float | None = None, rounds: int = _ROUNDS) -> float:
        """Minus log likelihood per frequency of a shift (signed), at the scene's incidence or another."""
        return float(self._misfits(self._responses(shift_px, incidence_deg), self._mean[None], rounds)[0])

    def left_out(self, shift_px: float, incidence_deg: float | None = None) -> NDArray[np.float64]:
        """The same without each band of tiles in turn, (band,)."""
        n = len(self._data)
        rest = (self._data.sum(axis=0) - self._data) / max(1, n - 1)
        return self._misfits(self._responses(shift_px, incidence_deg), rest if n > 1 else self._data)

    def incidence_error(self, shift_px: float, incidence_deg: float) -> tuple[float, float]:
        """Standard error in degrees of the likeliest incidence, near to the one given, and the misfit's curvature."""
        step = min(_STEP_DEG, incidence_deg / 2, (INCIDENCE_LIMITS_DEG[1] - incidence_deg) / 2)
        around = [self.left_out(shift_px, incidence_deg + k * step) for k in (-1, 0, 1)]
        before, here, after = (float(part.mean()) for part in around)
        return minimum_error(around, step), (before - 2 * here + after) / step**2

    def unit(self, shift_px: float, incidence_deg: float) -> float:
        """Misfit that stands for one nat, as the curvature and the error of the incidence have it; 0: not told."""
        error, curvature = self.incidence_error(shift_px, incidence_deg)
        return max(curvature, 0.0) * error**2 if math.isfinite(error) else 0.0

    def _misfits(self, responses: Matrices, data: Matrices, rounds: int = _ROUNDS) -> NDArray[np.float64]:
        covariance = self._covariance(responses, self._fitted(responses, self._levels, rounds))
        inverse = np.linalg.inv(covariance)
        _, determinant = np.linalg.slogdet(covariance)
        n, nu = covariance.shape[-1], DEGREES_OF_FREEDOM
        distance = np.einsum("gmn,bgnm->bg", inverse, data).real
        value = (determinant + (nu / 2 + n) * np.log(nu + 2 * distance)) @ self._multiplicity
        return np.asarray(value / self._multiplicity.sum())

    def _mean_products(self, samples: RawSamples) -> Matrices:
        from scipy.fft import rfft2

        side, period = self._side, samples.sampling.period
        window = hann_tile(side, side)
        corners = tile_corners(samples.valid, side, period)
        sums = np.zeros((min(_BANDS, len(corners)), self._multiplicity.size, period**2, period**2), np.complex64)
        counts = np.zeros(len(sums))
        for i, (top, left) in enumerate(corners):
            part = (slice(top, top + side), slice(left, left + side))
            tile = off_level(samples.values[part], samples.valid[part], window, period)
            spectrum = self._members.of(rfft2(tile * window)).T
            band = i * len(sums) // len(corners)
            sums[band] += spectrum[:, :, None] * spectrum[:, None].conj()
            counts[band] += 1
        return np.asarray(sums / counts[:, None, None, None].astype(np.float32), dtype=np.complex64)

    def _responses(self, shift_px: float, incidence_deg: float | None = None) -> Matrices:
        """What each frequency of each layer leaves in the samples: (group, alias, color, layer, frequency)."""
        incidence_deg = self._scene.incidence_deg if incidence_deg is None else incidence_deg
        pse = PSE(self._scene.replace(ghost_shift=shift_px, incidence_deg=incidence_deg), self._angles_deg)
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
            return np.asarray(np.tensordot(weighted, self._shapes, axes=((3, 0), (1, 2))))

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
    # The window makes neighbouring frequencies much alike: every second one, as on a chessboard, says the same.
    use &= (rows + columns) % 2 == 0
    multiplicity = np.where((columns == 0) | (2 * columns == side), 1.0, 2.0)
    return groups.members(rows[use], columns[use]), multiplicity[use]


def off_level(values: NDArray[Any], valid: NDArray[Any], window: NDArray[Any], period: int) -> NDArray[Any]:
    """A tile less the level of each pixel of the pattern, which stands for what is not valid."""
    shape = (values.shape[0] // period, period, values.shape[1] // period, period)
    weights = np.where(valid, window, 0).reshape(shape)
    of_pattern = values.reshape(shape)
    total = np.maximum(weights.sum(axis=(0, 2), keepdims=True), np.finfo(np.float64).tiny)
    level = (of_pattern * weights).sum(axis=(0, 2), keepdims=True) / total
    return np.where(valid.reshape(shape), of_pattern - level, 0).reshape(values.shape)


def is_told_by_samples(scene: SceneParameters) -> bool:
    """Whether a complete scene is a single flat pane, seen from far, whose images lie as far apart in both layers."""
    return scene.rung in ("pixelwise", "ghosts") and not scene.stacked and is_of_two_faces(scene)


def pane_of_samples(
    capture: Capture,
    scene: SceneParameters,
    noise: float,
    *,
    incidence_error_deg: float = math.inf,
    open_shift: bool = True,
    open_incidence: bool = True,
    sense_only: bool = False,
) -> SampledPane | None:
    """What a mosaic's samples tell of a scene, in pixels of the capture; None where they are not asked.

    Parameters
    ----------
    capture : Capture
        Of a mosaic.
    scene : SceneParameters
        Complete, in pixels of the capture.
    noise, incidence_error_deg, open_shift, open_incidence, sense_only
        As of `sampled_pane`.
    """
    cells = capture.cells
    if cells is None or not is_told_by_samples(scene):
        return None
    of_sensor = cells.samples.sampling.period / cells.scale
    found = sampled_pane(
        cells.samples,
        capture.angles_deg,
        scene.scaled(of_sensor),
        noise,
        incidence_error_deg=incidence_error_deg,
        open_shift=open_shift,
        open_incidence=open_incidence,
        sense_only=sense_only,
    )
    if found is None:
        return None
    error = None if found.shift_error_px is None else found.shift_error_px / of_sensor
    return replace(found, shift_px=found.shift_px / of_sensor, shift_error_px=error)
