"""Photographs of one pixel per pattern from a mosaic's samples, by a filter that is kept from frame to frame.

`wiener_photographs` and means over patterns are linear in the samples, and the same for all patterns. Their result is
so a sum over the pattern's pixels, each taken as a small image and filtered for itself: some transforms of small images
and no system to solve.
"""

from __future__ import annotations

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
from polaropt.numerics import filter_of_groups, mixed_spectra
from polaropt.optics import Sampling, analyzer_matrix
from solvers.kernels import in_blocks

Images = NDArray[np.float32]
Floats = NDArray[np.float64]


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
    """

    sampling: Sampling
    gains: tuple[Images, Images]
    analyzer: Floats
    shown: Floats

    @classmethod
    def fitted(
        cls,
        values: Images,
        sampling: Sampling,
        angles_deg: tuple[float, ...],
        noise: float,
        expected: Images,
        analyzer: Floats | None = None,
    ) -> CellFilter:
        """The filter that is best for a frame; parameters as of `wiener_photographs`, all samples good."""
        shown = analyzer_matrix(angles_deg)
        analyzer = shown if analyzer is None else analyzer
        level = analyzer @ np.linalg.pinv(analyzer) @ expected.mean(axis=(-1, -2), dtype=np.float64)
        framed = framed_samples(values, sampling, level)
        prior = fitted_prior(framed, sampling, noise, expected, analyzer)
        return cls(sampling, _gains(prior, noise), analyzer, shown)

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


def _gains(prior: StokesPrior, noise: float) -> tuple[Images, Images]:
    """What each pixel of a pattern counts in means over the pattern of the likeliest Stokes images."""
    groups, period = prior.groups, prior.groups.period
    n_colors, n_columns = len(prior.basis), groups.n_columns
    shape = (groups.n_rows, 3 * n_colors, period**2, n_columns)
    gains = np.empty(shape, np.float32), np.empty(shape, np.float32)
    inside = np.divmod(np.arange(period**2), period)
    columns = np.arange(n_columns)
    # Phase of a pixel of the pattern (place) at a frequency: of its group, and of the alias.
    of_alias = np.exp(-2j * np.pi / period * (np.outer(inside[0], inside[0]) + np.outer(inside[1], inside[1])))

    def rows(start: int, stop: int) -> None:
        for row in range(start, stop):
            phase: NDArray[Any] = np.exp(
                -2j * np.pi * (row * inside[0][:, None] / groups.height + columns * inside[1][:, None] / groups.width)
            )
            # The mean over a pattern, of every frequency that the patterns' images alias.
            seen = (of_alias.conj() @ phase.conj()) / period**3
            members = groups.members(row, columns)
            found = filter_of_groups(
                prior.combs, prior.covariance(members.of(prior.law)), noise**2, seen.astype(np.complex64)
            )
            in_colors = np.einsum("bc,bsag->csag", prior.basis, found, optimize=True)
            of_places = np.einsum("csag,ap->cspg", in_colors, of_alias, optimize=True) * (phase / period)
            gains[0][row], gains[1][row] = (
                part.reshape(shape[1:]).astype(np.float32) for part in (of_places.real, of_places.imag)
            )

    in_blocks(rows, groups.n_rows, 4)
    return gains
