"""Where a frame shows no glass: window frames, walls, what is seen past the edge of a pane.

Light that passes no pane, and is mirrored by none, is mostly unpolarized. Behind glass it is so only where the two
layers happen to hold the balance, along lines of the frame: a region without any polarized light, beyond whose edge
there is much at once, is not glazed. To an estimate of the pane it is a third layer, whose edges lie between those of
the two.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture, NoiseModel, closure_share, noise_of_blocks, registered_noise, stokes_images
from polaropt.estimation.polarized_things import LEAST_SHARE
from polaropt.numerics import block_mean, spread_blocks
from polaropt.optics import SceneParameters, pixel_grid, scene_angles

Images = NDArray[np.float32]
Mask = NDArray[np.bool_]
Values = NDArray[np.float64]

_LEAST_PX, _MOST_BLOCKS, _SCALES = 2, 512, (1, 2, 4)
"""Side in pixels of the smallest blocks, how many of them lie along the longer side at most, and sides of blocks in
units of theirs: small ones see thin window frames, large ones see through noise. Set by hand."""
_AROUND = 3
"""Blocks over which polarized light is averaged, and which a region is wide at least, an odd number; set by hand."""
_SURE = 3.0
"""Standard errors of a mean from which on light is polarized."""
_WEAK, _TOLD = 0.012, 0.004
"""Degree of polarization that what shows no glass may have all over, and standard error of a block's that tells it:
what is behind glass has more beyond 20 degrees of incidence, where nothing is mirrored. By trial."""
_BIN, _BINS, _SMOOTH, _ROUNDS = 0.001, 36, 2.0, 3
"""Width of the bins in which degrees are counted, how many, over how many counts are smoothed, and rounds of the mean
about the fullest; set by hand."""
_MOST = 8.0
"""Mean square, in units of its noise, that one block counts at most, so that edges stay where they are; set by hand."""
_CLEARLY = 2.0
"""Times this limit light is clearly polarized: glass. Set by hand."""
_LEAST_GLASS, _SEEN = 0.15, 0.5
"""Share of the frame at least that is clearly polarized, and of a block that is not clipped; set by hand."""
_FEWEST_BLOCKS, _LEAST_REGION, _LEAST_OF_CELLS = 24, 0.01, 0.1
"""Blocks of a region, and its share of the frame, at least; the same of a mosaic's cells, whose detail does not tell:
on a real one a smooth pipe, polarized as the glass before it balances it, took 0.025, and before a sharp lens an even
sky that the mirrored scene balances 0.08. Set by hand."""
_MOST_LEFT = 0.1
"""Mean square beyond the noise, in units of it, that is always allowed for in a region; set by hand."""
_DIM, _LEAST_SHOWN = 0.1, 0.5
"""Share of what shows glass that is polarized less than is taken for usual, and mean square, in units of the noise,
that so much would at least be in a region: a dark one tells nothing. Set by hand."""
_OF_STEPS = 3.0
"""Variance of a step's square, in units of the square of its variance, with what neighbouring steps share."""
_UNPOLARIZED, _WEAKLY, _HARDLY, _ERRORS, _OTHERWISE = 0.005, 0.014, 0.02, 2.0, 4.0
"""Degree of polarization below which detail is hardly behind glass, where it has 0.005 at 12 degrees of incidence and
more beyond; the same of what is weakly polarized, and where there is no doubt beyond a rim; standard errors by which it
must be so, and beyond which it is not. By trial."""
_LARGE = 0.1
"""Share of the frame from which on a region need not have detail: smooth ones whose layers hold the balance took up to
0.08 behind glass. By trial."""
_MOST_BETWEEN, _SLOWLY, _LEAST_BEYOND = 0.25, 0.5, 0.25
"""Share of what is polarized beyond a region's rim that may be so a little only, as where the layers hold the balance
and polarized light grows slowly; the same where detail tells, too; and share of all beyond a rim that is clearly
polarized at least. By trial: 0 to 0.25 and 0.5 to 1 around frames and walls, 0.3 to 1 and 0 to 0.6 in glass."""
_LEAST_INCIDENCE_DEG = 26.0
"""Closer to normal incidence glass and none hardly differ. By trial on random windows."""


