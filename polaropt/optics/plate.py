"""The pane's series of bounces, and how bright it makes each ghost.

Light that enters a plate bounces between its faces, and at every bounce a part leaves as one more ghost. With rho a
face's reflection and tau its transmission entry, and z the shift by one ghost step, the images of both layers are

    reflected    ``h_r(z) = rho + tau^2 rho z / (1 - rho^2 z)``
    transmitted  ``h_t(z) = tau^2 / (1 - rho^2 z)``

(source paper, Eqs. (3) and (4)) for each of the three diagonal Mueller entries. Whatever needs the series asks `Plate`.
Of tinted glass a passage there and back leaves a share, which goes with z. Faces of several panes are joined in
`polaropt.optics.stack`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from polaropt.optics.fresnel import interface, interface_images
from polaropt.optics.scene import SceneParameters
from polaropt.optics.stack import FACES_OF_A_PANE, before_in_place, faces, image_weights, passages

Entries = NDArray[Any]
Weights = NDArray[np.float64]
Planes = NDArray[np.float64]

# Ghosts fainter than this share of the direct light are added to the last one kept, and those beyond so many, where
# towards grazing incidence each is hardly fainter than the one before. Set by hand, far below what float32 tells apart.
_NEGLIGIBLE = 1e-12
_MOST_GHOSTS = 2000


class GhostSeries(NamedTuple):
    """Images of one layer, ``h(z) = direct + ghost z + ghost ratio z^2 + ghost ratio^2 z^3 + ...``."""

    direct: Any
    """Weight of the direct image."""
    ghost: Any
    """Of the first ghost."""
    ratio: Any
    """Of each ghost to the one before."""

    @property
    def in_place(self) -> Any:
        """h(1): all images on each other."""
        return self.direct + self.ghost / (1 - self.ratio)


class GhostSum(NamedTuple):
    """``z / (1 - ratio z)``, all ghosts of a series in units of the first, in real arithmetic."""

    real: Any
    imag: Any
    squared: Any
    """Squared modulus."""


def ghost_sum(ratio: Any, cosine: Any, sine: Any) -> GhostSum:
    """All ghosts where one step turns a frequency's phase: z = cosine - i sine."""
    squared = 1 / (1 + ratio * (ratio - 2 * cosine))
    return GhostSum((cosine - ratio) * squared, -sine * squared, squared)


class Cleared(NamedTuple):
    """Both series times ``1 - ratio z``: ``c_0 + c_1 z`` each."""

    transmission: tuple[Entries, Entries]
    reflection: tuple[Entries, Entries]
    ratio: Entries


