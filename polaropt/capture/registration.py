"""How far photographs are shifted, turned and scaled against each other.

Behind glass each photograph is a mixture of the same two pictures (and of ghosts of them), so that k photographs that
lie on each other have a covariance of rank 2, noise apart. A motion of one raises it. The motions that make the
logarithm of its determinant least are those of greatest likelihood if the pixels are taken for normal; nothing of the
pane needs to be known for it, neither gains nor exposures matter, and ghosts do not bias it, as they would bias the
correlation of two photographs.

All that is needed of the photographs are the products of their values and of what each motion adds to them to first
order (their gradients), a matrix of 3k x 3k for shifts. A turn and growth about the middle of the frame are counted in
pixels at its corners, so that all motions are alike.

From halved and halved again photographs to whole ones, so that a turn that moves the corners by many pixels moves them
by few at first. On each size the likelihood of all photographs together is climbed; the first start is the correlation
of all pairs.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.capture.capture import Capture
from polaropt.numerics import block_mean, middle_part, strips

Matrix = NDArray[np.float64]
Image = NDArray[np.float32]

SHIFTS, SHIFTS_AND_TURNS = 2, 4
"""Free motions of a photograph: down and right; these, turn and growth."""
MIRRORED_PX = 16
"""Pixels that an image is mirrored beyond its edges before it is resampled: splines and Fourier sums fade over fewer;
set by hand."""
WHOLE = 0.999
"""Share of a pixel that counts from which on it is whole: linear interpolation of ones rounds."""


@dataclass(frozen=True)
class Motions:
    """Where each photograph holds what the first one shows, rows and columns counted from the middle of the frame.

    Attributes
    ----------
    matrices : ndarray, shape (k, 2, 2)
        A scene point at (row, column) u in the first photograph lies at ``matrices[k] @ u + offsets[k]``.
    offsets : ndarray, shape (k, 2)
        Pixels down and to the right.
    """

    matrices: Matrix
    offsets: Matrix

    @classmethod
    def of_shifts(cls, shifts: Matrix) -> Motions:
        """Shifts (k, 2) and nothing else."""
        return cls(np.tile(np.eye(2), (len(shifts), 1, 1)), np.asarray(shifts, dtype=np.float64))

    def followed_by(self, step: Matrix, half_diagonal: float) -> Motions:
        """After a small motion more: down, right, (k, 2), or also turn and growth in pixels at the corners, (k, 4)."""
        offsets = self.offsets + (self.matrices @ step[:, :2, None])[..., 0]
        if step.shape[1] == SHIFTS:
            return Motions(self.matrices, offsets)
        turn, growth = step[:, 2] / half_diagonal, step[:, 3] / half_diagonal
        more = np.stack([np.stack([1 + growth, turn], -1), np.stack([-turn, 1 + growth], -1)], -2)
        return Motions(self.matrices @ more, offsets)

    @property
    def turned(self) -> bool:
        """Whether any is turned or scaled, not only shifted."""
        return bool((self.matrices != np.eye(2)).any())

    def magnified(self, factor: float) -> Motions:
        """The same in pixels that are smaller by a factor."""
        return Motions(self.matrices, self.offsets * factor)

    def about(self, point: Matrix) -> Motions:
        """The same with rows and columns counted from another point, (2,), given from the middle."""
        return Motions(self.matrices, self.offsets + (self.matrices - np.eye(2)) @ point)

    @property
    def rotations_deg(self) -> Matrix:
        """How far each photograph is turned, clockwise as seen, (k,)."""
        return np.asarray(np.degrees(np.arctan2(self.matrices[:, 0, 1], self.matrices[:, 0, 0])))

    @property
    def scales(self) -> Matrix:
        """How much larger each photograph shows the scene, (k,)."""
        return np.asarray(np.hypot(self.matrices[:, 0, 1], self.matrices[:, 0, 0]))

    def displacements(self, points: Matrix) -> Matrix:
        """How far scene points (n, 2) lie from where they are in the first photograph, (k, n, 2)."""
        turned = np.matmul(points, np.swapaxes(self.matrices - np.eye(2), 1, 2))
        return np.asarray(turned + self.offsets[:, None], dtype=np.float64)

    def apart_at_corners(self, shape: tuple[int, ...]) -> float:
        """Largest distance between where two photographs hold a corner of a frame (..., h, w), in pixels."""
        places = self.displacements(corners(shape))
        return float(max(np.linalg.norm(a - b, axis=-1).max() for a, b in combinations(places, 2)))


def corners(shape: tuple[int, ...]) -> Matrix:
    """Corners of a frame (..., h, w) from its middle: top left, top right, bottom left, bottom right, (4, 2)."""
    half = (np.asarray(shape[-2:]) - 1) / 2
    return np.asarray(half * np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]]))


def _place(matrix: Matrix, offset: Matrix, shape: tuple[int, ...]) -> Matrix:
    """Offset of an affine map of array indices that is given from the middle of the frame."""
    middle = (np.asarray(shape) - 1) / 2
    return np.asarray(middle + offset - matrix @ middle, dtype=np.float64)


def moved_back(image: Image, matrix: Matrix, offset: Matrix, order: int) -> Image:
    """An image (h, w) as the first photograph would show it, by splines; zero beyond its edges."""
    from scipy.ndimage import affine_transform, shift

    if (matrix == np.eye(2)).all():
        # Several times as fast.
        return np.asarray(shift(image, -offset, order=order), dtype=np.float32) if offset.any() else image
    place = _place(matrix, offset, image.shape)
    return np.asarray(affine_transform(image, matrix, place, order=order), dtype=np.float32)


def finely_moved_back(image: Image, matrix: Matrix, offset: Matrix) -> Image:
    """The same without loss of the finest detail: doubled in the Fourier domain, then by splines, some rows at a time.

    Splines alone smooth the finest detail and the noise. The image is mirrored beyond its edges.
    """
    from scipy.ndimage import affine_transform, spline_filter

    height, width = image.shape
    tall = _doubled(np.pad(image, MIRRORED_PX, mode="symmetric"), 0)
    place = 2 * (_place(matrix, offset, image.shape) + MIRRORED_PX)
    moved = np.empty(image.shape, dtype=np.float32)
    for rows in strips(height, 4 * tall.shape[1]):
        ends = np.array([(row, column) for row in (rows.start, rows.stop - 1) for column in (0, width - 1)])
        seen = 2 * ends @ matrix[0] + place[0]
        top = int(np.clip(math.floor(seen.min()) - _FADED, 0, len(tall) - _FADED))
        bottom = int(np.clip(math.ceil(seen.max()) + _FADED, top + _FADED, len(tall)))
        coefficients = _doubled(tall[top:bottom], 1)
        spline_filter(coefficients, order=3, output=coefficients)
        start = 2 * matrix[:, 0] * rows.start + place - (top, 0)
        affine_transform(
            coefficients, 2 * matrix, start, output=moved[rows], order=3, mode="nearest", prefilter=False
        )  # fmt: skip
    return moved


_FADED = 32
"""Rows over which the coefficients of cubic splines forget where an image ends: each row leaves 27 %."""
_LINES = 16
"""Lines that are transformed together are a multiple of it: those that processors take at once."""


def _doubled(image: Image, axis: int) -> Image:
    """An image with twice as many samples along an axis, in the Fourier domain, some lines at a time."""
    from scipy.signal import resample

    n, lines = image.shape[axis], image.shape[1 - axis]
    doubled = np.empty((2 * n, lines) if axis == 0 else (lines, 2 * n), dtype=np.float32)
    for part in strips(lines, 2 * n, _LINES):
        where = (slice(None), part) if axis == 0 else (part, slice(None))
        doubled[where] = resample(image[where], 2 * n, axis=axis)
    return doubled


Images = NDArray[np.floating[Any]]

_STRIPS = 12
"""Parts of a frame by whose disagreement errors are measured; set by hand."""
_FLOOR = 1e-6
"""Least variance of noise, relative to all variance: photographs without any have no determinant; set by hand."""
_ROUNDS = 60
"""Most rounds of a fit of small motions; set by hand."""


@dataclass(frozen=True)
class SmallMotions:
    """Motions of about a pixel at most against the first photograph.

    Attributes
    ----------
    pixels : ndarray, shape (k, 2) or (k, 4)
        Down and to the right, then turn (clockwise) and growth in pixels at the corners; the first is 0.
    error : float
        Largest standard error of them, from how far parts of the frame disagree; infinite where nothing tells.
    """

    pixels: Matrix
    error: float


def products(images: Images, trusted: NDArray[np.bool_] | None = None, n_motions: int = SHIFTS) -> Matrix:
    """Products of values, downward and rightward gradients of images (k, h, w), in strips, (strip, 3k, 3k).

    Parameters
    ----------
    images : ndarray, shape (k, h, w)
        Smooth, so that differences of neighbours are gradients.
    trusted : ndarray of bool, shape (h, w), optional
        Pixels that count; all if not given. Their neighbours must hold values, too.
    n_motions : int
        `SHIFTS_AND_TURNS`: what turn and growth add comes after the gradients, (strip, 5k, 5k).
    """
    values = images[:, 1:-1, 1:-1]
    half = images.dtype.type(0.5)
    down = (images[:, 2:, 1:-1] - images[:, :-2, 1:-1]) * half
    right = (images[:, 1:-1, 2:] - images[:, 1:-1, :-2]) * half
    motions = [down, right]
    if n_motions == SHIFTS_AND_TURNS:
        y, x = (part.astype(images.dtype) for part in from_middle(images.shape[-2:]))
        y, x = y[1:-1], x[:, 1:-1]
        motions += [x * down - y * right, y * down + x * right]
    features = np.concatenate([values, *motions])
    chosen = features.reshape(len(features), -1) if trusted is None else features[:, trusted[1:-1, 1:-1]]
    length = chosen.shape[1] // _STRIPS
    strips = chosen[:, : length * _STRIPS].reshape(len(features), _STRIPS, length).transpose(1, 0, 2)
    sums: Matrix = (strips @ strips.transpose(0, 2, 1)).astype(np.float64)
    return sums


def from_middle(shape: tuple[int, ...]) -> tuple[Matrix, Matrix]:
    """Rows (h, 1) and columns (1, w) from the middle of a frame, in units of its half diagonal."""
    height, width = shape
    half = np.hypot(height - 1, width - 1) / 2
    rows, columns = ((np.arange(side) - (side - 1) / 2) / half for side in (height, width))
    return rows[:, None], columns[None, :]


def disagreement(strips: Matrix, n_motions: int = SHIFTS) -> float:
    """Logarithm of the determinant of the photographs' correlations: 0 where they have nothing in common, else below.

    Unlike that of their covariance it does not fall because resampling smooths noise.
    """
    total = strips.sum(axis=0)
    count = len(total) // (1 + n_motions)
    covariance = _floored(total[:count, :count])
    return float(np.linalg.slogdet(covariance)[1] - np.log(np.diag(covariance)).sum())


def fit_small_motions(strips: Matrix, at_rest: float = 1e-4, n_motions: int = SHIFTS) -> SmallMotions:
    """Motions of about a pixel at most that make the determinant least, to first order in the gradients.

    The logarithm of a determinant lies below its tangents; each round minimizes the tangent, a quadratic function,
    until nothing moves by more than `at_rest` pixels.
    """
    total = strips.sum(axis=0)
    count = len(total) // (1 + n_motions)
    shifts: Matrix = np.zeros((count, n_motions))
    if not np.trace(total) > 0:
        return SmallMotions(shifts, np.inf)
    for _ in range(_ROUNDS):
        before = shifts
        weights = _weights(total, shifts)
        matrix, right = _normal_equations(total, weights)
        try:
            motions = np.linalg.solve(matrix, right)
        except np.linalg.LinAlgError:
            return SmallMotions(np.zeros((count, n_motions)), np.inf)
        moving = np.asarray(motions, dtype=np.float64).reshape(n_motions, -1).T
        shifts = np.concatenate([np.zeros((1, n_motions)), moving])
        if np.abs(shifts - before).max() < at_rest:
            break
    return SmallMotions(shifts, _standard_error(strips, weights, matrix, shifts))


def _weights(total: Matrix, shifts: Matrix) -> Matrix:
    """Inverse covariance of the photographs moved by their shifts."""
    moved = np.hstack([np.eye(len(shifts)), *(np.diag(motion) for motion in shifts.T)])
    return np.asarray(np.linalg.inv(_floored(moved @ total @ moved.T)), dtype=np.float64)


def _floored(covariance: Matrix) -> Matrix:
    # Photographs without noise leave a determinant of zero.
    floor = max(_FLOOR * float(np.trace(covariance)), 1e-30)
    return np.asarray(covariance + floor * np.eye(len(covariance)), dtype=np.float64)


def _normal_equations(total: Matrix, weights: Matrix) -> tuple[Matrix, Matrix]:
    """Matrix and right side for the motions of all photographs but the first, all downward ones before the others."""
    count = len(weights)
    n_features = len(total) // count
    blocks = total.reshape(n_features, count, n_features, count).transpose(0, 2, 1, 3)
    inner, motions = weights[1:, 1:], range(1, n_features)
    matrix: Matrix = np.block([[inner * blocks[a, b][1:, 1:] for b in motions] for a in motions])
    right = np.concatenate([-(weights * blocks[a, 0]).sum(axis=1)[1:] for a in motions])
    return matrix, right


def _standard_error(strips: Matrix, weights: Matrix, matrix: Matrix, shifts: Matrix) -> float:
    """From the strips' disagreement: natural pictures are not normal and their pixels not independent."""
    flat = shifts[1:].T.ravel()
    scores = []
    for strip in strips:
        own, right = _normal_equations(strip, weights)
        scores.append(right - own @ flat)
    moved = np.linalg.solve(matrix, np.array(scores).T)
    variance = np.square(moved).sum(axis=1) * len(strips) / (len(strips) - 1)
    return float(np.sqrt(variance.max()))


