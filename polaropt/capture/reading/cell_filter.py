"""Photographs of one pixel per pattern from a mosaic's samples, by a filter that is kept from frame to frame.

`wiener_photographs` and means over patterns are linear in the samples, and the same for all patterns. Their result is
so a sum over the pattern's pixels, each taken as a small image and filtered for itself: some transforms of small images
and no system to solve. Detail that patterns show is believed to be stronger than it is: likeliest photographs would
lack some of it, of which a solve takes its share once more.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.capture.mosaic import (
    MIRRORED_PX,
    StokesPrior,
    fitted_prior,
    frame_sides,
    framed_samples,
    mirrored_patterns,
)
from polaropt.numerics import AliasGroups, Members, filter_of_groups, mixed_spectra
from polaropt.optics import Sampling, analyzer_matrix
from solvers.kernels import in_blocks

Images = NDArray[np.float32]
Floats = NDArray[np.float64]

_MOST_DETAIL, _NOISE_SHARES = 2.0, (0.35, 0.5)
"""Power that the patterns' own detail is taken to have, in units of that of the prior, where so much of what the
likeliest photographs are off by (their variance) is noise as in the second; 1 where it is as little as in the first,
as more would amplify detail that aliases. Likeliest photographs have lost detail together with noise, and a solve
takes more of it. By trial on films of training photographs (`studies.sequences`, mono and colour sensors, 45 to 70
degrees, noise 0.5 to 2 %): layers behind a lens that blurs by 0.7 px gain 0.4 to 1.2 dB by 2 against 1, and the
reflection of sharp scenes at 45 degrees loses up to 5 dB."""
_COUNTED, _SHARP = {1: 0.5, 3: 0.75}, 0.05
"""Share of what detail leaves that a solve counts as noise behind a lens that blurs, by the number of the sensor's
colours, and share of the finest detail's power from which on a lens does not, and all counts: what aliases lies at
edges, and where noise of one strength stands for it calm places lose theirs. By trial on the same films."""
_FAST = 0.38
"""Cycles per pixel along rows and columns beyond which samples show nothing but the finest detail of the light, what a
lens leaves of it, and noise: neither colours nor polarizers of a pattern alternate there. Set by hand."""
_SURELY = 3.0
"""Standard errors of the noise's power beyond which detail is seen there; set by hand."""
_LEAST_NOISE = 1e-4
"""Standard deviation of the noise (white = 1) that the filter counts with at least: with less, rounding to float32
decides. Set by hand."""
_ROWS_OF_ERROR = 12
"""Rows of frequencies, evenly apart, that the error of the photographs is found from; set by hand."""


