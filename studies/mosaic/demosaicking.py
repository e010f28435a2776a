"""Photographs of all angles in all pixels, out of a raw mosaic alone: what is done where nothing is known of a pane.

Two of others' ways stand beside this software's. polanalyser's is bilinear, each angle (and colour) for itself; its
edge-aware one differs from it in colour alone. The linear least-squares interpolation (LMMSE) is the best that any
linear filter of its window can do: Spote et al., "Joint demosaicing of colour and polarisation from filter arrays"
(Color and Imaging Conference 2021), and Dumoulin et al., "Impact of training data on LMMSE demosaicing for
Colour-Polarization Filter Array" (SITIS 2022), who made it for these cameras. Their code is MATLAB; it is written here
anew, with larger windows, and trained on photographs that it is not judged on, behind panes and with the noise and lens
of those that it is judged on. Filters by frequency (Tyo et al., Optics Letters 34, 2009) are linear, too.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import ANGLES_DEG, WHITE_16, planes_first, sampling_of
from polaropt.optics import Sampling, SceneParameters, analyzer_matrix
from polaropt.simulation import Camera, exact_photographs, sensor_image, stack_layers
from studies.photographs import pairs_of, unseen_pairs

Images = NDArray[np.float32]
Floats = NDArray[np.float64]
Indices = NDArray[np.intp]

SIZE_PX, MARGIN_PX = 384, 20
"""Side of the frames that are trained on, and what is kept beyond them for ghosts to come from."""
TRAINED_INCIDENCES_DEG = (40.0, 60.0, 75.0)
TRAINED_AZIMUTHS_DEG = (0.0, 45.0, 90.0, 135.0)
TRAINED_SHIFT_PX = 4.0
"""Of the panes that photographs are trained behind; azimuths that favour no angle."""
LENS_BLUR_PX = 0.7
"""Standard deviation of the blur that is trained with where nobody knows the lens: it hardly blurs a pixel."""
_WINDOW_PX = {False: 9, True: 13}
"""Side of the window of a mono and of a colour sensor."""
_LEAST_NOISE = 1e-4
"""Noise (white = 1) that kernels are made for at least: less leaves what the training does not tell to rounding."""


def bilinear(raw: Images, color: bool) -> Images:
    """Photographs (k, [channel,] h, w) as polanalyser interpolates them by default."""
    import polanalyser

    return _by_polanalyser(raw, polanalyser.COLOR_PolarRGB if color else polanalyser.COLOR_PolarMono)


def edge_aware(raw: Images) -> Images:
    """Photographs (k, channel, h, w) of a colour mosaic as polanalyser's edge-aware code has them."""
    import polanalyser

    return _by_polanalyser(raw, polanalyser.COLOR_PolarRGB_EA)


def _by_polanalyser(raw: Images, code: object) -> Images:
    import polanalyser

    values = np.round(np.clip(raw, 0, 1) * WHITE_16).astype(np.uint16)
    # In the order 0, 45, 90, 135; OpenCV's colours are blue, green, red.
    images = np.stack(polanalyser.demosaicing(values, code)).astype(np.float32) / WHITE_16
    return np.stack([planes_first(image[..., ::-1] if image.ndim == 3 else image) for image in images])


