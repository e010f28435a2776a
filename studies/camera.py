"""Photographs of a scene: the engine's light, then what light, camera and photographer do to it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import ANGLES_DEG, Capture, NoiseModel, sampling_of
from polaropt.optics import SceneParameters, in_place_reflectance, plane_normal
from polaropt.simulation import digitized, exact_photographs, simulated_mosaic, stack_layers
from studies.photographs import SIZE_PX, Pair, pairs_of
from studies.scenes import BLIND, Light, Scene, Taking, focal_px, random_bend

Images = NDArray[np.float32]
Mask = NDArray[np.bool_]

STABILITY_SEED = 1000
"""What is added to a pair's number for scenes whose chance is drawn by one generator."""
EXPOSED_TO = 0.97
"""Where nothing shall clip, the brightest light is this or less (white = 1)."""
EXCEEDING = 1.9
"""Light of a transmission that exceeds white; without glass it is 2, since the filter takes half."""
HIGHLIGHT, HIGHLIGHT_PX, N_HIGHLIGHTS = 6.0, 5.0, 12
"""Brightness of mirrored lamps (white = 1), their radius and number."""
DARKNESS = 0.1
"""Brightness of the light "dark hdr" beside its lamps."""
_ANGLE_SIGNS = np.array([1.0, -1.0, 1.0, -1.0])
_SHIFTED = ((1, 1.0), (3, -1.0))
_OUT_OF_FOCUS = 2
# A shift of 5 px is 3 px down and 4 px to the right.
_DIRECTION = (0.6, 0.8)
_STEEPEST_DEG = 89.0
_LEAST_CROSSED = 1e-3
"""Change of a photograph (white = 1) from which on something crosses a pixel. Set by hand."""


@dataclass(frozen=True)
class Sample:
    """A scene as it was photographed.

    Attributes
    ----------
    capture : Capture
    layers : ndarray, shape (2, channel, h, w)
        Both true layers as such a camera would see them, the transmission through the tint; by a camera that encodes
        they are encoded as well, which is what can be asked of who does not know.
    scene : SceneParameters
        The true pane.
    hint : SceneParameters
        What the software is given of it.
    unclipped : ndarray of bool, shape (h, w)
        Pixels that no photograph clips, and that nothing crosses.
    """

    capture: Capture
    layers: Images
    scene: SceneParameters
    hint: SceneParameters
    unclipped: NDArray[np.bool_]


