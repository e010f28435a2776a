"""Kong, Tai, Shin: incidence and plane of incidence as smooth maps, found from coarse to fine, then both layers.

"A physically-based approach to reflection separation: from physical modeling to constrained optimization", IEEE TPAMI
36 (2014). Written anew from the abstract and from others' accounts of its equations: a pane with two faces and bounces
in place, the images along and across the plane of incidence from photographs at 45 degrees to each other (Eqs. (15) to
(17), the plane within 45 degrees of a known direction), layers at each trial incidence (Eqs. (18), (19)), mutual
information of patches over their mean entropy as the cost of an incidence, 0.5 per degree between neighbours, belief
propagation (Eqs. (23) to (25)).

Not known to us and chosen here: two scales (8 and 4 pixels), the finer of which costs 0.5 per degree off the coarser
one; patches of 11 pixels in 8 grey levels (as good as 16 levels or 21 pixels on other photographs); the direction of
the plane from the mean polarization of a patch of all four photographs; and, for the paper's constraints, least squares
with layers of at least 0 in every pixel.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture
from polaropt.numerics import block_mean
from polaropt.optics import in_place_reflectance

Images = NDArray[np.float32]
Costs = NDArray[np.float32]

LABELS_DEG = np.arange(5, 87)
_SCALES = (8, 4)
_PATCH = 11
_LEVELS = 8
_SMOOTHNESS = np.float32(0.5)
_ROUNDS = 60
_ENOUGH = 1e-9
# Directions that messages travel in: step and axis. Each is followed by the one back.
_STEPS = ((1, 1), (-1, 1), (1, 2), (-1, 2))


def separate_in_scales(capture: Capture, azimuth_deg: float, refractive_index: float) -> Images:
    """Layers (2, channel, h, w); `azimuth_deg` is only asked for the half plane: within 45 degrees of it."""
    stokes = capture.stokes if capture.color else capture.stokes[:, None]
    grey = stokes.mean(axis=1)
    reflectances = np.array([in_place_reflectance(float(i), refractive_index, False) for i in LABELS_DEG])
    incidence: NDArray[np.int64] | None = None
    for scale in _SCALES:
        part = block_mean(grey, scale)
        costs = _patch_information(_along_and_across(part, _azimuths(part, azimuth_deg)), reflectances)
        if incidence is not None:
            costs += _SMOOTHNESS * np.abs(np.arange(len(LABELS_DEG))[:, None, None] - _enlarged(incidence, costs.shape))
        incidence = _propagated(costs)
    if incidence is None:
        raise ValueError("there are no scales")
    height, width = grey.shape[-2:]
    found = _smooth(reflectances[incidence].transpose(2, 0, 1).astype(np.float32), (height, width))
    azimuths = _azimuths(block_mean(grey, _SCALES[0]), azimuth_deg)
    turned = np.stack([np.cos(2 * azimuths), np.sin(2 * azimuths)]).astype(np.float32)
    cos, sin = _smooth(turned, (height, width))
    along = np.stack([stokes[0] + sign * (cos * stokes[1] + sin * stokes[2]) for sign in (1, -1)]) / 2
    return nonnegative_layers(along.astype(np.float32), found)


def _azimuths(stokes: Images, azimuth_deg: float) -> NDArray[np.float64]:
    """Of the plane of incidence in every pixel (radians), from the polarization of the patch around it."""
    from scipy.ndimage import uniform_filter

    _, s1, s2 = stokes.astype(np.float64)
    # An axis is the same turned by 90 degrees: the fourfold angle has no jumps.
    cos, sin = (uniform_filter(part, _PATCH) for part in (s1**2 - s2**2, 2 * s1 * s2))
    axis = np.arctan2(sin, cos) / 4
    near = np.radians(azimuth_deg)
    return np.asarray(near + (axis - near + np.pi / 4) % (np.pi / 2) - np.pi / 4)


def _along_and_across(stokes: Images, azimuths: NDArray[np.float64]) -> Images:
    s0, s1, s2 = stokes
    polarized = np.cos(2 * azimuths) * s1 + np.sin(2 * azimuths) * s2
    return np.asarray(np.stack([s0 + polarized, s0 - polarized]) / 2, dtype=np.float32)


def _patch_information(across: Images, reflectances: NDArray[np.float64]) -> Costs:
    """Mutual information over mean entropy of the patch around each pixel, at each label: (label, h, w)."""
    costs = np.empty((len(reflectances), *across.shape[-2:]), dtype=np.float32)
    for label, (along_r, across_r) in enumerate(reflectances):
        mixing = np.array([[1 - along_r, along_r], [1 - across_r, across_r]]) / 2
        layers = np.tensordot(np.linalg.inv(mixing).astype(np.float32), across, axes=1)
        costs[label] = _shared(*np.clip(layers * _LEVELS, 0, _LEVELS - 1).astype(np.int64))
    return costs


def _shared(first: NDArray[np.int64], second: NDArray[np.int64]) -> Costs:
    of_first, of_second = (_patch_entropy(image) for image in (first, second))
    mean = np.maximum((of_first + of_second) / 2, _ENOUGH)
    shared = (of_first + of_second - _patch_entropy(first * _LEVELS + second)) / mean
    # A patch of one level shares nothing and tells nothing: it is as good as any other.
    return np.where(np.minimum(of_first, of_second) > _ENOUGH, shared, 1).astype(np.float32)


def _patch_entropy(levels: NDArray[np.int64]) -> NDArray[np.float64]:
    """Entropy of the levels in the patch around each pixel, mirrored at the borders."""
    half = _PATCH // 2
    padded = np.pad(levels, half, mode="symmetric")
    patches = np.lib.stride_tricks.sliding_window_view(padded, (_PATCH, _PATCH)).reshape(*levels.shape, -1)
    ranked = np.sort(patches, axis=-1)
    n = ranked.shape[-1]
    starts = np.concatenate([np.ones((*levels.shape, 1), bool), ranked[..., 1:] != ranked[..., :-1]], axis=-1)
    # Each run of equal levels of length c adds c log c.
    place = np.flatnonzero(starts)
    lengths = np.diff(np.append(place, starts.size)).astype(np.float64)
    sums = np.bincount(place // n, lengths * np.log(lengths), minlength=levels.size)
    return np.asarray(np.log(n) - sums.reshape(levels.shape) / n)


def _propagated(costs: Costs) -> NDArray[np.int64]:
    """Labels of least cost by loopy belief propagation (min-sum) between the four neighbours of each pixel."""
    messages = np.zeros((4, *costs.shape), dtype=np.float32)
    for _ in range(_ROUNDS):
        total = costs + messages.sum(axis=0)
        sent = [_spread(total - messages[back]) for back in (1, 0, 3, 2)]
        for k, (step, axis) in enumerate(_STEPS):
            messages[k] = _shifted(sent[k] - sent[k].min(axis=0), step, axis)
    return np.asarray(np.argmin(costs + messages.sum(axis=0), axis=0))


def _spread(cost: Costs) -> Costs:
    """Least over all labels of cost and distance, in two sweeps."""
    cost = cost.copy()
    for i in range(1, len(cost)):
        np.minimum(cost[i], cost[i - 1] + _SMOOTHNESS, out=cost[i])
    for i in range(len(cost) - 2, -1, -1):
        np.minimum(cost[i], cost[i + 1] + _SMOOTHNESS, out=cost[i])
    return cost


def _shifted(message: Costs, step: int, axis: int) -> Costs:
    """Moved by one pixel; nothing comes in from outside."""
    moved = np.roll(message, step, axis=axis)
    edge: list[slice | int] = [slice(None)] * 3
    edge[axis] = 0 if step > 0 else -1
    moved[tuple(edge)] = 0
    return moved


def _enlarged(labels: NDArray[np.int64], shape: tuple[int, ...]) -> NDArray[np.int64]:
    """A map of labels at twice its size, cut or repeated to fit (label, h, w)."""
    twice = labels.repeat(2, axis=0).repeat(2, axis=1)
    missing = [(0, max(0, want - have)) for want, have in zip(shape[1:], twice.shape, strict=True)]
    return np.pad(twice, missing, mode="edge")[: shape[1], : shape[2]]


def _smooth(maps: Images, size: tuple[int, int]) -> Images:
    """Maps (n, h, w) at another size, linear between their pixels."""
    from skimage.transform import resize

    return np.stack([resize(each, size, order=1, mode="edge", anti_aliasing=False) for each in maps])


def nonnegative_layers(across: Images, reflectances: Images) -> Images:
    """Least-squares layers of at least 0 in every pixel.

    Parameters
    ----------
    across : ndarray, shape (2, channel, h, w)
        Photographs along and across the plane of incidence.
    reflectances : ndarray, shape (2, h, w)
        Of the pane along and across it.
    """
    of_t, of_r = (1 - reflectances[:, None]) / 2, reflectances[:, None] / 2
    norm_t, norm_r, both = (of_t**2).sum(axis=0), (of_r**2).sum(axis=0), (of_t * of_r).sum(axis=0)
    seen_t, seen_r = (of_t * across).sum(axis=0), (of_r * across).sum(axis=0)
    determinant = norm_t * norm_r - both**2
    t = (norm_r * seen_t - both * seen_r) / determinant
    r = (norm_t * seen_r - both * seen_t) / determinant
    alone_t, alone_r = np.maximum(seen_t / norm_t, 0), np.maximum(seen_r / norm_r, 0)
    without_t, without_r = t < 0, r < 0
    t = np.where(without_t, 0, np.where(without_r, alone_t, t))
    r = np.where(without_r & ~without_t, 0, np.where(without_t, alone_r, r))
    return np.stack([t, r]).astype(np.float32)
