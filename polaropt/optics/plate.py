"""The pane as three scalar geometric series: how bright each ghost is.

With rho the interface's reflection and tau its transmission entry, and z the shift by one ghost step:
reflected ``rho + tau^2 rho z / (1 - rho^2 z)``, transmitted ``tau^2 / (1 - rho^2 z)`` (paper, Eqs. (3) and (4)).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polaropt.optics.fresnel import interface
from polaropt.optics.scene import SceneParameters

Entries = NDArray[np.float64]

# Ghosts fainter than this share of the light are added to the last one kept.
_NEGLIGIBLE = 1e-12
_MOST_GHOSTS = 2000


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
    rho, tau = (np.array(entries) for entries in interface(incidence_deg, scene.refractive_index))
    if n_ghosts is None:
        n_ghosts = 1 if shift == 0 else ghosts_that_matter(scene)
    return interface_weights(scene, rho, tau, n_ghosts)


def interface_weights(scene: SceneParameters, rho: Entries, tau: Entries, n_ghosts: int) -> Entries:
    """Weights as of `ghost_weights` from an interface's reflection and transmission entries.

    Parameters
    ----------
    scene : SceneParameters
        Its geometry but for the shift is not used.
    rho, tau : ndarray, shape (3, ...)
    n_ghosts : int

    Returns
    -------
    ndarray, shape (2, n_ghosts + 1, 3, ...)
    """
    shift = scene.values()[2]
    if scene.single_surface:
        weights = np.stack([tau, rho])[:, None]
    else:
        weights = _plate_weights(rho, tau, n_ghosts if scene.n_bounces is None else scene.n_bounces)
        if scene.n_bounces is None:
            _add_tail(weights, rho, tau)
        if scene.literal_eq3:
            weights = _first_ghost_unshifted(weights)
        if shift == 0:
            weights = weights.sum(axis=1, keepdims=True)
    # A mirror image is described as an ideal mirror shows it, which flips the reflection's s2' entry.
    weights[1, :, 2] *= -1
    return weights


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


def ghost_line(
    scene: SceneParameters, n_ghosts: int | None = None, interface_entries: tuple[Entries, Entries] | None = None
) -> GhostLine:
    """Ghosts with their places: one image for each order, or for each layer's own where their shifts differ.

    Parameters
    ----------
    scene : SceneParameters
        A complete scene.
    n_ghosts : int, optional
        As for `ghost_weights`.
    interface_entries : (ndarray, ndarray), optional
        Reflection and transmission entries (3, ...) where they are not those of the scene's incidence; with them,
        `n_ghosts` must be given.
    """

    def weights_of(shifted: SceneParameters) -> Entries:
        if interface_entries is None:
            return ghost_weights(shifted, n_ghosts)
        assert n_ghosts is not None
        return interface_weights(shifted, *interface_entries, n_ghosts)

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
    r_p, r_s, _ = interface(incidence_deg, refractive_index).reflection
    if single_surface:
        return r_p, r_s
    return 2 * r_p / (1 + r_p), 2 * r_s / (1 + r_s)


def in_place_correction(incidence_deg: float, refractive_index: float, single_surface: bool) -> float:
    """What is taken off the intensity for each unit of polarized light (s1 in the pane's frame), bounces in place."""
    par, perp = in_place_reflectance(incidence_deg, refractive_index, single_surface)
    return (perp + par) / (perp - par)


def _plate_weights(rho: NDArray[np.float64], tau: NDArray[np.float64], n_ghosts: int) -> NDArray[np.float64]:
    """The two series up to ghost `n_ghosts`, shape (2, n_ghosts + 1, 3)."""
    order = np.arange(n_ghosts + 1).reshape(-1, *(1 for _ in rho.shape))
    transmitted = tau**2 * rho ** (2 * order)
    reflected = np.concatenate([rho[None], tau**2 * rho ** (2 * order[1:] - 1)])
    return np.stack([transmitted, reflected])


def _add_tail(weights: NDArray[np.float64], rho: NDArray[np.float64], tau: NDArray[np.float64]) -> None:
    """Add what all ghosts beyond the last carry to the last."""
    n_ghosts = weights.shape[1] - 1
    # tau^2 / (1 - rho^2), with 1 - rho^2 written in the transmittances so that it does not cancel.
    product, total = tau[0] * tau[1], tau[0] + tau[1]
    beyond = np.array([tau[0] / (2 - tau[0]), tau[1] / (2 - tau[1]), product / (total - product)])
    weights[0, -1] += beyond * rho ** (2 * (n_ghosts + 1))
    weights[1, -1] += beyond * rho ** (2 * n_ghosts + 1)


def _first_ghost_unshifted(weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Move every ghost of the reflection one step back, as Eq. (3) is printed."""
    moved = np.zeros_like(weights)
    moved[0] = weights[0]
    moved[1, 0] = weights[1, 0]
    moved[1, :-1] += weights[1, 1:]
    return moved