Mask = NDArray[np.bool_]

_FINE, _COARSE = 0.7, 2.0
"""Deviations in pixels of the two Gaussians of which the difference is taken: finer is noise, coarser is light and
shade; by trial."""
_MARGIN_PX = 4
"""Distance from invalid pixels at which a band-passed image is free of them: two deviations of the wider Gaussian."""
_LOOKED_AT_PX = 1024
"""Side of the middle of a frame that is looked at; set by hand, for the time it takes."""
_MOST_STEPS, _LONGEST_STEP, _AT_REST = 10, 2.0, 0.004
"""Of a climb: its most steps, and the longest step and the one that is hardly any more, in pixels (at the corners); by
trial."""
FEWEST_PIXELS = 500
"""Pixels that photographs must have in common; set by hand."""
_BY_CHANCE = 300
"""What the best of all shifts gains on photographs of noise, times the number of pixels; by trial."""
_SURE = 3.0
"""Standard errors that a motion must be larger than to be believed."""
_NEGLIGIBLE_PX = 0.05
"""Below this resampling costs more than it gains; by trial."""


@dataclass(frozen=True)
class Shifts:
    """Where the photographs lie.

    Attributes
    ----------
    pixels : ndarray, shape (k, 2)
        How far down and to the right each photograph's scene lies from where it lies in the first one.
    error : float
        Standard error of one of these numbers, the largest; infinite where nothing could be measured.
    better : bool
        Whether the photographs agree better when moved back by them.
    """

    pixels: Matrix
    error: float
    better: bool

    @property
    def largest(self) -> float:
        """Largest distance between two photographs, in pixels."""
        return largest_distance(self.pixels)

    @property
    def certain(self) -> bool:
        """Whether moving the photographs is better than leaving them."""
        return self.better and self.largest > max(_SURE * self.error, _NEGLIGIBLE_PX)


