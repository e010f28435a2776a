"""Photographs without gaps, which a closed form needs: what is clipped or left out is filled with what is expected.

What is clipped is no darker than white, in each photograph by itself. Where all of them clip at once nothing else is
known, and white in each of them would stand for light that is not polarized, and for a reflection that is far too
bright: there the layers are filled, and the photographs follow from these.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture
from polaropt.numerics import smoothly_filled

Images = NDArray[np.float32]
Mask = NDArray[np.bool_]

_MUCH = 2e-3
"""Share of values without trust that the closed form suffers from: set by hand."""
FEWEST_TOLD = 2
"""Photographs that tell both layers of a pixel."""
_CONTRAST = 0.3
"""Standard deviation of a layer before anything is measured, white = 1; set by hand."""
_LEAST = np.float32(1e-3)
"""Share of a layer in a photograph, and light, that is divided by; set by hand."""


def worth_filling(capture: Capture) -> bool:
    """Whether so much is missing that a closed form, which cannot leave pixels out, suffers from it."""
    if capture.samples is None:
        return capture.n_valid < (1 - _MUCH) * capture.mask.size
    valid = capture.samples.valid
    return bool(np.count_nonzero(valid) < (1 - _MUCH) * valid.size)


def filled(capture: Capture, expected: Images) -> Capture:
    """The capture with the expected photographs where its own cannot be trusted; what is clipped is no darker than it.

    Parameters
    ----------
    capture : Capture
    expected : ndarray, shape (k, channel, h, w)
    """
    observed = capture.observed
    seen, trusted = observed.intensities.reshape(expected.shape), observed.valid.reshape(expected.shape)
    clips = _clips(seen, trusted)
    values = np.where(clips, np.maximum(expected, seen), expected)
    # Brighter all together keeps how their light is polarized.
    blown = clips & (np.count_nonzero(trusted, axis=0) < FEWEST_TOLD)
    if blown.any():
        brighter = np.max(seen / np.maximum(expected, _LEAST), axis=0, where=blown, initial=1)
        values = np.where(blown, brighter * expected, values)
    whole = np.where(trusted, seen, values).astype(np.float32)
    return capture.replace(intensities=whole.reshape(capture.intensities.shape), valid=np.ones_like(capture.valid))


def filled_smoothly(capture: Capture) -> Capture:
    """The capture with smooth values where its own cannot be trusted; what is clipped is no darker than it."""
    shape = (len(capture.angles_deg), -1, *capture.shape[-2:])
    # Of a mosaic the photographs near a sample that clips are interpolated from it.
    known = capture.valid.reshape(shape) if capture.samples is None else capture.samples.valid
    return filled(capture, smoothly_filled(capture.intensities.reshape(shape), known))


def filled_by_layers(capture: Capture, of_transmission: Images, of_reflection: Images, noise: float) -> Capture:
    """Photographs with what smooth layers would give where their own cannot be trusted.

    Near what clips photographs are all about as bright as white, however the light is polarized: filled from there each
    by itself they would not be polarized at all. The reflection is smooth instead, as it is around, and the
    transmission as bright as what is seen of it, or as what clips needs.

    Parameters
    ----------
    capture : Capture
        Full photographs.
    of_transmission, of_reflection : ndarray, shape (k, 1, h, w)
        Shares of the layers in the photographs, all bounces in place.
    noise : float
        Standard deviation of one photograph's noise (white = 1).
    """
    photographs = capture.planes
    trusted = capture.valid.reshape(photographs.shape)
    known = np.asarray(trusted.all(axis=0))
    layers = layers_in_place(photographs, of_transmission, of_reflection, noise)
    transmission, reflection = (smoothly_filled(layer, known) for layer in layers)
    reflection = np.where(known, reflection, np.maximum(reflection, 0))
    t, beside = np.maximum(of_transmission, _LEAST), photographs - of_reflection * reflection
    of_seen = t * trusted
    told = (of_seen * beside).sum(axis=0) / np.maximum((of_seen * t).sum(axis=0), _LEAST)
    needed = np.max(beside / t, axis=0, where=_clips(photographs, trusted), initial=0)
    seen = trusted.any(axis=0)
    transmission = np.where(known, transmission, np.where(seen, told, np.maximum(transmission, needed)))
    return filled(capture, of_transmission * transmission + of_reflection * reflection)


def layers_in_place(photographs: Images, of_transmission: Images, of_reflection: Images, noise: float) -> Images:
    """Layers (2, channel, h, w) of each pixel by itself, all bounces in place; where they are open, both the light.

    Parameters
    ----------
    photographs : ndarray, shape (k, channel, h, w)
    of_transmission, of_reflection : ndarray, shape (k, 1, h, w)
        Shares of the layers in the photographs.
    noise : float
        Standard deviation of one photograph's noise (white = 1).
    """
    light = 2 * photographs.mean(axis=0)
    t, r = of_transmission, of_reflection
    beyond = photographs - (t + r) * light
    ridge = np.float32((noise / _CONTRAST) ** 2)
    tt, tr, rr = (t * t).sum(axis=0) + ridge, (t * r).sum(axis=0), (r * r).sum(axis=0) + ridge
    of_t, of_r = (t * beyond).sum(axis=0), (r * beyond).sum(axis=0)
    determinant = tt * rr - tr * tr
    changes = np.stack([rr * of_t - tr * of_r, tt * of_r - tr * of_t]) / determinant
    return np.asarray(light + changes, dtype=np.float32)


def _clips(seen: Images, trusted: Mask) -> Mask:
    """Where photographs (k, channel, h, w) clip: as bright as any that does not, whatever both were divided by.

    What else cannot be trusted may have any value.
    """
    brightest = seen.max(axis=(-1, -2), keepdims=True, where=trusted, initial=0)
    return np.asarray(seen >= np.where(brightest > 0, brightest, 1))
