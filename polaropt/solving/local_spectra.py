"""What layers are expected to be in each place: Wiener filters of windows whose spectra are the place's own.

A closed form takes the layers for Gaussian with one spectrum all over the frame. Natural scenes are calm in one place
and busy in another: within a window the power of each frequency is that of the layers at hand there and of what the
photographs leave open of them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from polaropt.inversion import RESOLUTION, Canvas, ClosedForm, left_open, unknown_share
from polaropt.numerics import Basis, column_multiplicity, filtered, squared_frequencies
from polaropt.solving.windows import (
    COARSE,
    FINE,
    WindowSize,
    add_to,
    frame_of,
    in_rows,
    mirrored_around,
    row_of,
    spectra_of,
)
from priors.natural_image import in_basis

if TYPE_CHECKING:
    from polaropt.solving.kernels.windows import Photographed
    from polaropt.solving.varying_information import VaryingInformation

Images = NDArray[np.float32]
Power = NDArray[np.float32]
Spectrum = NDArray[np.complex64]

REACH_PX = 16.0
"""Shift of ghosts up to which windows tell them: of 12 px both layers gain, of 30 px the reflection loses 2 dB."""
_FIRST_LENGTH, LENGTHS = 0.6, (0.1, 2.0)
"""Of steps where there is more than one turn: of the first, and between which others lie. Set by hand."""


Turns = tuple[tuple[WindowSize, int], ...]
"""Sizes of windows, and how often each takes its spectra from the layers at hand."""
TURNS: Turns = ((COARSE, 3), (FINE, 2))
"""Of photographs. Beside two and one, each a whole step, layers end 0.05 and 0.2 dB higher on captures of training
photographs behind panes at 25 to 75 degrees, at 10 degrees as high, for 1.2 times the seconds; four and two gain 0.03
of the reflection for 1.3 times."""
TURNS_OF_SAMPLES: Turns = ((COARSE, 6), (FINE, 3))
"""Of mosaics, whose samples tell much that lies apart in frequency together, so that whole steps overshoot: layers
end 0.3 and 0.25 dB higher."""
AROUND_LAYERS: Turns = ((FINE, 1),)
"""Around layers of a learned start, which more turns forget: a second one costs up to 0.07 dB."""
# What is open of a frequency counts so much, where the photographs tell it well, and all of it where they do not tell
# it: there the layers at hand are smoother than the scene.
OPEN = 0.25
BESIDE, OF_LIGHT = 0.3, 0.3
"""Share that the power of the frequencies beside one, of the same direction, has in its own, and that of the light in
that of other colours, all in units of the frame's own: a window tells each but once, and what is busy in one is busy in
the other. On captures of training photographs behind panes at 40 to 75 degrees both layers gain 0.08 dB by it where the
solves end, with grain, which colours do not share, 0.03 and 0.06, mosaics 0.05. More of the light loses 0.1 dB with
grain; frequencies beside in all directions gain two thirds; of windows beside a window both layers lose."""
# Power mean of the precision in a window. With shot noise of 2e-3 behind a pane at 60 degrees two coarse turns and a
# fine one end at 35.0, 36.3, 36.5 and 36.4 dB with powers of 1, 2, 4 and 10 (two turns of the first at 35.8).
TOWARDS_LARGEST = 4
# Side in pixels of what lies around a pixel: of coarse windows, and odd.
_AROUND_PX = COARSE.side_px + 1
# Mean square by which a window differs from that of the frame before, in units of what noise may do, from which on it
# shows something else, and the share of such windows up to which a frame is the same: set by hand.
_CHANGED, _FEW = np.float32(3.0), 0.1
# Power of a window's frequency that is divided by.
LEAST_POWER = 1e-12


@dataclass(frozen=True)
class Expectation:
    """What is expected of the layers before the sparse penalties.

    Attributes
    ----------
    layers : ndarray of float32, shape (2, channel, H, W)
        On the canvas, in the colour basis.
    variance : ndarray of float32, shape (2, channel, H, W // 2 + 1)
        What is left open per frequency, mean over the frame.
    """

    layers: Images
    variance: Power
    seen: SeenSpectra | None = None
    """What a frame after this one may begin with; None where there is none."""
    still: bool = False
    """Whether nearly all of the frame shows what the one before did."""

    def in_colors(self, basis: Basis) -> Images:
        """The layers in the colours of the photographs."""
        return np.asarray(in_basis(basis.T.astype(np.float32), self.layers, np))

    def unknown_detail(self, reflection: Images, width: int) -> float:
        """Share of the reflection's detail (channel, h, w) that remains open, on a canvas of this width, 0..1."""
        height = self.variance.shape[-2]
        rows, columns = squared_frequencies(height, width)
        share = (column_multiplicity(width) / (height * width)).astype(np.float32)
        return unknown_share(self.variance[1], (rows[:, None] + columns).astype(np.float32), share, reflection)


@dataclass(frozen=True)
class SeenSpectra:
    """Windows of one frame, and the layers' spectra in them, which the next frame of a film hardly changes.

    Attributes
    ----------
    windows : Windows
    power : tuple of ndarray
        Of each row of windows, (2, channel, window, side, side // 2 + 1).
    light : ndarray of float32, shape (2, h, w)
        Of the layers in closed form: the first of the basis's colours.
    left : ndarray of float32, shape (2, channel, H, W // 2 + 1)
        What is left open per frequency without windows.
    """

    windows: Windows
    power: tuple[Power, ...]
    light: Images
    left: Power

    def changed(self, light: Images, variance: NDArray[np.float64], precision: Images) -> NDArray[np.bool_]:
        """Windows (down, across) in which another frame shows something else.

        Parameters
        ----------
        light : ndarray, shape (2, h, w)
            Of the other frame.
        variance : ndarray, shape (2,)
            That the photographs leave to a pixel of each layer.
        precision : ndarray
            `Windows.means` of what a pixel's photographs tell.
        """
        apart = np.square(light - self.light)
        sigmas = sum(of_layer / np.float32(2 * of_noise) for of_layer, of_noise in zip(apart, variance, strict=True))
        return np.asarray(precision * self.windows.means(np.asarray(sigmas)) > len(apart) * _CHANGED)[..., 0, 0]


def believed_share(precision: Images) -> Images:
    """Share of what pixels tell (channel, h, w) that windows are shown: none more than those around it on average.

    Where a few dark pixels lie among bright ones, whose noise is larger, a step with the precision of their window
    overshoots: on captures of training photographs with shot noise of 1e-3 of white both layers gain 0.1 dB by it, and
    up to 0.7 where the pane is seen at 15 to 25 degrees.
    """
    from scipy.ndimage import uniform_filter

    around = uniform_filter(precision.mean(axis=0), _AROUND_PX, mode="nearest")
    return np.asarray(np.minimum(1, around / precision), dtype=np.float32)


def expected_layers(
    known: ClosedForm,
    canvas: Canvas,
    misfit_gradient: Callable[[Images], Images],
    precision: Images,
    layers: Images | None = None,
    *,
    sampled: bool = False,
    varying: VaryingInformation | None = None,
    fast_alone: bool = False,
    before: SeenSpectra | None = None,
    remember: bool = False,
) -> Expectation | None:
    """Layers under spectra of their own in each window; None where the steps to them run away, as before a mirror.

    Parameters
    ----------
    known : ClosedForm
    canvas : Canvas
    misfit_gradient : callable
        Gradient (2, channel, H, W) of the photographs' misfit at canvas layers.
    precision : ndarray, shape (h, w)
        What a pixel's photographs tell, beside what `known` takes for it: bright light has more noise.
    layers : ndarray of float32, shape (2, channel, H, W), optional
        Those at hand that the first spectra are taken from. Default: the closed form's, which coarse windows see first.
    sampled : bool
        Whether the photographs are samples of a mosaic.
    varying : VaryingInformation, optional
        What photographs tell in each place. Default: the same everywhere, which `known` says.
    fast_alone : bool
        Whether windows are shown what is fast alone, as what is slow is known without them.
    before : SeenSpectra, optional
        Of the frame before, behind the same pane and of the same size: where this one shows the same, its spectra are
        taken. One turn does then, in which other windows take their spectra from what they would expect first.
    remember : bool
        Whether the result tells what the next frame may begin with.
    """
    light = np.tensordot(known.basis[0].astype(np.float32), canvas.crop(known.layers), axes=(0, 1))
    if before is None:
        sizes = (TURNS_OF_SAMPLES if sampled else TURNS) if layers is None else AROUND_LAYERS
        options = {"fast_alone": fast_alone, "sampled": sampled}
        steps = [(Windows(known, canvas, size, varying, **options), times) for size, times in sizes]
        last, changed = steps[-1][0], None
    else:
        last = before.windows
        steps, changed = [(last, 1)], before.changed(light, known.variance[:, 0], last.means(precision))
    layers = known.layers if layers is None else layers
    farthest = _FARTHEST_STEP * float(np.abs(known.layers).max())
    for windows, times in steps:
        of_windows = windows.sure_precision(precision)
        length, change = first_length(times), None
        for _ in range(times):
            step = windows.step(
                layers,
                misfit_gradient(layers),
                of_windows,
                None if before is None else before.power,
                changed,
                remember=remember and windows is last,
            )
            if not float(np.abs(step.change).max()) <= farthest:
                return None
            if change is not None:
                products = (float(np.sum(change * other, dtype=np.float64)) for other in (change, step.change))
                length = next_length(length, *products)
            change = step.change
            layers = layers.copy()
            canvas.crop(layers)[...] += np.float32(length) * in_basis(known.basis.T.astype(np.float32), change, np)
    own = in_basis(known.basis.astype(np.float32), layers, np)
    # At the canvas's own frequencies, as ghosts farther apart than a window leave some of them open.
    left = left_open(known.told[:, None], known.cross, _inverse_of(known.prior))[0] if before is None else before.left
    seen = SeenSpectra(last, step.power, light, left) if remember else None
    still = changed is not None and bool(changed.mean() < _FEW)
    return Expectation(np.asarray(own, dtype=np.float32), left * last.on_canvas(step.share), seen, still)


_FARTHEST_STEP = 10.0
"""Of the closed form's largest value, what no step goes beyond that does not run away: they are half of it at most for
panes at 20 to 89.9 degrees. Set by hand."""


def first_length(times: int) -> float:
    """How far to go along the first change of some turns."""
    return 1.0 if times == 1 else _FIRST_LENGTH


def next_length(length: float, square: float, left: float) -> float:
    """How far to go along a change, given how far it was gone along the one before.

    By Barzilai and Borwein, Two-point step size gradient methods (1988): what is left of a change after a step along it
    tells how much of it steps of length 1 overshoot.

    Parameters
    ----------
    length : float
        Of the step along the change before.
    square, left : float
        Products of that change with itself and with the one now.
    """
    least, most = LENGTHS
    return min(max(length * square / (square - left), least), most) if square > left else most


@dataclass(frozen=True)
class Step:
    """A turn towards what is expected.

    Attributes
    ----------
    change : ndarray of float32, shape (2, channel, h, w)
        Of the layers within the frame, in the colour basis.
    share : ndarray of float32, shape (2, channel, side, side // 2 + 1)
        How much less is then open than without windows, mean of all.
    power : tuple of ndarray
        Of the layers in each row of windows after it; empty if not asked for.
    """

    change: Images
    share: Power
    power: tuple[Power, ...]


class _Seen(NamedTuple):
    """What photographs tell of windows, and what they leave open without these, (2, channel, window, frequency)."""

    photographed: Photographed
    left: Power


class Windows:
    """Overlapping windows of a frame, each with a spectrum of its own.

    Parameters
    ----------
    known : ClosedForm
    canvas : Canvas
    size : WindowSize
    varying : VaryingInformation, optional
        What photographs tell in each place. Default: the same everywhere, which `known` says.
    fast_alone : bool
        Whether they are shown what is fast alone.
    sampled : bool
        Whether the photographs are samples of a mosaic.
    """

    def __init__(
        self,
        known: ClosedForm,
        canvas: Canvas,
        size: WindowSize = COARSE,
        varying: VaryingInformation | None = None,
        *,
        fast_alone: bool = False,
        sampled: bool = False,
    ) -> None:
        self._side_px, self._step_px = size.side_px, size.step_px
        self._canvas, self._basis, self._mean = canvas, known.basis.astype(np.float32), known.mean.astype(np.float32)
        self._size, self._window = size, np.outer(size.profile, size.profile)
        self._fast, self._along = size.fast, size.along
        self._of_pattern = size.of_pattern if sampled else None
        # One axis more, for the windows of a row.
        self._prior = np.maximum(_flat(self._at_windows(known.prior)), np.float32(LEAST_POWER))[:, :, None]
        self._varying = varying
        told, cross = self._through_window(known.told).real, self._through_window(known.cross)
        self._everywhere = self._seen(_flat(told)[:, None], cross.reshape(1, -1))
        self._faster = size.faster(*canvas.shape) if fast_alone else None
        if varying is not None:
            self._pairs = self._through_window(varying.pairs).reshape(len(varying.pairs), -1)

    def means(self, image: Images) -> Images:
        """Mean of an image (h, w) in each window, (windows down, windows across, 1, 1)."""
        extended = mirrored_around(image, self._size)
        weight = np.square(self._window) / np.square(self._window).sum()
        everywhere = np.lib.stride_tricks.sliding_window_view(extended, self._window.shape)
        views = everywhere[:: self._step_px, :: self._step_px]
        return np.asarray(np.einsum("ijyx,yx->ij", views, weight)[:, :, None, None], dtype=np.float32)

    def sure_precision(self, precision: Images) -> Images:
        """Precision of each window from that of the pixels (h, w), (windows down, windows across, 1, 1).

        A step with the mean overshoots where it is light and dark in one window, the more the more turns there are, one
        with the largest falls short: in between.
        """
        lengthened = self.means(precision**TOWARDS_LARGEST) ** np.float32(1 / TOWARDS_LARGEST)
        return np.asarray(lengthened, dtype=np.float32)

    def _through_window(self, spectrum: NDArray[Any]) -> Spectrum:
        """A filter (..., H, W // 2 + 1) as windows see it: of its kernel what lies as far apart within one."""
        from scipy.fft import irfft2, rfft2

        height, width = self._canvas.shape
        kernel, part = irfft2(spectrum, s=(height, width)), self._size.kernel_within(height, width)
        within = np.zeros((*spectrum.shape[:-2], self._side_px, self._side_px), dtype=np.float32)
        values = kernel[..., part.rows, part.columns] * part.weights
        # Half of what lies apart is ahead: from the window's second place on, as it goes round.
        halves = ((slice(None, self._side_px - 1), slice(1, None)), (slice(self._side_px - 1, None), slice(None)))
        for rows, down in halves:
            for columns, across in halves:
                within[..., down, across] += values[..., rows, columns]
        return np.asarray(rfft2(within), dtype=np.complex64)

    def _at_windows(self, spectrum: NDArray[Any]) -> NDArray[Any]:
        """A spectrum of the canvas (..., H, W // 2 + 1) at the frequencies of a window."""
        rows, columns = self._size.nearest(*self._canvas.shape)
        return np.ascontiguousarray(spectrum[..., rows, :][..., columns])

    def step(
        self,
        layers: Images,
        gradient: Images,
        precision: Images,
        before: Sequence[Power] | None = None,
        changed: NDArray[np.bool_] | None = None,
        *,
        remember: bool = False,
    ) -> Step:
        """From the layers at hand to what is expected.

        Parameters
        ----------
        layers : ndarray of float32, shape (2, channel, H, W)
            On the canvas: those at hand.
        gradient : ndarray of float32, shape (2, channel, H, W)
            Of the misfit there.
        precision : ndarray
            `sure_precision` of what a pixel's photographs tell.
        before : sequence of ndarray, optional
            Power of another frame's layers in each row of windows. Default: that of the layers at hand.
        changed : ndarray of bool, shape (windows down, windows across), optional
            Windows in which the other frame shows something else: they take what they expect with the power at hand.
        remember : bool
            Whether the power after it is told.
        """
        from polaropt.solving.kernels.windows import expect, likely_power, limit_power, power_of, share_power

        if self._faster is not None:
            layers, gradient = filtered(layers, self._faster), filtered(gradient, self._faster)
        own, downhill = self._extended(layers), self._extended(gradient)
        if self._faster is None:
            own -= self._mean
        np.negative(downhill, out=downhill)
        change = np.zeros_like(own)
        left = np.zeros((len(precision), *own.shape[:2], self._fast.size), dtype=np.float32)
        left_before = np.zeros_like(left)
        after: list[Power] = [np.empty(0, dtype=np.float32)] * len(precision)

        def turn(i: int) -> None:
            here, moved = (spectra_of(row_of(images, i, self._size), self._size) for images in (own, downhill))
            seen = self._seen_in_row(i, precision.shape[1])
            left_before[i] = seen.left.mean(axis=2)
            told = (_parts(here), _parts(moved), precision[i].ravel(), seen.photographed)
            if before is None or changed is None:
                power = np.empty(here.shape, dtype=np.float32)
                power_of(told[0], _flat(power))
            else:
                power = before[i].copy()
                likely_power(*told, changed[i], _flat(power))
            counted, shares = seen.photographed.counted, (np.float32(BESIDE), np.float32(OF_LIGHT))
            share_power(_flat(power), counted, self._prior[:, :, 0], self._along, *shares)
            if self._of_pattern is not None:
                limit_power(_flat(power), counted, self._prior[:, :, 0], *self._of_pattern)
            expect(*told, _flat(power), left[i])
            if remember:
                after[i] = power
            add_to(row_of(change, i, self._size), moved, self._size)

        in_rows(turn, len(precision))
        # Where windows do not tell a layer's changes nothing has been found out of them.
        still, found = left_before.mean(axis=0, dtype=np.float64), left.sum(axis=0, dtype=np.float64) / precision.size
        share = np.where(self._fast.ravel() > 0, found, still) / self._everywhere.left[:, :, 0]
        share = share.reshape(*share.shape[:-1], *self._fast.shape)
        inside = frame_of(change, self._size, self._canvas.height, self._canvas.width)
        return Step(inside, share.astype(np.float32), tuple(after) if remember else ())

    def _seen_in_row(self, i: int, n: int) -> _Seen:
        """What photographs tell of the windows in a row of n."""
        if self._varying is None:
            return self._everywhere
        told = self._varying.told(i * self._step_px, np.arange(n) * self._step_px, self._step_px) @ self._pairs
        return self._seen(told[:2].real, told[2])

    def _seen(self, told: Power, cross: Spectrum) -> _Seen:
        """What photographs tell of windows: (2, window, frequency), and of both layers together (window, frequency)."""
        from polaropt.solving.kernels.windows import Photographed

        left = left_open(told[:, None], cross, _inverse_of(self._prior))[0]
        untold = np.minimum(left / self._prior, 1)
        counted = np.asarray((OPEN + (1 - OPEN) * untold) * left, dtype=np.float32)
        least, resolution = np.float32(LEAST_POWER), np.float32(RESOLUTION)
        parts = np.ascontiguousarray(cross).view(np.float32).reshape(*cross.shape, 2)
        fast = self._fast.ravel()
        return _Seen(Photographed(np.ascontiguousarray(told), parts, counted, fast, least, resolution), left)

    def _extended(self, images: Images) -> Images:
        """Canvas images in the colour basis within the frame, mirrored around it."""
        return mirrored_around(in_basis(self._basis, self._canvas.crop(images), np), self._size)

    def on_canvas(self, share: Power) -> Power:
        """A share at the frequencies of a window (..., side, side // 2 + 1) at those of the canvas."""
        height, width = self._canvas.shape
        rows, columns = (np.fft.fftfreq(height) % 1) * self._side_px, np.asarray(np.fft.rfftfreq(width) * self._side_px)
        periodic = np.concatenate([share, share[..., :1, :]], axis=-2)
        return _between(_between(periodic, rows, -2), columns, -1)


def _flat(power: Power) -> Power:
    """Power (..., side, side // 2 + 1) as (..., frequency)."""
    return power.reshape(*power.shape[:-2], power.shape[-2] * power.shape[-1])


def _parts(spectra: Spectrum) -> Images:
    """Real and imaginary parts (..., frequency, 2) of spectra (..., side, side // 2 + 1), which share their memory."""
    assert spectra.flags.c_contiguous  # of a copy, what is written would be lost
    return spectra.view(np.float32).reshape(*spectra.shape[:-2], spectra.shape[-2] * spectra.shape[-1], 2)


def _inverse_of(power: NDArray[Any]) -> Power:
    return np.asarray(np.float32(1) / np.maximum(power, np.float32(LEAST_POWER)), dtype=np.float32)


def _between(values: Power, places: NDArray[Any], axis: int) -> Power:
    """Values at fractional places along an axis, linearly."""
    first = np.minimum(places.astype(int), values.shape[axis] - 2)
    weight = np.float32(places - first).reshape(-1, *[1] * (-1 - axis))
    between = (1 - weight) * np.take(values, first, axis) + weight * np.take(values, first + 1, axis)
    return np.asarray(between, dtype=np.float32)