def measure_shifts(capture: Capture) -> Shifts:
    """Measure the shifts between all photographs, to small fractions of a pixel.

    A start comes from the correlation of all pairs, the rest from the likelihood of all photographs together,
    resampling until nothing moves. Clipped pixels and their neighbours do not count. Of large captures the middle is
    looked at.
    """
    level = _level(*luminance(capture.part(*middle_part(capture.shape, _LOOKED_AT_PX))), block=1)
    start = coarse_shifts(level.bands)
    still = Motions.of_shifts(np.zeros_like(start))
    # Where the start is wrong the photographs may still lie nearly on each other.
    starts = [Motions.of_shifts(start), still] if start.any() else [still]
    climbs = [_climbed(level, first, SHIFTS) for first in starts]
    gains = [_gain(level, still, motions) for motions, _ in climbs]
    best = int(np.argmax(gains))
    motions, error = climbs[best]
    return Shifts(motions.offsets, error, gains[best] > 0)


def coarse_shifts(bands: Images) -> Matrix:
    """Shifts (k, 2) of band-passed photographs to a tenth of a pixel: the peaks of the correlations of all pairs.

    Two photographs hold two layers in differing proportions; as both layers move together the peak stays single.
    Pairs that contradict the others count less (absolute deviations instead of squares).
    """
    from scipy.optimize import least_squares

    count = len(bands)
    pairs = list(combinations(range(count), 2))
    peaks = _correlation_peaks(bands, pairs)
    differences = np.zeros((len(pairs), count))
    for row, (a, b) in enumerate(pairs):
        differences[row, [a, b]] = -1, 1
    shifts = np.zeros((count, 2))
    for axis in (0, 1):
        measured = peaks[:, axis]

        def contradiction(unknown: Matrix, measured: Matrix = measured) -> Matrix:
            return np.asarray(differences[:, 1:] @ unknown - measured)

        shifts[1:, axis] = least_squares(contradiction, measured[: count - 1], loss="soft_l1", f_scale=0.3).x
    return shifts