@dataclass(frozen=True, eq=False)
class Plate:
    """A pane of two faces, or a single surface, as the series of bounces of its entries.

    Plain arithmetic: entries of one incidence, or of every pixel's own. Of two layers the first is the transmission,
    the second the reflection as the pane turns it back (see `mirror_entries`).

    Attributes
    ----------
    rho, tau : ndarray, shape (2 or 3, ...)
        Reflection and transmission of one face: par, perp and perhaps s2'.
    single_surface : bool
        There is no back face: one image, no bounces.
    n_bounces : int or None
        The direct images and ghosts 1..n_bounces. None: all.
    literal : bool
        Eq. (3) as printed, which puts the first ghost of the reflection at shift 0, instead of physics.
    n_panes : int
        More than one: only `at` and `in_place` know them, and `image_weights`.
    passed_twice : float
        Share of the light that a pane's glass leaves there and back. The transmission is what is seen through it once.
    """

    rho: Entries
    tau: Entries
    single_surface: bool = False
    n_bounces: int | None = None
    literal: bool = False
    n_panes: int = 1
    passed_twice: float = 1.0

    @property
    def n_faces(self) -> int:
        """As `SceneParameters.n_faces`."""
        return 1 if self.single_surface else FACES_OF_A_PANE * self.n_panes

    def at(self, z: Any, gap: Any = 1.0) -> tuple[Any, Any]:
        """``h_t(z)`` and ``h_r(z)``; z a number, or an array that goes with the entries, and the same from gaps."""
        if self.n_bounces is not None and not self.single_surface:
            transmitted, reflected = self.weights(self.n_bounces)
            return _power_series(transmitted, z), _power_series(reflected, z)
        steps = passages(self.n_faces, z if self.passed_twice == 1 else self.passed_twice * z, gap)
        passed, mirrored = faces(self.rho, self.tau, steps)
        if self.literal and not self.single_surface:
            mirrored = self.rho + self.passed_twice * self.rho * passed
        return passed, mirrored

    def in_place(self) -> tuple[Entries, Entries]:
        """``h_t(1)`` and ``h_r(1)``, all images on each other: of intensities ``1 - R'`` and ``R' = 2 R / (1 + R)``."""
        if self.n_bounces is not None and not self.single_surface:
            transmitted, reflected = self.weights(self.n_bounces).sum(axis=1)
            return transmitted, reflected
        steps = passages(self.n_faces, self.passed_twice, 1.0)
        passed, mirrored = faces(self.rho, self.tau, steps, before_in_place)
        return passed, mirrored

    def weights(self, n_ghosts: int) -> Entries:
        """Weights of the direct image and of each ghost, (layer, n_ghosts + 1, 2 or 3, ...).

        What ghosts beyond the last carry is added to it, so that energy is kept. A plate with its own number of
        bounces keeps that, and loses their light.
        """
        if self.single_surface:
            return np.stack([self.tau, self.rho])[:, None]
        last = n_ghosts if self.n_bounces is None else self.n_bounces
        order = np.arange(last + 1).reshape(-1, *(1 for _ in self.rho.shape))
        left = self.passed_twice**order
        transmitted = self.tau**2 * self.rho ** (2 * order) * left
        ghosts = self.tau**2 * self.rho ** (2 * order[1:] - 1) * left[1:]
        weights = np.stack([transmitted, np.concatenate([self.rho[None], ghosts])])
        if self.n_bounces is None:
            passed, rest = self.in_place()[0], self.passed_twice ** (last + 1)
            weights[0, -1] += passed * self.rho ** (2 * (last + 1)) * rest
            weights[1, -1] += passed * self.rho ** (2 * last + 1) * rest
        if self.literal:
            ghosts = weights[1, 1:].copy()
            weights[1, 1:] = 0
            weights[1, :-1] += ghosts
        return weights

    @property
    def series(self) -> tuple[GhostSeries, GhostSeries]:
        """Both layers as closed series: of all bounces, or of none where `n_bounces` is 0; as physics has them.

        Those of several panes are no such line: all their images lie in place.
        """
        if self.single_surface:
            nothing = 0 * self.rho
            return GhostSeries(self.tau, nothing, nothing), GhostSeries(self.rho, nothing, nothing)
        if self.n_panes > 1:
            nothing, (passed, mirrored) = 0 * self.rho, self.in_place()
            return GhostSeries(passed, nothing, nothing), GhostSeries(mirrored, nothing, nothing)
        left = self.tau.dtype.type(self.passed_twice)
        through, ratio = self.tau * self.tau, self.rho * self.rho * left
        ghost = through * self.rho * left * through.dtype.type(self.n_bounces != 0)
        return GhostSeries(through, ghost * self.rho, ratio), GhostSeries(self.rho, ghost, ratio)

    def cleared(self) -> Cleared:
        """Series of the two intensities without denominators, closed as in `series`.

        ``(1 - R^2 z) I = 1/2 [(R + R (1 - 2 R) z) r + (1 - R)^2 t]``: all bounces cost one shifted copy.
        """
        rho, nothing = self.rho[:2], 0 * self.rho[:2]
        if self.single_surface:
            return Cleared((self.tau[:2], nothing), (rho, nothing), nothing)
        if self.n_panes > 1:
            passed, mirrored = self.in_place()
            return Cleared((passed[:2], nothing), (mirrored[:2], nothing), nothing)
        through = self.tau[:2] ** 2
        if self.n_bounces == 0:
            return Cleared((through, nothing), (rho, nothing), nothing)
        left = self.passed_twice
        return Cleared((through, nothing), (rho, rho * (1 - 2 * rho) * left), rho * rho * left)


def _power_series(weights: Entries, z: Any) -> Any:
    return sum(weight * z**k for k, weight in enumerate(weights))


def plate_at(incidence_deg: float, scene: SceneParameters) -> Plate:
    """The plate that a scene's pane is at an incidence, entries (3,)."""
    rho, tau = (np.array(entries) for entries in interface(incidence_deg, scene.index))
    return plate_of(rho, tau, scene)


def plate_images(cosine: Planes, scene: SceneParameters) -> Plate:
    """The same for an array of cosines of the incidence, entries (3, ...)."""
    return plate_of(*interface_images(cosine, scene.index), scene)


def plate_of(rho: Entries, tau: Entries, scene: SceneParameters) -> Plate:
    """The plate of a scene's pane, whose faces have these entries."""
    kind = (scene.single_surface, scene.n_bounces, scene.literal_eq3, scene.n_panes or 1)
    return Plate(rho, tau, *kind, math.exp(-2 * (scene.absorption or 0.0)))


