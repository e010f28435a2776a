"""What moves, by the photographs that saw what lies behind it, or else as one of them saw it.

Where something was in the picture for one photograph alone, the others agree on what is there without it: that one is
left out. Where more than one saw something else, none tells how the light is polarized. In the photograph that shows
the pane's reflection least the reflection is taken for what it is around; the rest is transmission. The others are what
the two layers would have given them. A solve that left these pixels out would do worse: priors alone cannot fill tens
of pixels, and what they put there reaches the pixels around.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture, NoiseModel
from polaropt.inversion import Canvas, layers_in_place
from polaropt.numerics import smoothly_filled, strips
from polaropt.optics import SceneParameters, engine_for
from polaropt.solving.problem import component_strips

Images = NDArray[np.float32]
Mask = NDArray[np.bool_]

_LEAST_SHARE = 1e-3
"""Share of a layer in a photograph that is divided by: a pane passes and mirrors more."""
_CORRECTIONS = 2
"""Times that the transmission is corrected for its double images; a third changes nothing."""

# What follows by trial on 24 captures of training photographs in which a disk of 45 px moves on by 55 px from each
# photograph to the next, in either layer, at azimuths of which half make two photographs differ in nearly the same way
# (an engine of its own, noise 0.4 %): 99 of 100 pixels of the moved transmission are left out where they should be, and
# none in another photograph; of the reflection, which some photographs hardly show, 2 of 100 in another one.
_WINDOWS_PX = (9, 3)
"""Sides of windows over which it is judged what photographs agree on; the small one where two things meet."""
_OFF = (2.0, 1.3)
"""Mean square in them of what no layers explain, in units of its noise, from which on something has moved."""
_AGREE, _AS_WELL = 4.0, 1.2
"""The same up to which three photographs agree, and in units of the best how much of it is as good."""
_LEFT_BY_NOISE = 1.3
"""The same that counts as the noise alone, and is no worse than less."""
_SMOOTH_PX = 15
"""Side of windows over which the layers' edges are compared where photographs are as good."""
_LIGHT_SHARE, _STRAY_SHARE, _BESIDE_PX = 0.005, 0.003, 0.1
"""Errors that are no motion: of a pixel's light, of the mean light, and of the place; as `polaropt.estimation.motion`
tolerates at least."""
_RIM_PX, _CORE_PX = 2, 3
"""By which pixels grow, and by which those shrink that more than one photograph saw otherwise before they count as a
thing. Set by hand."""
_SHARE_BESIDE, _AROUND_PX, _EDGES_IN_PAIRS = 0.1, 12, 2.0
"""How much of a region's rim a photograph saw otherwise that did so within, how far around is still, and how much
stronger edges may be where but two photographs tell the layers. Set by hand."""
_LOOKED_AT, _BRIGHTEST, _USUAL = 100_000, 0.999, 0.99
"""Pixels by which it is known how bright layers are, the quantile of these that none exceeds, and that of how far
layers are beyond by noise. Set by hand."""
_LEAST_BEYOND, _TIMES_USUAL = 0.02, 2.0
"""How far layers may be beyond at least, in units of the brightest, and in units of what is usual. Set by hand."""
_LEAST_TOLD = 1e-3
"""Share of a photograph that the others must leave open for it to be judged, and of the reflection in one that the
transmission must leave open for both to be told. Set by hand."""