def _correlation_peaks(bands: Images, pairs: list[tuple[int, int]]) -> Matrix:
    """How far each pair's second photograph lies from its first, (pair, 2)."""
    from skimage.registration import phase_cross_correlation

    height, width = bands.shape[-2:]
    # A frame's edges would correlate where they are.
    faded = bands * np.outer(np.hanning(height), np.hanning(width))
    # Without normalization: whitened phases give noise the weight of the scene (errors of 0.05 instead of 0.02 px).
    correlate: Any = partial(phase_cross_correlation, normalization=None, upsample_factor=10)
    # A photograph without any detail, such as a black one, lies nowhere.
    shows = [bool(band.any()) for band in faded]
    peaks = [correlate(faded[b], faded[a])[0] if shows[a] and shows[b] else np.zeros(2) for a, b in pairs]
    return np.asarray(peaks, dtype=np.float64)


def luminance(capture: Capture) -> tuple[Images, Mask]:
    """Photographs (k, h, w), colours averaged, and their valid pixels."""
    if not capture.color:
        return capture.intensities, capture.valid
    return capture.intensities.mean(axis=1), np.asarray(capture.valid.all(axis=1))


def band_passed(image: Images, valid: Mask) -> Images:
    """Difference of two Gaussian means over valid pixels."""
    from scipy.ndimage import gaussian_filter

    mask = valid.astype(np.float32)
    means = []
    for width in (_FINE, _COARSE):
        weight = np.maximum(gaussian_filter(mask, width), np.float32(1e-3))
        means.append(gaussian_filter(image * mask, width) / weight)
    band: Images = (means[0] - means[1]) * mask
    return band