def mirror_entries(reflected: Entries) -> Entries:
    """Reflected entries (3, ...) for a scene that is described as an ideal mirror shows it: ``-h_r`` for s2'."""
    return np.concatenate([reflected[:2], -reflected[2:]])


def ghost_weights(scene: SceneParameters, n_ghosts: int | None = None) -> NDArray[np.float64]:
    """Weights of the direct light and of each ghost, for both layers and the three diagonal entries.

    Parameters
    ----------
    scene : SceneParameters
        A complete scene.
    n_ghosts : int, optional
        Ghosts to keep where the scene asks for all of them; the rest is added to the last, so that energy is kept.
        Default: as many as carry light. A scene with its own number of bounces keeps that.

    Returns
    -------
    ndarray, shape (2, n_ghosts + 1, 3)
        [0] transmission, [1] reflection; entries (par, perp, s2').
    """
    incidence_deg, _, shift = scene.values()
    if n_ghosts is None:
        n_ghosts = 1 if shift == 0 else ghosts_that_matter(scene)
    return _seen_weights(scene, plate_at(incidence_deg, scene), n_ghosts)


def _seen_weights(scene: SceneParameters, plate: Plate, n_ghosts: int) -> Weights:
    """Weights as of `ghost_weights` of a plate, in one image where the scene has no shift."""
    weights = plate.weights(n_ghosts)
    if scene.values()[2] == 0:
        weights = weights.sum(axis=1, keepdims=True)
    return np.stack([weights[0], mirror_entries(weights[1].swapaxes(0, 1)).swapaxes(0, 1)])


@dataclass(frozen=True)
class DoubleImages:
    """Images that a pane makes of its layers, side by side.

    Attributes
    ----------
    weights : ndarray, shape (2, n, 3, ...)
        [0] transmission, [1] reflection; entries (par, perp, s2').
    orders : ndarray, shape (n,)
        Which ghost of its layer an image is, 0 the direct one.
    places : tuple of n times (float, float)
        Columns to the right and rows down from the direct image.
    """

    weights: NDArray[np.float64]
    orders: NDArray[np.float64]
    places: tuple[tuple[float, float], ...]


def double_images(scene: SceneParameters, n_ghosts: int | None = None, cosine: Planes | None = None) -> DoubleImages:
    """Images with their places: one for each order, or for each layer's own where their shifts differ.

    Parameters
    ----------
    scene : SceneParameters
        A complete scene.
    n_ghosts : int, optional
        As for `ghost_weights`; of a window of several panes, so many as are brightest beside the direct image.
    cosine : ndarray, optional
        Of the incidence, where that is not the scene's; with it, `n_ghosts` must be given.
    """
    if scene.stacked:
        return _images_of_panes(scene, n_ghosts, cosine)
    plate = None if cosine is None else plate_images(cosine, scene)

    def weights_of(shifted: SceneParameters) -> Weights:
        if plate is None:
            return ghost_weights(shifted, n_ghosts)
        assert n_ghosts is not None
        return _seen_weights(shifted, plate, n_ghosts)

    _, azimuth, shift = scene.values()
    own = scene.transmission_ghost_shift
    weights = weights_of(scene)
    n = weights.shape[1]
    if own is None or own == shift:
        orders = np.arange(n, dtype=np.float64)
        return DoubleImages(weights, orders, _along(orders, np.full(n, shift), azimuth))
    of_t = weights_of(scene.replace(ghost_shift=own, transmission_ghost_shift=None))[0]
    # The direct light of both layers is one image; the ghosts of each show nothing of the other.
    both = np.zeros((2, n + len(of_t) - 1, *of_t.shape[1:]))
    both[1, :n] = weights[1]
    both[0, 0], both[0, n:] = of_t[0], of_t[1:]
    orders = np.concatenate([np.arange(n), np.arange(1, len(of_t))]).astype(np.float64)
    return DoubleImages(both, orders, _along(orders, np.repeat([shift, own], [n, len(of_t) - 1]), azimuth))


def _along(orders: Any, steps: Any, azimuth_deg: float) -> tuple[tuple[float, float], ...]:
    """Columns to the right and rows down to each image of a line in a direction."""
    azimuth = math.radians(azimuth_deg)
    across, down = steps * math.cos(azimuth), -steps * math.sin(azimuth)
    return tuple(zip((orders * across).tolist(), (orders * down).tolist(), strict=True))