def inpainted(
    capture: Capture, moving: Mask, scene: SceneParameters, noise: float, growth: NoiseModel | None = None
) -> Capture:
    """Photographs without what moves: where it is in one alone that is not valid, elsewhere all hold what one saw.

    Parameters
    ----------
    capture : Capture
        Of four photographs or more; with three none is left out, as nothing shows which.
    moving : ndarray of bool, shape (h, w)
    scene : SceneParameters
        A complete scene.
    noise : float
        Standard deviation of one photograph's noise (white = 1).
    growth : NoiseModel, optional
        How it grows with the light. Default: it does not.

    Returns
    -------
    Capture
        Where all hold what one saw, or would have seen at the same time, they are valid where that one is.
    """
    height, width = capture.shape[-2:]
    pse = engine_for(scene, capture.angles_deg, noise, (height, width))
    canvas = Canvas(height, width, 0, 0, 0, 0)

    def parts(layers: Images) -> Images:
        return np.concatenate([strip.components for strip in component_strips(pse, canvas, layers)], axis=-2)

    shares = parts(np.ones((2, 1, height, width), np.float32))
    brightest = shares[0] / np.maximum(shares[1], np.float32(_LEAST_SHARE))
    shown = int(np.argmax(brightest[:, 0, moving].mean(axis=-1)))
    odd = np.zeros((len(capture.angles_deg), height, width), bool)
    if len(odd) > 3:
        growth = NoiseModel(noise) if growth is None else growth
        odd, moving = _odd_and_several(capture.planes, shares, moving, growth, shown)
        capture = _left_out(capture, shares, odd)
    if not moving.any():
        return capture
    photographs = capture.planes
    valid = capture.valid.reshape(photographs.shape)
    layers = layers_in_place(photographs, shares[0], shares[1], noise)
    known = (valid | odd[:, None]).all(axis=0) & ~moving
    layers[1] = np.where(moving, np.maximum(smoothly_filled(layers[1], known), 0), layers[1])
    of_shown = np.maximum(shares[0, shown], np.float32(_LEAST_SHARE))
    layers[0] = np.where(moving, (photographs[shown] - shares[1, shown] * layers[1]) / of_shown, layers[0])
    seen = parts(layers).sum(axis=0)
    for _ in range(_CORRECTIONS):
        off = photographs[shown] - seen[shown]
        layers[0] = np.where(moving, np.maximum(layers[0] + off / of_shown, 0), layers[0])
        seen = parts(layers).sum(axis=0)
    return capture.replace(
        intensities=np.where(moving, seen, photographs).reshape(capture.intensities.shape),
        valid=np.where(moving, valid[shown], valid).reshape(capture.valid.shape),
    )


@dataclass(frozen=True)
class _Unexplained:
    """What no two layers explain of photographs, each pixel by itself.

    With polarized light left aside it is none of the pane's double images either: they are polarized along the plane of
    incidence, or across, as the layers are in place.

    Attributes
    ----------
    photographs : ndarray, shape (k, channel, h, w)
    shares : ndarray, shape (2, k, 1, h, w)
        Of transmission and reflection in the photographs, all bounces in place.
    """

    photographs: Images
    shares: Images

    @cached_property
    def _axes(self) -> tuple[Images, Images]:
        """Orthonormal ones of what the layers explain."""
        first, second = self.shares
        first = first / np.sqrt((first * first).sum(axis=0))
        second = second - (first * second).sum(axis=0) * first
        # Seen frontally both layers are in the same shares.
        return first, second / np.maximum(np.sqrt((second * second).sum(axis=0)), np.finfo(np.float32).tiny)

    @cached_property
    def residuals(self) -> Images:
        first, second = self._axes
        seen = self.photographs
        return np.asarray(seen - first * (first * seen).sum(axis=0) - second * (second * seen).sum(axis=0))

    @cached_property
    def open_shares(self) -> Images:
        """How much of each photograph the others leave open, (k, 1, h, w), 0..1."""
        first, second = self._axes
        return np.asarray(np.maximum(1 - first**2 - second**2, np.float32(_LEAST_TOLD)))

    @property
    def beyond_others(self) -> Images:
        """What each photograph saw beyond what the others make expect of it."""
        return np.asarray(self.residuals / self.open_shares)

    def layers(self) -> tuple[Images, Images]:
        """Layers (2, channel, h, w) that explain the photographs best, and by how much each photograph moves them.

        The latter are (2, k, 1, h, w).
        """
        t, r = self.shares
        tt, tr, rr = (t * t).sum(axis=0), (t * r).sum(axis=0), (r * r).sum(axis=0)
        # Photographs that hold both in the same shares tell neither.
        determinant = np.maximum(tt * rr - tr * tr, np.float32(_LEAST_TOLD**2) * tt * rr)
        moves = np.stack([rr * t - tr * r, tt * r - tr * t]) / determinant
        return np.asarray((moves * self.photographs).sum(axis=1)), moves