@dataclass(frozen=True)
class SceneJob:
    """One scene with one pair of photographs: what most studies work on at a time.

    Attributes
    ----------
    scene : Scene
    pair : int
    photos : str or None
        Folder of photographs; None: those inside scikit-image.
    size : int
        Side of the frame in pixels; half of it is kept beyond the frame on each side.
    """

    scene: Scene
    pair: int
    photos: str | None = None
    size: int = SIZE_PX

    @property
    def photographs(self) -> Pair:
        """The pair."""
        return pairs_of(self.photos, self.size, self.size // 2)[self.pair]

    def sample(self) -> Sample:
        """The scene as it is photographed."""
        return take(self.scene, self.photographs)


def take(scene: Scene, pair: Pair) -> Sample:
    """The photographs of one scene and pair; noise and all chance are seeded by the pair's number."""
    random = np.random.default_rng(pair.number + (STABILITY_SEED if scene.draw == "stability" else 0))
    true = true_pane(scene, pair.height, random)
    noise = random if scene.draw == "stability" else np.random.default_rng(pair.number)
    return photograph(pair, true, scene.taking, scene.hint_of(true), random=random, noise=noise)


def read_again(sample: Sample, resolution: str = "sensor") -> Sample:
    """A raw mosaic read anew from what its sensor measured; four photographs are as they are.

    With its cells, which else are made when they are first asked for: what is timed with such a sample finds them made.
    At the resolution "cell" the pane is in pixels of the cells, the true layers remain in those of the sensor.
    """
    samples = sample.capture.samples
    if samples is None:
        return sample
    capture = simulated_mosaic(samples.values, sample.capture.color, resolution)
    assert capture.registered is not None
    share = capture.shape[-1] / samples.values.shape[-1]
    return replace(sample, capture=capture, scene=sample.scene.scaled(share), hint=sample.hint.scaled(share))


def true_pane(scene: Scene, size: int, random: np.random.Generator) -> SceneParameters:
    """The scene's pane with what is drawn for a pair, for frames of a size in pixels."""
    pane = scene.pane
    plain = SceneParameters(
        pane.incidence_deg,
        0.0,
        pane.ghost_shift,
        pane.refractive_index,
        single_surface=pane.single_surface,
        focal_px=focal_px(pane.view_deg, size),
    )
    if scene.draw == "stability":
        azimuth, screen, sky = (float(angle) for angle in random.uniform(0, 180, 3))
    else:
        if pane.most_bent_deg:
            plain = plain.replace(bend_deg_per_px=random_bend(pane.most_bent_deg, size, random))
        # Seen from afar, an azimuth turned by 180 degrees is the same pane.
        azimuth = float(random.uniform(0, 360 if pane.view_deg else 180))
        screen = sky = 0.0
        if pane.screen_dolp or pane.sky_dolp:
            behind, mirrored = (float(angle) for angle in random.uniform(0, 180, 2))
            screen, sky = behind if pane.screen_dolp else 0.0, mirrored if pane.sky_dolp else 0.0
    return plain.replace(
        azimuth_deg=azimuth,
        transmission_polarization=(pane.screen_dolp, screen),
        reflection_polarization=(pane.sky_dolp, sky),
    )


def photograph(
    pair: Pair,
    scene: SceneParameters,
    taking: Taking = Taking(),  # noqa: B008 (frozen)
    hint: SceneParameters = BLIND,
    *,
    random: np.random.Generator | None = None,
    noise: np.random.Generator | None = None,
) -> Sample:
    """Photograph a pair through a complete pane on the larger frame, and crop.

    Parameters
    ----------
    pair : Pair
    scene : SceneParameters
    taking : Taking
    hint : SceneParameters
        Passed on.
    random, noise : numpy.random.Generator, optional
        Of highlights, and of the noise. Default: each seeded by the pair's number.
    """
    random = np.random.default_rng(pair.number) if random is None else random
    noise = np.random.default_rng(pair.number) if noise is None else noise
    layers = _imaged(_lit(pair, taking, random), taking)
    photographs = _through(layers, scene, taking)
    if taking.parallax_px:
        photographs += _beside(layers, scene, taking, random)
    exposure = _exposure(photographs, layers[0], pair, taking)
    crossed = np.zeros(photographs.shape[-2:], bool)
    if taking.moving_side:
        still, photographs = photographs, _crossed(layers, scene, taking, pair, random)
        crossed = (np.abs(photographs - still) > _LEAST_CROSSED).any(axis=(0, 1))
    if taking.unglazed_side:
        crossed |= _framed(photographs, layers, pair, taking.unglazed_side)
    gains = np.reshape(taking.gains, (-1, 1, 1, 1)).astype(np.float32)
    moved = _turned(_moved(photographs * (exposure * gains), taking.shift_px), taking.turn_deg)
    photographs = _defocused(moved, taking.defocus_px)
    light = pair.cropped(photographs + _deviation(photographs, taking) * _drawn(photographs.shape, taking, noise))
    seen_through = np.array([scene.tint, 1], dtype=np.float32)[:, None, None, None]
    layers = pair.cropped(layers) * (exposure * seen_through)
    if taking.gamma != 1:
        light = np.sign(light) * np.abs(light) ** (1 / taking.gamma)
        layers = 2 * (layers / 2) ** np.float32(1 / taking.gamma)
    if taking.sensor:
        capture = _mosaic(light, taking)
        valid = capture.valid.reshape(-1, *capture.shape[-2:]).all(axis=0)
        return Sample(capture, layers, scene, hint, valid & ~pair.cropped(crossed))
    seen = digitized(light, taking.bits)
    capture = Capture.of_planes(seen, ANGLES_DEG)
    unclipped = np.asarray(capture.valid.all(axis=(0, 1))) & ~pair.cropped(crossed)
    if taking.headroom:
        capture = Capture.of_planes(np.where(capture.valid, seen, light), ANGLES_DEG, np.ones_like(capture.valid))
    return Sample(capture, layers, scene, hint, unclipped)


def _drawn(shape: tuple[int, ...], taking: Taking, noise: np.random.Generator) -> Images:
    """Noise of unit variance in each value."""
    from scipy.ndimage import gaussian_filter

    drawn = noise.standard_normal(shape)
    if not taking.noise_blur_px:
        return drawn
    drawn = gaussian_filter(drawn, taking.noise_blur_px, axes=(-2, -1), mode="wrap")
    return drawn / np.sqrt(np.mean(drawn**2))


def _deviation(photographs: Images, taking: Taking) -> float | Images:
    """Standard deviation of the noise in each value, all of its variance Gaussian: at 100 photons no one can tell."""
    if not taking.shot_noise:
        return taking.noise
    return np.sqrt(NoiseModel(taking.noise, taking.shot_noise).variance(photographs))


def _lit(pair: Pair, taking: Taking, random: np.random.Generator) -> Images:
    """Both scenes (2, channel, h, w) on the larger frame."""
    layers = stack_layers(pair.transmission, pair.reflection)
    layers = np.stack([_toned(layer, taking.light, taking.stops) for layer in layers])
    layers[1] *= np.float32(taking.reflection_gain)
    if taking.light in ("highlight", "dark hdr"):
        layers[1] += np.float32(HIGHLIGHT) * _spots(layers.shape[-2:], random)
    return np.asarray(layers, dtype=np.float32)


def _imaged(layers: Images, taking: Taking) -> Images:
    """Layers as the lens images them for the sensor: blurred, and grey where it has no colours."""
    from scipy.ndimage import gaussian_filter

    if taking.lens_blur_px:
        layers = gaussian_filter(layers, taking.lens_blur_px, axes=(-2, -1))
    if taking.reflection_blur_px:
        layers = np.stack([layers[0], gaussian_filter(layers[1], taking.reflection_blur_px, axes=(-2, -1))])
    return layers.mean(axis=1, keepdims=True) if taking.sensor == "mono" else layers


def _mosaic(light: Images, taking: Taking) -> Capture:
    """The raw mosaic of photographs (4, channel, h, w) with their noise, as its file is read."""
    color = taking.sensor == "color"
    raw = sampling_of(color)[0].sample(light)
    return simulated_mosaic(digitized(raw, taking.bits).astype(np.float32), color)


def _toned(layer: Images, light: Light, stops: float) -> Images:
    if light == "hdr":
        return np.asarray(np.exp2(np.float32(stops) * (layer - 1)), dtype=np.float32)
    return layer * np.float32(DARKNESS) if light == "dark hdr" else layer


def _spots(shape: tuple[int, ...], random: np.random.Generator) -> Images:
    """Round highlights that show nothing, of brightness 1 at their middle."""
    rows, columns = np.mgrid[: shape[0], : shape[1]]
    spots = np.zeros(shape)
    for _ in range(N_HIGHLIGHTS):
        row, column = random.uniform(0, 1, 2) * shape
        spots = np.maximum(spots, np.exp(-((rows - row) ** 2 + (columns - column) ** 2) / (2 * HIGHLIGHT_PX**2)))
    return spots.astype(np.float32)


def _through(layers: Images, scene: SceneParameters, taking: Taking) -> Images:
    angles = tuple(np.asarray(ANGLES_DEG) + taking.angle_error_deg * _ANGLE_SIGNS)
    if taking.bend_deg:
        return bent_photographs(layers, scene, taking.bend_deg, angles)
    return exact_photographs(layers, scene, angles)


def _crossed(layers: Images, scene: SceneParameters, taking: Taking, pair: Pair, random: np.random.Generator) -> Images:
    """The same while a square thing goes on behind the pane, from photograph to photograph.

    It looks like the transmission half a frame away, and leaves the frame neither at the start nor at the end.
    """
    side = max(1, round(taking.moving_side * pair.height))
    way = taking.moving_step * pair.height * (len(ANGLES_DEG) - 1)
    direction = random.uniform(0, 2 * np.pi)
    start = pair.margin + random.uniform(0, 1, 2) * max(0.0, pair.height - side - way)
    step = taking.moving_step * pair.height * np.abs([np.sin(direction), np.cos(direction)])
    thing = np.roll(layers[0], pair.height // 2, axis=(-2, -1))
    photographs = []
    for k in range(len(ANGLES_DEG)):
        top, left = (int(place) for place in np.round(start + k * step))
        place, origin = np.s_[:, top : top + side, left : left + side], np.round(start).astype(int)
        seen = layers.copy()
        seen[0][place] = thing[:, origin[0] : origin[0] + side, origin[1] : origin[1] + side]
        photographs.append(_through(seen, scene, taking)[k])
    return np.stack(photographs)


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
        incidence_deg = min(math.degrees(math.acos(float(np.clip(abs(z[column]), 0, 1)))), _STEEPEST_DEG)
        weights = _intensity_weights(incidence_deg, scene.index)
        turned = 2 * (np.radians(angles_deg) - math.atan2(n_y, x[column]))
        par, perp = np.tensordot(weights, layers[..., column], axes=1) / 2
        photographs[..., column] = np.multiply.outer((1 + np.cos(turned)) / 2, par)
        photographs[..., column] += np.multiply.outer((1 - np.cos(turned)) / 2, perp)
    return photographs


def _intensity_weights(incidence_deg: float, refractive_index: float) -> NDArray[np.float64]:
    """What of each layer passes along and across the plane of incidence, all bounces together: (2, layer)."""
    reflected = np.array(in_place_reflectance(incidence_deg, refractive_index, single_surface=False))
    return np.stack([1 - reflected, reflected], axis=1)


def _exposure(photographs: Images, transmission: Images, pair: Pair, taking: Taking) -> np.float32:
    """Brightest light below white, or a share of the pixels above; highlights are meant to clip."""
    if taking.clipped:
        return np.float32(1 / np.quantile(pair.cropped(photographs).max(axis=(0, 1)), 1 - taking.clipped))
    if taking.clipped_transmission:
        bright = np.quantile(pair.cropped(transmission).max(axis=0), 1 - taking.clipped_transmission)
        return np.float32(EXCEEDING / bright)
    if taking.light in ("highlight", "dark hdr") or not taking.below_white:
        return np.float32(1)
    return np.float32(min(1.0, EXPOSED_TO / float(photographs.max())))


def _moved(photographs: Images, distance_px: float) -> Images:
    if not distance_px:
        return photographs
    moved = photographs.copy()
    for k, sign in _SHIFTED:
        down, across = (part * sign * distance_px for part in _DIRECTION)
        moved[k] = _shifted(photographs[k], down, across)
    return moved


def _turned(photographs: Images, angle_deg: float) -> Images:
    """Turned about the middle, by splines between twice as many pixels, which keep the finest detail."""
    from scipy.ndimage import rotate
    from scipy.signal import resample

    if not angle_deg:
        return photographs
    turned = photographs.copy()
    for k, sign in _SHIFTED:
        finer = photographs[k]
        for axis in (-2, -1):
            finer = resample(finer, 2 * finer.shape[axis], axis=axis)
        seen = rotate(finer, sign * angle_deg, axes=(-1, -2), reshape=False, order=5, mode="mirror")
        turned[k] = seen[..., ::2, ::2]
    return turned


def _shifted(photograph: Images, down: float, across: float) -> Images:
    """A photograph (channel, h, w) moved by its phases."""
    from scipy.ndimage import fourier_shift

    return np.asarray(np.fft.ifftn(fourier_shift(np.fft.fftn(photograph), (0.0, down, across))).real)


def _beside(layers: Images, scene: SceneParameters, taking: Taking, random: np.random.Generator) -> Images:
    """What becomes of photographs where the mirrored scene lies elsewhere in all but the first."""
    mirrored = _through(layers * np.array([0, 1], np.float32)[:, None, None, None], scene, taking)
    moved = mirrored.copy()
    for photograph in moved[1:]:
        direction = random.uniform(0, 2 * np.pi)
        down, across = taking.parallax_px * math.sin(direction), taking.parallax_px * math.cos(direction)
        photograph[:] = _shifted(photograph, down, across)
    return moved - mirrored


def _framed(photographs: Images, layers: Images, pair: Pair, side: float) -> Mask:
    """Cover the sides of photographs (k, channel, h, w) with what shows no glass; which pixels (h, w) that are.

    It looks like the mirrored scene half a frame away, by unpolarized light.
    """
    height, width = (length - 2 * pair.margin for length in photographs.shape[-2:])
    edge = pair.margin + max(1, round(side * min(height, width)))
    frame = np.ones(photographs.shape[-2:], dtype=np.bool_)
    frame[edge:-edge, edge:-edge] = False
    wall = np.roll(layers[1], (height // 2, width // 2), axis=(-2, -1)) / 2
    photographs[..., frame] = wall[:, frame]
    return frame


def _defocused(photographs: Images, deviation_px: float) -> Images:
    from scipy.ndimage import gaussian_filter

    if not deviation_px:
        return photographs
    seen = photographs.copy()
    seen[_OUT_OF_FOCUS] = gaussian_filter(photographs[_OUT_OF_FOCUS], deviation_px, axes=(-2, -1))
    return seen