# Entries of a table over the cosine of the incidence, between which images' weights are interpolated: 4e-6 off at most.
_INCIDENCES = 65
# Least range of the table in cosines, where all are alike.
_LEAST_RANGE = 1e-6
# Images of a window fainter than this are added to their neighbours where the number to keep is open. Set by hand.
_FAINT_IMAGE = 1e-8
_MOST_IMAGES = 600
# Places whose distances to all that are kept are taken together: they fit into a cache. Set by hand.
_PLACES_AT_ONCE = 64


def _images_of_panes(scene: SceneParameters, n_ghosts: int | None, cosine: Planes | None) -> DoubleImages:
    """Images of a window of several panes, the brightest; the light of the others is added to their neighbours."""
    if not scene.has_ghosts:
        plate = plate_at(scene.values()[0], scene) if cosine is None else plate_images(cosine, scene)
        passed, mirrored = plate.in_place()
        return DoubleImages(np.stack([passed, mirror_entries(mirrored)])[:, None], np.zeros(1), ((0.0, 0.0),))
    table = window_orders(scene, scene.values()[0])
    places, index = _distinct_places(scene, table.shape[1:3])
    together = _merged(table, index, len(places))
    keep = _brightest(together, _count(together, _FAINT_IMAGE) if n_ghosts is None else n_ghosts + 1)
    kept = [places[k] for k in keep]
    to_kept = _nearest(np.array(places), keep)[index]
    if cosine is None:
        weights = _merged(table, to_kept, len(kept))
    else:
        steepest, frontal = float(cosine.min()), float(cosine.max())
        grid = np.linspace(steepest, max(frontal, steepest + _LEAST_RANGE), _INCIDENCES)
        rows = []
        for value in grid:
            entries = window_orders(scene, math.degrees(math.acos(min(1.0, float(value)))), table.shape[1])
            rows.append(_merged(entries, to_kept, len(kept)))
        weights = _interpolated(np.stack(rows, axis=-1), cosine, grid)
    return DoubleImages(weights, np.arange(len(kept), dtype=np.float64), tuple(kept))


def _nearest(places: Planes, keep: NDArray[np.intp]) -> NDArray[np.intp]:
    """Which of the places (n, 2) that are kept each of them is nearest to."""
    nearest = np.empty(len(places), np.intp)
    right, down = places[keep].T
    for first in range(0, len(places), _PLACES_AT_ONCE):
        part = slice(first, first + _PLACES_AT_ONCE)
        across, along = places[part, 0, None] - right, places[part, 1, None] - down
        nearest[part] = (across * across + along * along).argmin(axis=1)
    return nearest


def window_orders(scene: SceneParameters, incidence_deg: float, side: int | None = None) -> Weights:
    """Weights (2, i, j, 3) of the images i shifts of a pane and j of a gap away, as the pane turns them back."""
    plate = plate_at(incidence_deg, scene)
    weights = image_weights(plate.rho, plate.tau, plate.n_faces, plate.passed_twice, side)
    weights[1, ..., 2] *= -1
    return weights


def orders_of_windows(
    incidences_deg: NDArray[np.float64],
    absorptions: NDArray[np.float64],
    n_panes: int,
    refractive_index: float,
    side: int,
) -> Weights:
    """Weights as of `window_orders` of many windows of as many panes, polarized along and across the azimuth.

    Parameters
    ----------
    incidences_deg, absorptions : ndarray, shape (window,)
    n_panes : int
    refractive_index : float
    side : int
        Orders of either kind.

    Returns
    -------
    ndarray, shape (2, i, j, 2, window)
    """
    entries = interface_images(np.cos(np.radians(incidences_deg)), refractive_index)
    rho, tau = (part[:2].ravel() for part in entries)
    weights = image_weights(rho, tau, FACES_OF_A_PANE * n_panes, np.tile(np.exp(-2 * absorptions), 2), side)
    return weights.reshape(*weights.shape[:3], 2, -1)


def _distinct_places(
    scene: SceneParameters, shape: tuple[int, ...]
) -> tuple[list[tuple[float, float]], NDArray[np.intp]]:
    """Where images lie, the direct one first, and which of them each order (2, i, j) of each layer is."""
    _, azimuth, shift = scene.values()
    own = shift if scene.transmission_ghost_shift is None else scene.transmission_ghost_shift
    gap_azimuth = azimuth if scene.gap_azimuth_deg is None else scene.gap_azimuth_deg
    index = np.empty((2, *shape), np.intp)
    found: dict[tuple[float, float], int] = {}
    (gap,) = _along(np.ones(1), np.array([scene.gap_shift or 0.0]), gap_azimuth)
    for layer, length in ((1, shift), (0, own)):
        (step,) = _along(np.ones(1), np.array([length]), azimuth)
        for i, j in np.ndindex(*shape):
            place = (i * step[0] + j * gap[0], i * step[1] + j * gap[1])
            index[layer, i, j] = found.setdefault(place, len(found))
    return list(found), index