@dataclass(frozen=True)
class Covariances:
    """Covariances of photographs, each angle and colour one plane, over the distances within a window.

    Attributes
    ----------
    color : bool
    planes : ndarray, shape (plane, plane, n, n)
        Of the first plane's value here with the second's at a distance of up to `n // 2` rows and columns.
    """

    color: bool
    planes: Floats

    def interpolate(self, raw: Images, noise: float) -> Images:
        """Photographs (k, [channel,] h, w) of raw samples (h, w), whole patterns, with white noise of this level."""
        sampling, angles = sampling_of(self.color)
        period, shape = sampling.period, (len(angles), sampling.n_channels)
        side = 1 + self.planes.shape[-1] // 2
        # As all samples tell it; what is interpolated are differences from it.
        means = np.empty(shape)
        for photograph, channel in np.ndindex(shape):
            here = [raw[row::period, column::period].mean() for k, c, row, column in sampling.places
                    if (k, c) == (photograph, channel)]  # fmt: skip
            means[photograph, channel] = np.mean(here)
        analyzer = analyzer_matrix(angles)
        means = analyzer @ np.linalg.pinv(analyzer) @ means
        # Mirrored, the pattern would be another one.
        padded = np.pad(raw - sampling.laid_out(means, raw.shape), side // 2, mode="wrap")
        windows = np.lib.stride_tricks.sliding_window_view(padded, (side, side))
        images = np.empty((*shape, *raw.shape), np.float32)
        for _, _, row, column in sampling.places:
            weights = self._kernels(sampling.moved(row - side // 2, column - side // 2), side, noise)
            seen = windows[row::period, column::period]
            here = seen.reshape(-1, side * side) @ weights
            images[..., row::period, column::period] = here.T.reshape(*shape, *seen.shape[:2])
        images += means[..., None, None].astype(np.float32)
        return images if self.color else images[:, 0]

    def _kernels(self, sampling: Sampling, side: int, noise: float) -> Images:
        """Weights (sample, plane) of least squared error for the middle of a window that begins with the pattern."""
        rows, columns = (index.ravel() for index in np.mgrid[:side, :side])
        pattern = np.array(sampling.photographs) * sampling.n_channels + np.array(sampling.channels)
        plane = pattern[rows % sampling.period, columns % sampling.period]
        middle, zero = side // 2, self.planes.shape[-1] // 2

        def at(first: Indices, second: Indices, down: Indices, right: Indices) -> Floats:
            return self.planes[first, second, zero + down, zero + right]

        samples = at(plane[:, None], plane, rows - rows[:, None], columns - columns[:, None])
        wanted = at(plane[:, None], np.arange(len(self.planes)), middle - rows[:, None], middle - columns[:, None])
        power = max(noise, _LEAST_NOISE) ** 2 * np.eye(len(rows))
        return np.asarray(np.linalg.solve(samples + power, wanted), dtype=np.float32)


def covariances_of(frames: Iterable[Images], color: bool) -> Covariances:
    """Covariances of photographs (k, channel, h, w), all frames of one size."""
    from scipy.fft import irfft2, rfft2

    reach = _WINDOW_PX[color] - 1
    total, n = None, 0
    for frame in frames:
        n += 1
        planes = frame.reshape(-1, *frame.shape[-2:])
        planes = planes - planes.mean(axis=(-1, -2), keepdims=True, dtype=np.float64).astype(np.float32)
        # With so much dark beside it no window reaches around the frame.
        height, width = (side + reach for side in planes.shape[-2:])
        spectra = rfft2(planes / np.float32(math.sqrt(planes[0].size)), s=(height, width))
        if total is None:
            total = np.zeros((len(spectra), *spectra.shape), np.complex64)
        for first, spectrum in enumerate(spectra):
            total[first, first:] += spectrum.conj() * spectra[first:]
    assert total is not None
    for first in range(1, len(total)):
        total[first, :first] = total[:first, first].conj()
    both = np.roll(irfft2(total / n, s=(height, width)), (reach, reach), (-1, -2))
    return Covariances(color, both[..., : 2 * reach + 1, : 2 * reach + 1].copy())


@lru_cache(maxsize=8)
def trained(color: bool, blur_px: float, judged_pair: int | None = None) -> Covariances:
    """The interpolation trained on photographs inside scikit-image behind panes, seen through a lens.

    Parameters
    ----------
    color : bool
    blur_px : float
        Standard deviation of the lens's blur.
    judged_pair : int, optional
        Pair of those photographs that it will be judged on, and must not see. Default: it is judged on others.
    """
    return covariances_of(_photographs(color, blur_px, unseen_pairs(judged_pair)), color)


def _photographs(color: bool, blur_px: float, pairs: tuple[int, ...]) -> Iterator[Images]:
    camera = Camera(ANGLES_DEG, lens_blur_px=blur_px)
    for number in pairs:
        pair = pairs_of(None, SIZE_PX, MARGIN_PX)[number]
        seen = stack_layers(
            *(camera.through_lens(sensor_image(image, color)) for image in (pair.transmission, pair.reflection))
        )
        for incidence in TRAINED_INCIDENCES_DEG:
            for azimuth in TRAINED_AZIMUTHS_DEG:
                scene = SceneParameters(incidence, azimuth, TRAINED_SHIFT_PX)
                photographs = pair.cropped(exact_photographs(seen, scene, ANGLES_DEG))
                yield photographs.reshape(len(ANGLES_DEG), -1, *photographs.shape[-2:])