def far_from_invalid(valid: Mask) -> Mask:
    """Pixels more than a few steps away from invalid ones and from the frame's edge."""
    from scipy.ndimage import binary_erosion

    inner: Mask = binary_erosion(valid, iterations=_MARGIN_PX)
    return inner


def largest_distance(pixels: Matrix) -> float:
    """Largest distance between two of the positions (k, 2)."""
    return float(max(np.hypot(*(a - b)) for a, b in combinations(pixels, 2)))


_SMALLEST_PX = 64
"""Least side of the coarsest photographs; set by hand."""
_BLOCKS = (8, 4, 2)
"""Sides of the blocks of which coarser photographs are made: a turn moves the corners of the first by few pixels."""
_GLANCED_AT = (2, 4)
"""Sides of the blocks in which turns are looked for at first; set by hand, for the time it takes."""


@dataclass(frozen=True)
class Turns:
    """Where the photographs lie, turns and growth included.

    Attributes
    ----------
    motions : Motions
        In pixels from the middle of the frame.
    error : float
        Largest standard error of a shift, and of a turn or growth at the corners of what was looked at, in pixels.
    at_corners : float
        How far turns and growth move the corners against each other, in pixels.
    better : bool
        Whether the photographs agree better than with the best shifts alone.
    """

    motions: Motions
    error: float
    at_corners: float
    better: bool

    @property
    def certain(self) -> bool:
        """Whether turning the photographs back is better than shifting them only."""
        return self.better and self.at_corners > max(_SURE * self.error, _NEGLIGIBLE_PX)


