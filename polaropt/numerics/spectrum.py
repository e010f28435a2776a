"""Frequencies of real two-dimensional transforms, how often half a spectrum stands for the whole, windows, and blur."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solvers.kernels import in_blocks

Array = NDArray[Any]
Values = NDArray[np.float64]


def frequencies(height: int, width: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Angular frequencies per pixel of a real 2-D transform: rows (height, 1) and columns (1, width // 2 + 1)."""
    rows = 2 * np.pi * np.fft.fftfreq(height).astype(np.float64)
    columns = 2 * np.pi * np.fft.rfftfreq(width).astype(np.float64)
    return rows[:, None], columns[None, :]


def squared_frequencies(height: int, width: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Eigenvalues of squared differences along rows (height,) and columns (width // 2 + 1,) of a real transform."""
    rows = 2 - 2 * np.cos(2 * np.pi * np.fft.fftfreq(height))
    columns = 2 - 2 * np.cos(2 * np.pi * np.fft.rfftfreq(width))
    return rows, columns


NATURAL_POWER_LAW = 2.4
"""Power of photographs falls with so high a power of frequency. Field (1987) has 2 on average, with a spread from
photograph to photograph; this is by trial."""


def natural_frequencies(height: int, width: int) -> NDArray[np.float64]:
    """Squared frequencies (height, width // 2 + 1) of photographs; a finite one at zero stands for all that is slower
    than the frame."""
    rows, columns = squared_frequencies(height, width)
    return np.asarray(rows[:, None] + columns + (2 * np.pi / max(height, width)) ** 2)


def each_plane(function: Callable[[tuple[int, int]], None], shape: tuple[int, ...]) -> None:
    """Call a function for every plane of images or spectra (n, channel, ...), on all cores: a plane fits the cache."""
    in_blocks(lambda i, _: function(divmod(i, shape[1])), shape[0] * shape[1], 1)


def filtered(images: NDArray[np.float32], response: Array) -> NDArray[np.float32]:
    """Periodic images (n, channel, h, w), each frequency of each plane times a response (..., h, w // 2 + 1)."""
    from scipy.fft import irfft2, rfft2

    responses = np.broadcast_to(response, (*images.shape[:2], *response.shape[-2:]))
    found = np.empty_like(images)

    def plane(where: tuple[int, int]) -> None:
        spectrum = rfft2(images[where])
        spectrum *= responses[where]
        found[where] = irfft2(spectrum, images.shape[-2:])

    each_plane(plane, images.shape)
    return found


def column_multiplicity(width: int) -> NDArray[np.float64]:
    """How often a column of the half spectrum stands for itself and its conjugate."""
    twice = np.full(width // 2 + 1, 2.0)
    twice[0] = 1
    if width % 2 == 0:
        twice[-1] = 1
    return twice


def hann_window(length: int) -> NDArray[np.float64]:
    """Hann's window of so many samples, none of them zero, so that its zeros lie a sample beyond each end."""
    return np.hanning(length + 2)[1:-1]


def hann_autocorrelation(lag: NDArray[np.float64]) -> NDArray[np.float64]:
    """Autocorrelation of Hann's window at lags in units of its length, 1 at lag 0."""
    lag = np.minimum(np.abs(lag), 1)
    bulk: NDArray[np.float64] = (1 - lag) * (2 + np.cos(2 * np.pi * lag)) / 3
    return bulk + np.sin(2 * np.pi * lag) / (2 * np.pi)


def hann_tile(height: int, width: int) -> NDArray[np.float64]:
    """Hann's window of a tile, (height, width), of unit power: noise keeps its own."""
    window = np.outer(hann_window(height), hann_window(width))
    return np.asarray(window / math.sqrt(float(np.sum(window**2))))


def hann_spectra(images: Array, step: int = 1) -> NDArray[np.complexfloating[Any, Any]]:
    """Spectra (..., h, w // 2 + 1) of images (..., h, w) under Hann's window, by way of their gradients.

    With a step these are differences of pixels that far apart: of a mosaic, of pixels that see alike.

    Under a window every frequency is mixed with those beside it. Of photographs the lower ones have more power: all of
    them would be taken for lower than they are, and shifts between images for smaller. Gradients have about the same
    power at all. White noise of variance 1 has the power 1 at every frequency but those that differences do not see (0,
    and what repeats after a step), where all is left out.
    """
    from scipy.fft import rfft2

    window, by_down, by_right = _of_gradients(*images.shape[-2:], images.dtype, step)
    gradients = np.zeros((2, *images.shape), images.dtype)
    np.subtract(images[..., step:, :], images[..., :-step, :], out=gradients[0, ..., :-step, :])
    np.subtract(images[..., step:], images[..., :-step], out=gradients[1, ..., :-step])
    gradients *= window
    of_down, of_right = rfft2(gradients)
    return np.asarray(of_down * by_down + of_right * by_right)


_RINGS, _FEWEST_RINGS = 11, 3
"""Rings of frequencies by which it is told how fast spectra fall, and with how few it is. Set by hand."""
_SHOWS = 2.0
"""Of a ring's mean power, in units of the noise's, from which on it shows more than noise. Set by hand."""
_SHARP_PX2 = 0.4
"""Blur up to which pictures are sharp: training photographs, reduced by 1.5, have 0.2 at most, painted boxes behind a
lens that blurs by 0.6 px have 0.38, as this measures it. Of 14 captures of an engine of its own that are blurred by 1.5
to 3 px (26 to 74 degrees) 9 came within 3 dB of the scene known when they were taken for natural, all 14 do as they
are."""
_LEAST_LEFT = 1e-6
"""Share of natural images' power that a blur leaves at least: what is divided by. Set by hand."""


def squared_blur(power: Array, noise: float, radius: Values, multiplicity: Array) -> float:
    """Square of the standard deviation in pixels of the Gaussian that blurs natural images as far as these are.

    What is out of focus falls much faster than natural images do, within a cell of frequencies, too: taken for natural,
    that looks like double images a few pixels apart, or several panes.

    Parameters
    ----------
    power : ndarray, shape (n,)
        Mean periodogram, noise and all.
    noise : float
        Power of the noise.
    radius, multiplicity : ndarray, shape (n,)
        Angular frequencies per pixel, and how often each counts.

    Returns
    -------
    float
        0 for pictures that are sharp.
    """
    edges = np.geomspace(radius.min(), radius.max(), _RINGS + 1)[1:-1]
    ring = np.digitize(radius, edges)
    counts, seen, squares, logs = (
        np.bincount(ring, multiplicity * values, _RINGS)
        for values in (np.ones_like(radius), power, radius**2, 2 * np.log(radius))
    )
    shown = seen > _SHOWS * noise * np.maximum(counts, 1)
    if np.count_nonzero(shown) < _FEWEST_RINGS:
        return 0.0
    counts, seen, squares, logs = (values[shown] for values in (counts, seen, squares, logs))
    heights = np.log(seen / counts - noise) + logs / counts
    slope = np.polyfit(squares / counts, heights, 1, w=np.sqrt(counts))[0]
    return -float(slope) if -slope > _SHARP_PX2 else 0.0


def blurred_power(squared_radius: Values, blur_px2: float) -> Values:
    """Share of natural images' power that a blur, see `squared_blur`, leaves at squared frequencies."""
    return np.asarray(np.maximum(np.exp(-blur_px2 * squared_radius), _LEAST_LEFT))


_SHARPENINGS = 2
"""Times that a blurred picture is sharpened a little: two follow a Gaussian's inverse, and leave white noise, once that
is divided out again, at most 1.05 times as strong up to a blur of 1.4 px, and 1.17 times of 2.8 px."""
_CURVATURE = (1, -2, 1)
"""Of a picture along an axis, from neighbouring pixels."""


def sharpened(images: Array, blur_px2: float) -> tuple[Array, NDArray[np.float64]]:
    """Images (..., h, w) as sharp as neighbouring pixels tell, and what that made of every frequency (h, w // 2 + 1).

    Under a window the steep spectra of blurred pictures are mixed as those of photographs are, see `hann_spectra`.

    Parameters
    ----------
    images : ndarray
    blur_px2 : float
        Square of the standard deviation in pixels of the Gaussian that blurred them.
    """
    from scipy.ndimage import correlate1d

    share = np.asarray(blur_px2 / (2 * _SHARPENINGS), images.dtype)
    for _ in range(_SHARPENINGS):
        images = images - share * sum(correlate1d(images, _CURVATURE, axis, mode="nearest") for axis in (-2, -1))
    rows, columns = squared_frequencies(*images.shape[-2:])
    transfer = 1 + share * (rows[:, None] + columns)
    return images, transfer**_SHARPENINGS


_UNSEEN = 1e-12
"""Power of differences below which they see nothing of a frequency, for rounding."""


@lru_cache(maxsize=8)
def _of_gradients(height: int, width: int, dtype: np.dtype[Any], step: int) -> tuple[Array, Array, Array]:
    """Hann's window of unit power, and by what spectra of differences down and to the right become the picture's."""
    window = hann_tile(height, width)
    rows, columns = (step * part for part in frequencies(height, width))
    down, right = np.broadcast_arrays(np.exp(1j * rows) - 1, np.exp(1j * columns) - 1)
    # Noise of neighbouring differences has in common what one pixel adds to both.
    at, above, before = window, np.roll(window, -step, axis=0), np.roll(window, -step, axis=1)
    squares, beside_rows, beside_columns = (float(np.sum(window * part)) for part in (at, above, before))
    diagonal = float(np.sum(above * before))
    of_down = 2 * squares - 2 * beside_rows * np.cos(rows)
    of_right = 2 * squares - 2 * beside_columns * np.cos(columns)
    both = (
        squares
        - beside_columns * np.exp(1j * columns)
        - beside_rows * np.exp(-1j * rows)
        + diagonal * np.exp(1j * (columns - rows))
    )
    power = np.abs(down) ** 2 * of_down + np.abs(right) ** 2 * of_right
    power = power + 2 * (down.conj() * right * both.conj()).real
    factors = np.sqrt(np.maximum(power, 0))
    factors[np.abs(down) ** 2 + np.abs(right) ** 2 < _UNSEEN] = math.inf
    exact = np.result_type(dtype, np.complex64)
    return window.astype(dtype), (down.conj() / factors).astype(exact), (right.conj() / factors).astype(exact)


def bilinear_transfer(right: Array, down: Array, columns: Values, rows: Values) -> NDArray[np.complex128]:
    """What bilinear interpolation makes of a picture's spectrum that is brought so far to the right and down.

    Parameters
    ----------
    right, down : ndarray, shape (shift,)
        In pixels.
    columns, rows : ndarray, shape (n,)
        Angular frequencies per pixel.

    Returns
    -------
    ndarray of complex, shape (shift, n)
    """
    (whole_right, part_right), (whole_down, part_down) = (np.divmod(shift[:, None], 1) for shift in (right, down))
    transfer = np.exp(-1j * (whole_right * columns + whole_down * rows))
    transfer *= 1 + part_right * (np.exp(-1j * columns) - 1)
    transfer *= 1 + part_down * (np.exp(-1j * rows) - 1)
    return np.asarray(transfer)


def tukey_window(inside: int, before: int, after: int) -> NDArray[np.float64]:
    """Tukey's window: ones, with half a cosine's rise from zero before and its fall behind.

    Parameters
    ----------
    inside, before, after : int
        Samples of each of the three parts.
    """

    def rise(n: int) -> NDArray[np.float64]:
        return 0.5 - 0.5 * np.cos(np.pi * (np.arange(n) + 0.5) / n) if n else np.ones(0)

    return np.concatenate([rise(before), np.ones(inside), rise(after)[::-1]])
