"""The pane's series of bounces, and how bright it makes each ghost.

Light that enters a plate bounces between its faces, and at every bounce a part leaves as one more ghost. With rho a
face's reflection and tau its transmission entry, and z the shift by one ghost step, the images of both layers are

    reflected    ``h_r(z) = rho + tau^2 rho z / (1 - rho^2 z)``
    transmitted  ``h_t(z) = tau^2 / (1 - rho^2 z)``

(source paper, Eqs. (3) and (4)) for each of the three diagonal Mueller entries. Whatever needs the series asks `Plate`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from polaropt.optics.fresnel import interface, interface_images
from polaropt.optics.scene import SceneParameters

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
    """

    rho: Entries
    tau: Entries
    single_surface: bool = False
    n_bounces: int | None = None
    literal: bool = False

    def at(self, z: Any) -> tuple[Any, Any]:
        """``h_t(z)`` and ``h_r(z)``; z a number, or an array that goes with the entries."""
        if self.single_surface:
            return self.tau, self.rho
        if self.n_bounces is not None:
            transmitted, reflected = self.weights(self.n_bounces)
            return _power_series(transmitted, z), _power_series(reflected, z)
        passed = self.tau * self.tau / (1 - self.rho * self.rho * z)
        return passed, self.rho + self.rho * (1 if self.literal else z) * passed

    def in_place(self) -> tuple[Entries, Entries]:
        """``h_t(1)`` and ``h_r(1)``, all images on each other: of intensities ``1 - R'`` and ``R' = 2 R / (1 + R)``."""
        if self.single_surface:
            return self.tau, self.rho
        if self.n_bounces is not None:
            transmitted, reflected = self.weights(self.n_bounces).sum(axis=1)
            return transmitted, reflected
        passed = self._passed()
        return passed, self.rho + self.rho * passed

    def weights(self, n_ghosts: int) -> Entries:
        """Weights of the direct image and of each ghost, (layer, n_ghosts + 1, 2 or 3, ...).

        What ghosts beyond the last carry is added to it, so that energy is kept. A plate with its own number of
        bounces keeps that, and loses their light.
        """
        if self.single_surface:
            return np.stack([self.tau, self.rho])[:, None]
        last = n_ghosts if self.n_bounces is None else self.n_bounces
        order = np.arange(last + 1).reshape(-1, *(1 for _ in self.rho.shape))
        transmitted = self.tau**2 * self.rho ** (2 * order)
        ghosts = self.tau**2 * self.rho ** (2 * order[1:] - 1)
        weights = np.stack([transmitted, np.concatenate([self.rho[None], ghosts])])
        if self.n_bounces is None:
            passed = self._passed()
            weights[0, -1] += passed * self.rho ** (2 * (last + 1))
            weights[1, -1] += passed * self.rho ** (2 * last + 1)
        if self.literal:
            ghosts = weights[1, 1:].copy()
            weights[1, 1:] = 0
            weights[1, :-1] += ghosts
        return weights

    @property
    def series(self) -> tuple[GhostSeries, GhostSeries]:
        """Both layers as closed series: of all bounces, or of none where `n_bounces` is 0; as physics has them."""
        if self.single_surface:
            nothing = 0 * self.rho
            return GhostSeries(self.tau, nothing, nothing), GhostSeries(self.rho, nothing, nothing)
        through, ratio = self.tau * self.tau, self.rho * self.rho
        ghost = through * self.rho * through.dtype.type(self.n_bounces != 0)
        return GhostSeries(through, ghost * self.rho, ratio), GhostSeries(self.rho, ghost, ratio)

    def cleared(self) -> Cleared:
        """Series of the two intensities without denominators, closed as in `series`.

        ``(1 - R^2 z) I = 1/2 [(R + R (1 - 2 R) z) r + (1 - R)^2 t]``: all bounces cost one shifted copy.
        """
        rho, nothing = self.rho[:2], 0 * self.rho[:2]
        if self.single_surface:
            return Cleared((self.tau[:2], nothing), (rho, nothing), nothing)
        through = self.tau[:2] ** 2
        if self.n_bounces == 0:
            return Cleared((through, nothing), (rho, nothing), nothing)
        return Cleared((through, nothing), (rho, rho * (1 - 2 * rho)), rho * rho)

    def _passed(self) -> Entries:
        """``tau^2 / (1 - rho^2)``, with 1 - rho^2 written in the transmittances so that it does not cancel."""
        par, perp, *third = self.tau
        if third:
            third = [par * perp / (par + perp - par * perp)]
        return np.stack([par / (2 - par), perp / (2 - perp), *third])