@dataclass(frozen=True, eq=False)
class CellFilter:
    """From samples of a mosaic to photographs of its patterns, with what was fitted to one of the frames.

    Attributes
    ----------
    sampling : Sampling
    gains : (ndarray, ndarray)
        Real and imaginary parts of what each pixel of a pattern counts at each frequency, float32, (row, 3 channel,
        period^2, column).
    analyzer, shown : ndarray, shape (k, 3)
        Rows of the analyzers that took the samples, and of those that the photographs are shown by.
    error : float
        Standard deviation of what noise, and detail that aliases, leave in the photographs (white = 1).
    """

    sampling: Sampling
    gains: tuple[Images, Images]
    analyzer: Floats
    shown: Floats
    error: float

    @classmethod
    def fitted(
        cls,
        values: Images,
        sampling: Sampling,
        angles_deg: tuple[float, ...],
        noise: float,
        expected: Images,
        analyzer: Floats | None = None,
        *,
        detail_power: float | None = None,
    ) -> CellFilter:
        """The filter that is best for a frame.

        Parameters
        ----------
        values, sampling, angles_deg, noise, expected, analyzer
            As of `wiener_photographs`, all samples good.
        detail_power : float, optional
            That the patterns' own detail is taken to have, in units of that of the prior; 1 for the likeliest
            photographs. Default: as it suits a solve.
        """
        noise = max(noise, _LEAST_NOISE)
        shown = analyzer_matrix(angles_deg)
        analyzer = shown if analyzer is None else analyzer
        level = analyzer @ np.linalg.pinv(analyzer) @ expected.mean(axis=(-1, -2), dtype=np.float64)
        framed = framed_samples(values, sampling, level)
        prior = fitted_prior(framed, sampling, noise, expected, analyzer)
        finest, squared = _finest_left(prior, noise)
        law = prior.law * _left_by_lens(prior.groups, finest, squared)
        of_detail, of_noise = _errors(prior, noise, 1.0, law, shown)
        if detail_power is None:
            share = of_noise / (of_detail + of_noise)
            detail_power = 1 + (_MOST_DETAIL - 1) * float(np.interp(share, _NOISE_SHARES, (0, 1)))
        if detail_power != 1:
            of_detail, of_noise = _errors(prior, noise, detail_power, law, shown)
        counted = np.interp(finest, (0, _SHARP), (_COUNTED[sampling.n_channels], 1))
        error = max(_LEAST_NOISE, math.sqrt(counted**2 * of_detail + of_noise))
        return cls(sampling, _gains(prior, noise, detail_power), analyzer, shown, error)

    def photographs(self, values: Images) -> Images:
        """Photographs (k, channel, h / period, w / period) of linear samples (h, w), all of them good."""
        from scipy.fft import irfft2

        sampling, period = self.sampling, self.sampling.period
        level = np.linalg.pinv(self.analyzer) @ _means(values, sampling, len(self.analyzer))
        mixed = mixed_spectra(self.gains, self._spectra(values, self.analyzer @ level))
        height, width = (side // period for side in values.shape)
        framed = tuple(mirrored_patterns(side, period).size for side in (height, width))
        margin = MIRRORED_PX // period
        stokes = np.empty((sampling.n_channels, 3, height, width), np.float32)
        flat = stokes.reshape(-1, height, width)

        def image(i: int, _: int) -> None:
            whole = irfft2(mixed[i], s=framed, norm="ortho", overwrite_x=True)
            flat[i] = whole[margin : margin + height, margin : margin + width]

        in_blocks(image, len(flat), 1)
        stokes += level.T[..., None, None].astype(np.float32)
        return np.asarray(np.einsum("ks,cshw->kchw", self.shown.astype(np.float32), stokes, optimize=True))

    def _spectra(self, values: Images, level: Floats) -> NDArray[np.complex64]:
        """Spectra (place, row, column) of the pixels of the patterns, mirrored around the frame."""
        from scipy.fft import rfft2

        from polaropt.capture.reading.kernels import framed_pixels

        period = self.sampling.period
        rows, columns = (mirrored_patterns(side // period, period) for side in values.shape)
        down, across = (
            side.astype(np.float32) for side in frame_sides(values.shape, (period * rows.size, period * columns.size))
        )
        spectra = np.empty((period**2, rows.size, columns.size // 2 + 1), np.complex64)

        def place(i: int, _: int) -> None:
            photograph, channel, row, column = self.sampling.places[i]
            sides = (np.ascontiguousarray(down[row::period]), np.ascontiguousarray(across[column::period]))
            framed = np.empty((rows.size, columns.size), np.float32)
            own = np.float32(level[photograph, channel])
            framed_pixels(values, (row, column), period, rows, columns, own, *sides, framed)
            spectra[i] = rfft2(framed, norm="ortho", overwrite_x=True)

        in_blocks(place, period**2, 1)
        return spectra


def _means(values: Images, sampling: Sampling, n_photographs: int) -> Floats:
    """Mean of the samples of each photograph and channel."""
    sums, counts = np.zeros((2, n_photographs, sampling.n_channels))
    for photograph, channel, row, column in sampling.places:
        sums[photograph, channel] += values[row :: sampling.period, column :: sampling.period].mean(dtype=np.float64)
        counts[photograph, channel] += 1
    return np.asarray(sums / counts)


@dataclass(frozen=True)
class _Row:
    """What makes a row of the frequencies of the patterns' Stokes images, (color, 3, row).

    Attributes
    ----------
    phase : ndarray, shape (place, group)
        Of each pixel of the pattern.
    members : Members
        The frame's frequencies.
    seen : ndarray of complex64, shape (alias, group)
        Weight of these in means over the patterns.
    counted : ndarray of complex64, shape (color, 3, alias, group)
        What the spectrum of the samples counts at these.
    """

    phase: NDArray[Any]
    members: Members
    seen: NDArray[np.complex64]
    counted: NDArray[np.complex64]

    @classmethod
    def of(cls, prior: StokesPrior, noise: float, detail_power: float, row: int) -> _Row:
        groups, period = prior.groups, prior.groups.period
        inside, columns = np.divmod(np.arange(period**2), period), np.arange(groups.n_columns)
        phase = np.exp(
            -2j * np.pi * (row * inside[0][:, None] / groups.height + columns * inside[1][:, None] / groups.width)
        )
        # The mean over a pattern, of every frequency that the patterns' images alias.
        seen = ((_phases_of_aliases(period).conj() @ phase.conj()) / period**3).astype(np.complex64)
        members = groups.members(row, columns)
        law = members.of(prior.law)
        own = np.where(law == law.max(axis=0), detail_power * law, law)
        counted = filter_of_groups(prior.combs, prior.covariance(own), noise**2, seen)
        return cls(phase, members, seen, counted)


def _phases_of_aliases(period: int) -> NDArray[Any]:
    """Phase of each pixel of a pattern at each alias of frequency 0, (alias, place)."""
    inside = np.divmod(np.arange(period**2), period)
    return np.asarray(np.exp(-2j * np.pi / period * (np.outer(inside[0], inside[0]) + np.outer(inside[1], inside[1]))))


def _gains(prior: StokesPrior, noise: float, detail_power: float) -> tuple[Images, Images]:
    """What each pixel of a pattern counts in means over the pattern of the likeliest Stokes images."""
    groups, period = prior.groups, prior.groups.period
    shape = (groups.n_rows, 3 * len(prior.basis), period**2, groups.n_columns)
    gains = np.empty(shape, np.float32), np.empty(shape, np.float32)
    of_alias = _phases_of_aliases(period)

    def rows(start: int, stop: int) -> None:
        for row in range(start, stop):
            made = _Row.of(prior, noise, detail_power, row)
            in_colors = np.einsum("bc,bsag->csag", prior.basis, made.counted, optimize=True)
            of_places = np.einsum("csag,ap->cspg", in_colors, of_alias, optimize=True) * (made.phase / period)
            gains[0][row], gains[1][row] = (
                part.reshape(shape[1:]).astype(np.float32) for part in (of_places.real, of_places.imag)
            )

    in_blocks(rows, groups.n_rows, 4)
    return gains


def _errors(prior: StokesPrior, noise: float, detail_power: float, law: Floats, shown: Floats) -> tuple[float, float]:
    """Variance of what detail, missed or aliased, and noise leave in photographs, the mean of all of them.

    The law is that of the detail that a lens has left, (H, W // 2 + 1).
    """
    groups = prior.groups
    own = np.eye(3 * len(prior.basis)).reshape(2 * (len(prior.basis), 3))
    weights = np.where(np.isin(np.arange(groups.n_columns), (0, groups.width / groups.period / 2)), 1.0, 2.0)
    of_detail, of_noise = np.zeros((2, 3, 3))
    rows = range(0, groups.n_rows, max(1, groups.n_rows // _ROWS_OF_ERROR))
    for row in rows:
        made = _Row.of(prior, noise, detail_power, row)
        missed = own[..., None, None] * made.seen - np.einsum("csag,dtam->csdtmg", made.counted, prior.combs)
        power = prior.covariance(made.members.of(law))
        both = np.einsum("csdtmg,dtumg,cvdumg,g->sv", missed, power, missed.conj(), weights, optimize=True)
        of_detail += both.real
        of_noise += noise**2 * np.einsum("csag,cvag,g->sv", made.counted, made.counted.conj(), weights).real
    n = len(rows) * weights.sum() * len(prior.basis) * len(shown)
    detail, by_noise = (float(np.trace(shown @ part @ shown.T)) / n for part in (of_detail, of_noise))
    return detail, by_noise


def _left_by_lens(groups: AliasGroups, share: float, squared: float) -> Floats:
    """Share of the power of detail at each frequency, (H, W // 2 + 1), that a Gaussian leaves which leaves one of them
    at a squared frequency."""
    down, across = np.fft.fftfreq(groups.height)[:, None], np.fft.rfftfreq(groups.width)
    return np.asarray(np.exp(math.log(share) / squared * (down**2 + across**2)))


def _finest_left(prior: StokesPrior, noise: float) -> tuple[float, float]:
    """Share of the power of the finest detail that a lens leaves, and the squared frequency that it is of.

    Where no detail is seen it is as much as noise lets detail be missed.
    """
    down = np.abs(np.fft.fftfreq(prior.groups.height))[:, None]
    across = np.fft.rfftfreq(prior.groups.width)
    fast = (down > _FAST) & (across > _FAST)
    seen = float(np.square(np.abs(prior.data[fast])).mean()) - noise**2
    light = np.square(np.abs(prior.combs[:, 0, 0, 0])) @ prior.powers[:, 0, 0]
    expected = float(light * prior.law[fast].mean())
    least = _SURELY * noise**2 / math.sqrt(np.count_nonzero(fast))
    return min(1.0, max(seen, least) / expected), float((down**2 + across**2)[fast].mean())