def unglazed_pixels(capture: Capture, noise: float, growth: NoiseModel) -> Mask | None:
    """Pixels (h, w) that show no glass, of a mosaic by its cells; None where nothing tells of any.

    Parameters
    ----------
    capture : Capture
    noise, growth : float and NoiseModel
        `measured_noise` of the capture.
    """
    if capture.cells is not None:
        of_cells = registered_noise(capture, noise)
        found = unglazed_pixels(capture.registered, of_cells, growth.scaled(of_cells / noise))
        return None if found is None else spread_blocks(found, capture.scale, capture.shape[-2:])
    frame = capture.shape[-2:]
    least = max(_LEAST_PX, math.ceil(max(frame) / _MOST_BLOCKS))
    stokes = stokes_images(capture, noise)
    white = noise_of_blocks(capture, noise) / noise
    share = max(LEAST_SHARE, closure_share(capture.intensities, capture.angles_deg, capture.mask))
    means, shares = stokes.means(least), stokes.shares(least).min(axis=0)
    unglazed = np.zeros(frame, dtype=np.bool_)
    for scale in _SCALES:
        side = least * scale
        if min(frame) >= side * _AROUND**2:
            of_means = max(white, stokes.block_noise(side)) / noise / side
            variances = of_means**2 * np.diag(stokes.covariance)[1:]
            of_blocks = block_mean(means, scale).astype(np.float64)
            blocks = _Blocks.of(
                of_blocks, float(variances.mean()), growth, share, block_mean(shares, scale), stokes.aliased
            )
            regions = blocks.unglazed()
            # Of a mosaic no detail could tell it.
            weak = None if stokes.aliased else blocks.without_weak_polarization()
            regions = regions if weak is None else regions | weak.unglazed(weakly=True)
            unglazed |= spread_blocks(regions, side, frame)
    return unglazed if unglazed.any() else None


def surely_unglazed(unglazed: Mask, scene: SceneParameters) -> Mask | None:
    """The regions (h, w) in which a pane would have polarized light enough to be seen; None where it nowhere would.

    Parameters
    ----------
    unglazed : ndarray of bool, shape (h, w)
    scene : SceneParameters
        Complete.
    """
    from scipy.ndimage import label, mean

    if not scene.signal:
        return None
    # As fine as regions are.
    step = math.ceil(max(unglazed.shape) / _MOST_BLOCKS)
    regions, n = label(unglazed[::step, ::step])
    height, width = regions.shape
    x, y = pixel_grid(height, width, ((width - 1) / 2, (height - 1) / 2))
    cosine, *_ = scene_angles(scene, step * x, step * y)
    incidence = np.degrees(np.arccos(np.clip(np.broadcast_to(cosine, regions.shape), -1, 1)))
    steep = mean(incidence, regions, range(1, n + 1)) >= _LEAST_INCIDENCE_DEG
    surely = unglazed & spread_blocks(np.array([False, *steep])[regions], step, unglazed.shape)
    return surely if surely.any() else None