def _odd_and_several(
    photographs: Images, shares: Images, moving: Mask, growth: NoiseModel, shown: int
) -> tuple[Mask, Mask]:
    """Where a photograph saw something else than the others (k, h, w), and where these do not tell, (h, w).

    A thing that is partly in several photographs at once is seen as the one that is shown saw it.
    """
    from scipy.ndimage import binary_opening, label

    k, height = len(photographs), photographs.shape[-2]
    odd, several = np.zeros((k, *moving.shape), bool), np.zeros(moving.shape, bool)
    margin, stray = _SMOOTH_PX + max(_WINDOWS_PX), _STRAY_SHARE * float(photographs.mean())
    possible = _Possible.of(photographs, shares, ~moving)
    for rows in strips(height, photographs.size // height):
        if not moving[rows].any():
            continue
        around = slice(max(0, rows.start - margin), min(height, rows.stop + margin))
        inner = slice(rows.start - around.start, rows.stop - around.start)
        unexplained = _Unexplained(photographs[..., around, :], shares[..., around, :])
        off, agree, which = (part[inner] for part in _judged(unexplained, growth, stray, possible))
        off &= moving[rows]
        several[rows] = off & ~agree
        odd[:, rows] = (off & agree) & (which == np.arange(k)[:, None, None])
    # Single pixels are told by chance.
    odd = np.stack([_grown(binary_opening(photograph, _diamond(1)), _RIM_PX) for photograph in odd])
    odd, several = _with_pairs(photographs, shares, odd, several, possible)
    things, _ = label(odd.any(axis=0) | several)
    core = binary_opening(several, _diamond(_CORE_PX))
    several |= odd[shown] & np.isin(things, np.unique(things[core]))
    several = _grown(several, _RIM_PX) & moving
    return odd & (moving & ~several), several


def _with_pairs(
    photographs: Images, shares: Images, odd: Mask, several: Mask, possible: _Possible
) -> tuple[Mask, Mask]:
    """Both of two photographs left out, (k, h, w), where only they saw something else; the rest of several, (h, w).

    What is thin beside one photograph's thing is its rim. Two are left out where a thing as one saw it meets the same
    as another one did: the other two tell both layers, whose edges are then no stronger than around.
    """
    from scipy.ndimage import binary_opening, find_objects, label

    core = _diamond(_CORE_PX)
    regions, _ = label(several)
    odd, left, things = odd.copy(), np.zeros_like(several), odd.any(axis=0) | several
    for i, box in enumerate(find_objects(regions), 1):
        down, across = (slice(max(0, side.start - _AROUND_PX), side.stop + _AROUND_PX) for side in box)
        region = regions[down, across] == i
        beside = odd[:, down, across][:, _grown(region, _CORE_PX) & ~region].mean(axis=1) > _SHARE_BESIDE
        n = np.count_nonzero(beside)
        if n == 1 and not binary_opening(region, core).any():
            odd[beside, down, across] |= region
            continue
        if n == 2:
            others = _Unexplained(photographs[~beside][..., down, across], shares[:, ~beside][..., down, across])
            layers, still = others.layers()[0], ~_grown(things[down, across], _RIM_PX)
            edges, beyond = _edges(layers), possible.beyond(layers)
            natural = still.any() and edges[region].mean() < _EDGES_IN_PAIRS * edges[still].mean()
            if natural and beyond[region].mean() <= max(possible.allowed, _TIMES_USUAL * float(beyond[still].mean())):
                odd[beside, down, across] |= _grown(region, _RIM_PX)
                continue
        left[down, across] |= region
    return odd, left


def _grown(pixels: Mask, radius_px: int) -> Mask:
    from scipy.ndimage import binary_dilation

    return np.asarray(binary_dilation(pixels, _diamond(radius_px))) if pixels.any() else pixels


def _diamond(radius_px: int) -> Mask:
    """Pixels no farther from the middle than that, along rows and columns together."""
    from scipy.ndimage import generate_binary_structure, iterate_structure

    return np.asarray(iterate_structure(generate_binary_structure(2, 1), radius_px))


@dataclass(frozen=True)
class _Possible:
    """What layers can be: neither below no light, nor brighter than what stands still, but for noise.

    Attributes
    ----------
    brightest : ndarray, shape (2, 1, 1, 1)
        Of each layer.
    allowed : float
        How far they may be beyond in the mean of a window, in units of these.
    """

    brightest: Images
    allowed: float

    @classmethod
    def of(cls, photographs: Images, shares: Images, still: Mask) -> _Possible:
        """As those that stand still are, of which a few rows and columns are looked at."""
        step = max(1, math.isqrt(still.size // _LOOKED_AT))
        layers = _Unexplained(photographs[..., ::step, ::step], shares[..., ::step, ::step]).layers()[0]
        still = still[::step, ::step]
        brightest = np.quantile(layers[..., still], _BRIGHTEST, axis=(1, 2)).astype(np.float32)
        possible = cls(np.maximum(brightest, np.float32(_LEAST_SHARE)).reshape(2, 1, 1, 1), 0.0)
        usual = np.quantile(_around(possible.beyond(layers), _WINDOWS_PX[0])[still], _USUAL)
        return replace(possible, allowed=max(_LEAST_BEYOND, _TIMES_USUAL * float(usual)))

    def beyond(self, layers: Images) -> Images:
        """How far layers (2, channel, h, w) are beyond it, (h, w)."""
        relative = layers / self.brightest
        return np.asarray((np.maximum(-relative, 0) + np.maximum(relative - 1, 0)).mean(axis=1).sum(axis=0))


def _judged(
    unexplained: _Unexplained, growth: NoiseModel, stray: float, possible: _Possible
) -> tuple[Mask, Mask, NDArray[np.intp]]:
    """Where something moved, where all but one photograph agree, and which one that is, (h, w) each.

    Two photographs that differ in nearly the same way by what moves agree with the others when both saw it, too, on
    layers that are none.
    """
    photographs, residuals, open_shares = unexplained.photographs, unexplained.residuals, unexplained.open_shares
    variance = _tolerated(photographs.mean(axis=0), growth, stray)
    total = (residuals**2).sum(axis=0)
    k = len(photographs)
    left = np.stack(
        [
            np.mean((total - each**2 / share) / variance, axis=0) / (k - 3)
            for each, share in zip(residuals, open_shares, strict=True)
        ]
    )
    misfit = np.mean(total / variance, axis=0) / (k - 2)
    off = np.logical_and.reduce([_around(misfit, side) > least for side, least in zip(_WINDOWS_PX, _OFF, strict=True)])
    edges, beyond = _edges_without(unexplained, possible)
    agree, which = np.zeros(off.shape, bool), np.zeros(off.shape, np.intp)
    for side in _WINDOWS_PX:
        here = _around(left, side)
        as_good = here <= np.maximum(_LEFT_BY_NOISE, _AS_WELL * here.min(axis=0))
        best = np.where(as_good, edges, np.inf).argmin(axis=0)
        which = np.where(agree, which, best)
        told, impossible = (np.take_along_axis(images, best[None], axis=0)[0] for images in (here, beyond))
        agree |= (told <= _AGREE) & (impossible <= possible.allowed)
    return off, agree, which


def _tolerated(light: Images, growth: NoiseModel, stray: float) -> Images:
    """Variance of noise, and of errors that are no motion, at pixels (channel, h, w) of this light."""
    down, across = np.gradient(light, axis=(-2, -1))
    of_light = np.square(np.float32(_LIGHT_SHARE) * light) + np.float32(stray**2)
    return np.asarray(growth.variance(light) + of_light + np.float32(_BESIDE_PX**2) * (down**2 + across**2))


def _edges_without(unexplained: _Unexplained, possible: _Possible) -> tuple[Images, Images]:
    """Edges of both layers without each photograph, and how far these are beyond what is possible, in windows.

    Both are (k, h, w). Without a photograph that saw nothing else the thing stays in the layers, brighter or darker
    than it can be.
    """
    (transmission, reflection), moves = unexplained.layers()
    edges, beyond = [], []
    for more, of_transmission, of_reflection in zip(unexplained.beyond_others, *moves, strict=True):
        layers = np.stack([transmission - of_transmission * more, reflection - of_reflection * more])
        edges.append(_edges(layers))
        beyond.append(possible.beyond(layers))
    return _around(np.stack(edges), _SMOOTH_PX), _around(np.stack(beyond), _WINDOWS_PX[0])


def _edges(layers: Images) -> Images:
    """Edges of both layers (2, channel, h, w), and how far these are below no light, (h, w)."""
    across = np.abs(np.diff(layers, axis=-1, append=layers[..., -1:]))
    down = np.abs(np.diff(layers, axis=-2, append=layers[..., -1:, :]))
    return np.asarray((across + down + np.maximum(-layers, 0)).sum(axis=(0, 1)))


def _around(images: Images, side: int) -> Images:
    """Means over windows of images (..., h, w)."""
    from scipy.ndimage import uniform_filter

    return np.asarray(uniform_filter(images, (0,) * (images.ndim - 2) + (side, side), mode="nearest"))


def _left_out(capture: Capture, shares: Images, odd: Mask) -> Capture:
    """Photographs that are not valid where they are odd, and hold there what the others make expect of them."""
    if not odd.any():
        return capture
    intensities = capture.planes.copy()
    height = intensities.shape[-2]
    for rows in strips(height, intensities.size // height):
        here = odd[:, None, rows]
        if here.any():
            part = intensities[..., rows, :]
            part -= np.where(here, _Unexplained(part, shares[..., rows, :]).beyond_others, np.float32(0))
    valid = capture.valid.reshape(intensities.shape) & ~odd[:, None]
    return capture.replace(
        intensities=intensities.reshape(capture.intensities.shape), valid=valid.reshape(capture.valid.shape)
    )