@dataclass(frozen=True)
class _Level:
    """Band-passed photographs (k, h, w) of one size, and which of their pixels count."""

    bands: Images
    inner: Mask

    @property
    def half_diagonal(self) -> float:
        return float(np.hypot(*corners(self.bands.shape)[0]))

    def moved(self, motions: Motions) -> tuple[Images, Mask]:
        """Photographs moved back, and where all of them hold values that count."""
        parts = list(zip(motions.matrices, motions.offsets, strict=True))
        bands = [moved_back(band, *part, order=3) for band, part in zip(self.bands, parts, strict=True)]
        shares = [moved_back(m.astype(np.float32), *part, order=1) for m, part in zip(self.inner, parts, strict=True)]
        return np.stack(bands), np.min(shares, axis=0) > WHOLE


def measure_turns(capture: Capture, shifts: Shifts) -> Turns:
    """Measure shifts, turns and growth of all photographs against the first.

    Parameters
    ----------
    capture : Capture
    shifts : Shifts
        The best shifts alone (`polaropt.capture.registration.measure_shifts`).
    """
    part = _evenly(middle_part(capture.shape, _LOOKED_AT_PX), capture.shape)
    images, valid = luminance(capture.part(*part))
    blocks = _blocks(images.shape)
    levels = [_level(images, valid, block) for block in blocks]
    motions, error = _climbed_up(levels, _started(levels[0], shifts.pixels / blocks[0]))
    better = _gain(levels[-1], Motions.of_shifts(shifts.pixels), motions) > 0
    at_corners = Motions(motions.matrices, np.zeros_like(motions.offsets)).apart_at_corners(images.shape)
    sides = capture.shape[-2:]
    looked_at = np.array([(lines.start + lines.stop - side) / 2 for lines, side in zip(part, sides, strict=True)])
    return Turns(motions.about(-looked_at), error, at_corners, better)