@dataclass(frozen=True)
class _Blocks:
    """Polarized light of blocks.

    Attributes
    ----------
    light : ndarray, shape (channel, rows, columns)
    polarized : ndarray, shape (2, channel, rows, columns)
        s1 and s2.
    variance : ndarray, shape (channel, rows, columns)
        Of the noise of s1 and s2.
    share : float
        Of the light that wrong gains make polarized.
    aliased : bool
        Whether detail looks polarized, here and there, as a mosaic's does.
    seen : ndarray of bool, shape (rows, columns)
    """

    light: Values
    polarized: Values
    variance: Values
    share: float
    aliased: bool
    seen: Mask

    @classmethod
    def of(
        cls, means: Values, variance: float, growth: NoiseModel, share: float, shares: Images, aliased: bool
    ) -> _Blocks:
        """Those of mean Stokes images (3, channel, rows, columns), and of shares (rows, columns) that are not clipped.

        `variance` is that of s1 and s2 in units of a photograph's.
        """
        of_light = variance * growth.variance((means[0] / 2).astype(np.float32)).astype(np.float64)
        return cls(means[0], means[1:], of_light, share, aliased, shares > _SEEN)

    def without_weak_polarization(self) -> _Blocks | None:
        """The same without the weak polarization that most of them share, as paint or wrong gains make it of none.

        None where too few share any, or it is within what is allowed for gains.
        """
        from scipy.ndimage import gaussian_filter

        light = np.maximum(self.light.mean(axis=0), 1e-9)
        noise = np.sqrt(self.variance.mean(axis=0) / len(self.light)) / light
        degrees = self.polarized.mean(axis=1) / light
        edges = np.linspace(-_BINS / 2, _BINS / 2, _BINS + 1) * _BIN
        told = self.seen & (noise < _TOLD) & (np.abs(degrees).max(axis=0) < edges[-1])
        if np.count_nonzero(told) < max(_FEWEST_BLOCKS, _LEAST_REGION * told.size):
            return None
        counts = np.histogram2d(degrees[0][told], degrees[1][told], bins=[edges, edges])[0]
        most = np.unravel_index(np.argmax(gaussian_filter(counts, _SMOOTH, mode="constant")), counts.shape)
        shared = (edges[:-1] + _BIN / 2)[list(most)]
        for _ in range(_ROUNDS):
            near = told & (np.hypot(*(degrees - shared[:, None, None])) < _BIN + _ERRORS * noise)
            if not near.any():
                return None
            shared = degrees[:, near].mean(axis=1)
        if not self.share < np.hypot(*shared) < _WEAK:
            return None
        return replace(self, polarized=self.polarized - shared[:, None, None, None] * self.light)

    def part(self, place: Any) -> _Blocks:
        """Those of some rows and columns."""
        light, polarized, variance = (image[(..., *place)] for image in (self.light, self.polarized, self.variance))
        return replace(self, light=light, polarized=polarized, variance=variance, seen=self.seen[place])

    @property
    def allowed(self) -> Values:
        """Mean square of s1 and s2 that noise and gains leave in unpolarized light, (channel, rows, columns)."""
        return np.asarray(self.variance + np.square(self.share * self.light))

    @property
    def squares(self) -> Values:
        """Mean square of s1 and s2 in units of it, over the colours, (rows, columns)."""
        return np.asarray((np.square(self.polarized).mean(axis=0) / self.allowed).mean(axis=0))

    def unglazed(self, *, weakly: bool = False) -> Mask:
        """Regions (rows, columns) that show no glass, with their rims; what is weakly polarized by its detail alone."""
        from scipy.ndimage import binary_dilation, binary_opening, find_objects, label, uniform_filter

        squares = self.squares
        # Of the mean of a normal value's squares, two in each colour.
        limit = 1 + _SURE * math.sqrt(1 / len(self.light)) / _AROUND
        around = uniform_filter(np.minimum(squares, _MOST), _AROUND, mode="nearest")
        glass: Mask = self.seen & (around > _CLEARLY * limit)
        found = np.zeros_like(glass)
        if glass.mean() < _LEAST_GLASS:
            return found
        between = self.seen & (around > limit) & ~glass
        usual = self._usual_degree(squares, glass)
        near = np.ones((_AROUND, _AROUND), dtype=np.bool_)
        regions, _ = label(binary_opening(self.seen & (around < limit), near))
        fewest = max(_FEWEST_BLOCKS, (_LEAST_OF_CELLS if self.aliased else _LEAST_REGION) * regions.size)
        for number, inside in enumerate(find_objects(regions), start=1):
            # With its rim and what lies beyond.
            margin = 2 * (_AROUND // 2)
            place: Any = tuple(slice(max(0, side.start - margin), side.stop + margin) for side in inside)
            blocks, region = self.part(place), regions[place] == number
            if np.count_nonzero(region) < fewest or not blocks.is_unpolarized(region, usual):
                continue
            rim = binary_dilation(region, near)
            beyond = binary_dilation(rim, near) & ~rim & blocks.seen
            large = np.count_nonzero(region) >= _LARGE * regions.size
            if blocks.ends_at_once(region, beyond, glass[place], between[place], weakly=weakly, large=large):
                found[place] |= rim
        return found

    def _usual_degree(self, squares: Values, glass: Mask) -> float:
        """Degree of polarization that most of what shows glass has at least."""
        over = np.maximum(squares - 1, 0) * self.allowed.mean(axis=0)
        return float(np.quantile(np.sqrt(over[glass]) / np.maximum(self.light.mean(axis=0)[glass], 1e-9), _DIM))

    def is_unpolarized(self, region: Mask, usual: float) -> bool:
        """Whether a region is not polarized beyond noise and gains, where so much would have been seen."""
        light, allowed = self.light[:, region], self.allowed[:, region]
        shown = float((np.square(usual * light) / allowed).mean())
        left = float(self.squares[region].mean()) - 1
        mean = np.abs(self.polarized[..., region].mean(axis=(1, 2))).max()
        of_mean = math.sqrt(float(self.variance[:, region].mean()) / light.size)
        within_gains = mean < self.share * float(light.mean()) + _SURE * of_mean
        within_noise = left < _SURE * math.sqrt(1 / light.size) + _MOST_LEFT
        return bool(shown > _LEAST_SHOWN and within_gains and within_noise)

    def ends_at_once(
        self, region: Mask, beyond: Mask, glass: Mask, between: Mask, *, weakly: bool, large: bool
    ) -> bool:
        """Whether there is clearly polarized light beyond a region's rim, as no detail in it has.

        A large region need not have any.
        """
        from scipy.ndimage import binary_erosion

        n_glass, n_between = np.count_nonzero(beyond & glass), np.count_nonzero(beyond & between)
        if not n_glass or n_glass < _LEAST_BEYOND * np.count_nonzero(beyond):
            return False
        slow = n_between / (n_glass + n_between)
        if self.aliased:
            return bool(slow <= _MOST_BETWEEN)
        # Blocks at its border are partly glass.
        inside = binary_erosion(region, np.ones((_AROUND, _AROUND)), border_value=1)
        detail, error = self._polarized_detail(inside)
        most = max(detail, 0) + _ERRORS * error
        if weakly:
            return bool(slow <= _MOST_BETWEEN and most < _WEAKLY**2)
        if max(most, -detail) < _UNPOLARIZED**2:
            return bool(slow <= _SLOWLY)
        told = large or most < _HARDLY**2
        return bool(told and slow <= _MOST_BETWEEN and detail <= _OTHERWISE * error)

    def _polarized_detail(self, region: Mask) -> tuple[float, float]:
        """Square of the degree of polarization of detail, steps from block to block, and its standard error."""
        before, after, whole = slice(None, -1), slice(1, None), slice(None)
        of_light = of_polarized = of_noise = squares = 0.0
        for first, second in (((before, whole), (after, whole)), ((whole, before), (whole, after))):
            both = region[first] & region[second]
            light = (self.light[..., *second] - self.light[..., *first])[..., both]
            polarized = (self.polarized[..., *second] - self.polarized[..., *first])[..., both]
            noise = (self.variance[..., *first] + self.variance[..., *second])[..., both]
            of_light += float(np.square(light).sum() - noise.sum())
            of_polarized += float(np.square(polarized).sum())
            of_noise += 2 * float(noise.sum())
            squares += 2 * float(np.square(noise).sum())
        of_light = max(of_light, 1e-12)
        return (of_polarized - of_noise) / of_light, math.sqrt(_OF_STEPS * squares) / of_light