def _merged(table: Weights, index: NDArray[np.intp], n: int) -> Weights:
    """Weights (2, i, j, 3) added up by the image that each belongs to, (2, n, 3)."""
    merged = np.empty((2, n, 3))
    for layer, entry in np.ndindex(2, 3):
        merged[layer, :, entry] = np.bincount(index[layer].ravel(), table[layer, ..., entry].ravel(), n)
    return merged


def _brightness(weights: Weights) -> Weights:
    return np.asarray(np.abs(weights).max(axis=(0, 2)))


def _count(weights: Weights, share: float) -> int:
    """Images that carry more than a share of the light."""
    return max(1, min(_MOST_IMAGES, int(np.count_nonzero(_brightness(weights) > share))))


def _brightest(weights: Weights, n: int) -> NDArray[np.intp]:
    """The direct image and the brightest others, in their order."""
    rest = 1 + np.argsort(-_brightness(weights)[1:], kind="stable")[: n - 1]
    return np.concatenate([np.zeros(1, np.intp), np.sort(rest)])


def _interpolated(table: Weights, cosine: Planes, grid: Planes) -> Weights:
    """Weights (2, n, 3, ...) at cosines, linearly between those of a table (2, n, 3, grid)."""
    position = (cosine - grid[0]) / (grid[1] - grid[0])
    lower = np.clip(position.astype(np.intp), 0, len(grid) - 2)
    fraction = position - lower
    return np.asarray(table[..., lower] * (1 - fraction) + table[..., lower + 1] * fraction)


def images_that_show(scene: SceneParameters, share: float) -> int:
    """Images of a window of several panes, beside the direct one, that carry more than a share of the light."""
    table = window_orders(scene, scene.values()[0])
    places, index = _distinct_places(scene, table.shape[1:3])
    return _count(_merged(table, index, len(places)), share) - 1


def ghosts_that_matter(scene: SceneParameters, share: float = _NEGLIGIBLE) -> int:
    """Number of ghosts until the next is fainter than `share` of the first."""
    incidence_deg, _, _ = scene.values()
    return ghosts_until(max(interface(incidence_deg, scene.index).reflection[:2]), share)


def ghosts_until(strongest: float, share: float = _NEGLIGIBLE) -> int:
    """The same for an interface that reflects no more than `strongest`."""
    if strongest <= 0:
        return 1
    if strongest >= 1:
        return _MOST_GHOSTS
    return min(_MOST_GHOSTS, max(1, math.ceil(math.log(share) / (2 * math.log(strongest)))))


def in_place_reflectance(
    incidence_deg: float, refractive_index: float, single_surface: bool, n_panes: int = 1, absorption: float = 0.0
) -> tuple[float, float]:
    """Parallel and perpendicular reflectance of the whole window, all bounces summed in place."""
    rho, tau = (np.array(entries) for entries in interface(incidence_deg, refractive_index))
    plate = Plate(rho, tau, single_surface, n_panes=n_panes, passed_twice=math.exp(-2 * absorption))
    par, perp, _ = plate.in_place()[1]
    return float(par), float(perp)


def in_place_weights(
    cosine: Planes, refractive_index: float, single_surface: bool, n_panes: int = 1, absorption: float = 0.0
) -> tuple[Planes, Planes]:
    """Diagonal entries (3, ...) of the whole window for transmitted and reflected light, all bounces in place."""
    entries = interface_images(cosine, refractive_index)
    plate = Plate(*entries, single_surface, n_panes=n_panes, passed_twice=math.exp(-2 * absorption))
    transmitted, reflected = plate.in_place()
    return transmitted, mirror_entries(reflected)


def in_place_correction(
    incidence_deg: float, refractive_index: float, single_surface: bool, n_panes: int = 1, absorption: float = 0.0
) -> float:
    """What is taken off the intensity for each unit of polarized light (s1 in the pane's frame), bounces in place."""
    par, perp = in_place_reflectance(incidence_deg, refractive_index, single_surface, n_panes, absorption)
    return (perp + par) / (perp - par)