def _power_series(weights: Entries, z: Any) -> Any:
    return sum(weight * z**k for k, weight in enumerate(weights))


def plate_at(incidence_deg: float, scene: SceneParameters) -> Plate:
    """The plate that a scene's pane is at an incidence, entries (3,)."""
    rho, tau = (np.array(entries) for entries in interface(incidence_deg, scene.refractive_index))
    return Plate(rho, tau, scene.single_surface, scene.n_bounces, scene.literal_eq3)


def plate_images(cosine: Planes, scene: SceneParameters) -> Plate:
    """The same for an array of cosines of the incidence, entries (3, ...)."""
    rho, tau = interface_images(cosine, scene.refractive_index)
    return Plate(rho, tau, scene.single_surface, scene.n_bounces, scene.literal_eq3)


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
class GhostLine:
    """Images that a pane makes of its layers, side by side along the azimuth.

    Attributes
    ----------
    weights : ndarray, shape (2, n, 3, ...)
        [0] transmission, [1] reflection; entries (par, perp, s2').
    orders : ndarray, shape (n,)
        How many steps an image lies from the direct one.
    steps : ndarray, shape (n,)
        Its step in pixels along the azimuth, signed.
    """

    weights: NDArray[np.float64]
    orders: NDArray[np.float64]
    steps: NDArray[np.float64]


def ghost_line(scene: SceneParameters, n_ghosts: int | None = None, plate: Plate | None = None) -> GhostLine:
    """Ghosts with their places: one image for each order, or for each layer's own where their shifts differ.

    Parameters
    ----------
    scene : SceneParameters
        A complete scene.
    n_ghosts : int, optional
        As for `ghost_weights`.
    plate : Plate, optional
        Where its entries (3, ...) are not those of the scene's incidence; with it, `n_ghosts` must be given.
    """

    def weights_of(shifted: SceneParameters) -> Weights:
        if plate is None:
            return ghost_weights(shifted, n_ghosts)
        assert n_ghosts is not None
        return _seen_weights(shifted, plate, n_ghosts)

    shift, own = scene.values()[2], scene.transmission_ghost_shift
    weights = weights_of(scene)
    n = weights.shape[1]
    if own is None or own == shift:
        return GhostLine(weights, np.arange(n, dtype=np.float64), np.full(n, shift))
    of_t = weights_of(scene.replace(ghost_shift=own, transmission_ghost_shift=None))[0]
    # The direct light of both layers is one image; the ghosts of each show nothing of the other.
    both = np.zeros((2, n + len(of_t) - 1, *of_t.shape[1:]))
    both[1, :n] = weights[1]
    both[0, 0], both[0, n:] = of_t[0], of_t[1:]
    orders = np.concatenate([np.arange(n), np.arange(1, len(of_t))]).astype(np.float64)
    return GhostLine(both, orders, np.repeat([shift, own], [n, len(of_t) - 1]))


def ghosts_that_matter(scene: SceneParameters, share: float = _NEGLIGIBLE) -> int:
    """Number of ghosts until the next is fainter than `share` of the first."""
    incidence_deg, _, _ = scene.values()
    return ghosts_until(max(interface(incidence_deg, scene.refractive_index).reflection[:2]), share)


def ghosts_until(strongest: float, share: float = _NEGLIGIBLE) -> int:
    """The same for an interface that reflects no more than `strongest`."""
    if strongest <= 0:
        return 1
    if strongest >= 1:
        return _MOST_GHOSTS
    return min(_MOST_GHOSTS, max(1, math.ceil(math.log(share) / (2 * math.log(strongest)))))


def in_place_reflectance(incidence_deg: float, refractive_index: float, single_surface: bool) -> tuple[float, float]:
    """Parallel and perpendicular reflectance of the whole pane, all bounces summed in place."""
    rho, tau = (np.array(entries) for entries in interface(incidence_deg, refractive_index))
    par, perp, _ = Plate(rho, tau, single_surface).in_place()[1]
    return float(par), float(perp)


def in_place_weights(cosine: Planes, refractive_index: float, single_surface: bool) -> tuple[Planes, Planes]:
    """Diagonal entries (3, ...) of the whole pane for transmitted and reflected light, all bounces in place."""
    transmitted, reflected = Plate(*interface_images(cosine, refractive_index), single_surface).in_place()
    return transmitted, mirror_entries(reflected)


def in_place_correction(incidence_deg: float, refractive_index: float, single_surface: bool) -> float:
    """What is taken off the intensity for each unit of polarized light (s1 in the pane's frame), bounces in place."""
    par, perp = in_place_reflectance(incidence_deg, refractive_index, single_surface)
    return (perp + par) / (perp - par)