def turns_show(capture: Capture, shifts: Shifts) -> bool:
    """Whether photographs, moved back by the best shifts alone, look turned or scaled, to first order.

    A look at coarser photographs of the middle of large frames, far cheaper than `measure_turns`, which tells.
    """
    images, valid = luminance(capture.part(*_evenly(middle_part(capture.shape, _LOOKED_AT_PX), capture.shape)))
    offsets = shifts.pixels if shifts.certain else np.zeros_like(shifts.pixels)
    for block in _GLANCED_AT:
        level = _level(images, valid, block)
        bands, common = level.moved(Motions.of_shifts(offsets / block))
        if np.count_nonzero(common) < FEWEST_PIXELS:
            continue
        step = fit_small_motions(products(bands, common, SHIFTS_AND_TURNS), n_motions=SHIFTS_AND_TURNS)
        if block * float(np.abs(step.pixels[:, SHIFTS:]).max()) > max(block * _SURE * step.error, _NEGLIGIBLE_PX):
            return True
    return False


def _started(level: _Level, shifts: Matrix) -> Motions:
    """Motions on the coarsest size: the best near no shift, near the best shifts, and where pairs correlate."""
    starts = (np.zeros_like(shifts), shifts, coarse_shifts(level.bands))
    climbs = [_climbed(level, Motions.of_shifts(start), SHIFTS_AND_TURNS)[0] for start in starts]
    return max(climbs, key=lambda motions: _gain(level, Motions.of_shifts(starts[0]), motions))


def _evenly(part: tuple[slice, slice], shape: tuple[int, ...]) -> tuple[slice, slice]:
    """The part, cut so that blocks of every size fill it."""
    ends = [min(rows.stop, side) for rows, side in zip(part, shape[-2:], strict=True)]
    sides = [(end - rows.start) // _BLOCKS[0] * _BLOCKS[0] for rows, end in zip(part, ends, strict=True)]
    return slice(part[0].start, part[0].start + sides[0]), slice(part[1].start, part[1].start + sides[1])


def _blocks(shape: tuple[int, ...]) -> list[int]:
    """Sides of the blocks whose means are looked at, coarsest first."""
    return [size for size in _BLOCKS if min(shape[-2:]) // size >= _SMALLEST_PX] + [1]


def _level(images: Images, valid: Mask, block: int) -> _Level:
    means = block_mean(images.astype(np.float32), block)
    whole = block_mean(valid.astype(np.float32), block) == 1
    bands = np.stack([band_passed(image, mask) for image, mask in zip(means, whole, strict=True)])
    return _Level(bands, np.stack([far_from_invalid(mask) for mask in whole]))


def _climbed_up(levels: list[_Level], motions: Motions) -> tuple[Motions, float]:
    """Motions near a start on the coarsest level, refined up to the finest, in its pixels; and their error."""
    size, error = levels[0].bands.shape[-1], np.inf
    for level in levels:
        finer = level.bands.shape[-1]
        motions, error = _climbed(level, motions.magnified(finer / size), SHIFTS_AND_TURNS)
        size = finer
    return motions, error


def _climbed(level: _Level, start: Motions, n_motions: int) -> tuple[Motions, float]:
    """Motions near a start, free in so many ways, and their error; infinite where too little is left in common."""
    motions, longest = start, np.inf
    for _ in range(_MOST_STEPS):
        moved, common = level.moved(motions)
        if np.count_nonzero(common) < FEWEST_PIXELS:
            return start, np.inf
        step = fit_small_motions(products(moved, common, n_motions), n_motions=n_motions)
        if not np.isfinite(step.error):
            return start, np.inf
        motions = motions.followed_by(np.clip(step.pixels, -_LONGEST_STEP, _LONGEST_STEP), level.half_diagonal)
        longest = float(np.abs(step.pixels).max())
        if longest < _AT_REST:
            return motions, step.error
    # What does not rest is known no better than its last step.
    return motions, max(step.error, longest)


def _gain(level: _Level, others: Motions, motions: Motions) -> float:
    """How much less photographs disagree with motions than with others, on the same pixels; 0 if not surely."""
    (shifted, common), (moved, also) = level.moved(others), level.moved(motions)
    common = common & also
    count = np.count_nonzero(common)
    if count < FEWEST_PIXELS:
        return 0.0
    gain = disagreement(products(shifted, common)) - disagreement(products(moved, common))
    return gain if gain > _BY_CHANCE / count else 0.0
