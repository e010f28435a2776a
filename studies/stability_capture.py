"""Photographs of the stability study's scenes: the engine's light, then what camera and photographer do to it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import ANGLES_DEG, MOST_NEGATIVE, Capture
from polaropt.optics import SceneParameters, interface, plane_normal
from polaropt.simulation import digitized, exact_photographs
from studies.protocol import Pair
from studies.stability_scenes import Case, Light, Taking, focal_px

Images = NDArray[np.float32]

_WHITE = 0.97
_WHITE_OF_CLIPPED = 1.9
_HIGHLIGHT, _DARKNESS = 6.0, 0.1
_N_HIGHLIGHTS, _HIGHLIGHT_PX = 12, 5.0
_ANGLE_SIGNS = np.array([1.0, -1.0, 1.0, -1.0])
_SHIFTED = ((1, 1.0), (3, -1.0))


@dataclass(frozen=True)
class Taken:
    """A capture, both true layers (2, channel, h, w) as such a camera would see them, the true scene, and what is told.

    Layers seen by a camera that encodes are encoded as well: that is what can be asked of who is not told.
    """

    capture: Capture
    layers: Images
    scene: SceneParameters
    told: SceneParameters


def take(case: Case, pair: Pair) -> Taken:
    """The photographs of one case and pair; noise and all chance are seeded by the pair's number."""
    random = np.random.default_rng(1000 + pair.number)
    taking = case.taking
    scene = _scene(case, pair, random)
    layers = _lit(pair, taking, random)
    photographs = _through(layers, scene, taking)
    exposure = _exposure(photographs, layers[0], pair, taking)
    photographs = _moved(photographs * exposure, taking.shift_px)
    photographs = pair.cropped(photographs + taking.noise * random.standard_normal(photographs.shape))
    layers = pair.cropped(layers) * exposure
    if taking.gamma != 1:
        photographs = np.sign(photographs) * np.abs(photographs) ** (1 / taking.gamma)
        layers = 2 * (layers / 2) ** np.float32(1 / taking.gamma)
    photographs = np.maximum(photographs, MOST_NEGATIVE)
    told = case.told(scene)
    return Taken(Capture.of_planes(digitized(photographs, taking.bits), ANGLES_DEG), layers, scene, told)


def _scene(case: Case, pair: Pair, random: np.random.Generator) -> SceneParameters:
    taking = case.taking
    azimuth, screen, sky = (float(angle) for angle in random.uniform(0, 180, 3))
    size = pair.cropped(pair.transmission).shape[0]
    return SceneParameters(
        case.incidence_deg,
        azimuth,
        case.ghost_shift,
        case.refractive_index,
        transmission_polarization=(taking.screen_dolp, screen),
        reflection_polarization=(taking.sky_dolp, sky),
        focal_px=focal_px(taking.view_deg, size),
    )


def _lit(pair: Pair, taking: Taking, random: np.random.Generator) -> Images:
    """Both scenes (2, channel, h, w) on the larger frame."""
    layers = np.stack([np.moveaxis(image, -1, 0) for image in (pair.transmission, pair.reflection)])
    layers = np.stack([_toned(layer, taking.light, taking.stops) for layer in layers])
    layers[1] *= np.float32(taking.reflection_gain)
    if taking.light in ("highlight", "dark hdr"):
        layers[1] += np.float32(_HIGHLIGHT) * _spots(layers.shape[-2:], random)
    return np.asarray(layers, dtype=np.float32)


def _toned(layer: Images, light: Light, stops: float) -> Images:
    if light == "hdr":
        return np.asarray(np.exp2(np.float32(stops) * (layer - 1)), dtype=np.float32)
    return layer * np.float32(_DARKNESS) if light == "dark hdr" else layer


def _spots(shape: tuple[int, ...], random: np.random.Generator) -> Images:
    """Round highlights that show nothing, of brightness 1 at their middle."""
    rows, columns = np.mgrid[: shape[0], : shape[1]]
    spots = np.zeros(shape)
    for _ in range(_N_HIGHLIGHTS):
        row, column = random.uniform(0, 1, 2) * shape
        spots = np.maximum(spots, np.exp(-((rows - row) ** 2 + (columns - column) ** 2) / (2 * _HIGHLIGHT_PX**2)))
    return spots.astype(np.float32)


def _through(layers: Images, scene: SceneParameters, taking: Taking) -> Images:
    angles = tuple(np.asarray(ANGLES_DEG) + taking.angle_error_deg * _ANGLE_SIGNS)
    if taking.bend_deg:
        return bent_photographs(layers, scene, taking.bend_deg, angles)
    return exact_photographs(layers, scene, angles)


def bent_photographs(layers: Images, scene: SceneParameters, bend_deg: float, angles_deg: tuple[float, ...]) -> Images:
    """Photographs (k, channel, h, w) through a pane bent about the vertical, seen from afar, bounces in place.

    The normal turns evenly from left to right, by `bend_deg` over the middle half of the larger frame.
    """
    incidence, azimuth, _ = scene.values()
    n_x, n_y, n_z = plane_normal(incidence, azimuth)
    columns = layers.shape[-1]
    turns = np.radians(bend_deg) * (np.arange(columns) / (columns - 1) - 0.5) * 2
    x, z = n_x * np.cos(turns) + n_z * np.sin(turns), n_z * np.cos(turns) - n_x * np.sin(turns)
    photographs = np.empty((len(angles_deg), *layers.shape[1:]), dtype=np.float32)
    for column in range(columns):
        # Beyond the frame the pane may turn its edge to the camera.
        incidence_deg = min(math.degrees(math.acos(float(np.clip(abs(z[column]), 0, 1)))), 89.0)
        weights = _intensity_weights(incidence_deg, scene.refractive_index)
        turned = 2 * (np.radians(angles_deg) - math.atan2(n_y, x[column]))
        par, perp = np.tensordot(weights, layers[..., column], axes=1) / 2
        photographs[..., column] = np.multiply.outer((1 + np.cos(turned)) / 2, par)
        photographs[..., column] += np.multiply.outer((1 - np.cos(turned)) / 2, perp)
    return photographs


def _intensity_weights(incidence_deg: float, refractive_index: float) -> NDArray[np.float64]:
    """What of each layer passes along and across the plane of incidence, all bounces together: (2, layer)."""
    single = np.asarray(interface(incidence_deg, refractive_index).reflection[:2])
    reflected = 2 * single / (1 + single)
    return np.stack([1 - reflected, reflected], axis=1)


def _exposure(photographs: Images, transmission: Images, pair: Pair, taking: Taking) -> np.float32:
    """Brightest light below white, or a share of the transmission above; highlights are meant to clip."""
    if taking.clipped:
        bright = np.quantile(pair.cropped(transmission).max(axis=0), 1 - taking.clipped)
        return np.float32(_WHITE_OF_CLIPPED / bright)
    if taking.light in ("highlight", "dark hdr"):
        return np.float32(1)
    return np.float32(min(1.0, _WHITE / float(photographs.max())))


def _moved(photographs: Images, distance_px: float) -> Images:
    from scipy.ndimage import fourier_shift

    if not distance_px:
        return photographs
    moved = photographs.copy()
    for k, sign in _SHIFTED:
        step = (0.0, *(0.6 * sign * distance_px, 0.8 * sign * distance_px))
        moved[k] = np.fft.ifftn(fourier_shift(np.fft.fftn(photographs[k]), step)).real
    return moved
