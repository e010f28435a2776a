"""Photographs that a polarization camera would take of two known layers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from polaropt.capture import (
    ANGLES_DEG,
    MOST_NEGATIVE,
    SONY_CELL,
    Capture,
    FloatImages,
    angles_of,
    check_angles,
    mosaic_capture,
    planes_first,
    sampling_of,
)
from polaropt.errors import InputError, check_numbers, check_whole
from polaropt.numerics import in_color, strips
from polaropt.optics import PSE, SceneParameters, VaryingPSE, vertical_reach

DARKEST = 0.9 * MOST_NEGATIVE
"""Noise below black (white = 1) is kept down to here, as by a camera whose black level is that much above its lowest
level; set by hand, and all figures of the studies are of it."""


def simulate(
    transmission: ArrayLike,
    reflection: ArrayLike,
    scene: SceneParameters,
    angles_deg: Sequence[float] = ANGLES_DEG,
    noise: float = 0.005,
    bits: int | None = None,
    seed: int = 0,
    *,
    shot_noise: float = 0.0,
) -> Capture:
    """Blend two layers through a simulated pane and photograph them behind a polarizer.

    Parameters
    ----------
    transmission, reflection : array_like, shape (h, w) or (h, w, channel)
        Linear layers, as image libraries have them: floating point with white = 1, or 8 or 16 bit unsigned integers
        with white at their largest value. Unpolarized light of intensity 1 gives 0.5 behind a polarizer.
    scene : SceneParameters
        A complete scene.
    angles_deg : sequence of float
        Polarizer angles in degrees.
    noise : float
        Standard deviation of Gaussian noise on each photograph (white = 1).
    bits : int, optional
        Quantize to this depth. Default: no quantization.
    seed : int
        Seed of the noise.
    shot_noise : float
        Growth of the noise with the light: its variance is ``noise^2 + shot_noise * intensity``.

    Returns
    -------
    Capture
        Clipped at white, as a sensor does, and a little below black.

    Raises
    ------
    InputError
        Layers that differ in shape, a wrong number of bits or noise, or angles that tell no polarization.

    Examples
    --------
    A cup of coffee behind a pane at 60 degrees that mirrors an astronaut:

    >>> from skimage.data import astronaut, coffee
    >>> from polaropt import SceneParameters, simulate
    >>> simulate(coffee()[150:246, 200:296], astronaut()[30:126, 160:256], SceneParameters(60.0, 20.0, 4.0), bits=12)
    Capture(shape=(4, 3, 96, 96), angles_deg=(0.0, 45.0, 90.0, 135.0))
    """
    both = checked_layers(transmission, reflection)
    if not isinstance(scene, SceneParameters):
        raise InputError(f"scene is a {type(scene).__name__}; give SceneParameters")
    check_whole([("seed", seed), *([("bits", bits)] if bits is not None else [])])
    check_numbers([("noise", noise), ("shot_noise", shot_noise)], none=False)
    if not 0 <= noise < np.inf:
        raise InputError(f"the noise is {noise}; give a standard deviation of 0 or more")
    if not 0 <= shot_noise < np.inf:
        raise InputError(f"the shot noise is {shot_noise}; give a variance per unit of intensity of 0 or more")
    if bits is not None and not 1 <= bits <= 24:
        raise InputError(f"{bits} bits; give a depth from 1 to 24")
    angles_deg = angles_of(angles_deg)
    check_angles(angles_deg)
    photographs = _exact_in_strips(both, scene, angles_deg)
    random = np.random.default_rng(int(seed))
    for plane in photographs.reshape(-1, *photographs.shape[-2:]):
        for rows in strips(*plane.shape):
            exact = plane[rows]
            sigma = np.sqrt(noise**2 + shot_noise * np.maximum(exact, 0)) if shot_noise else noise
            plane[rows] = digitized(exact + sigma * random.standard_normal(exact.shape), bits)
    return Capture.of_planes(photographs, angles_deg)


def exact_engine(scene: SceneParameters, angles_deg: Sequence[float]) -> PSE | VaryingPSE:
    """The engine that photographs are simulated with: no ghost is left out, however faint."""
    return VaryingPSE(scene, angles_deg) if scene.varies else PSE(scene, angles_deg)


def exact_photographs(layers: FloatImages, scene: SceneParameters, angles_deg: Sequence[float]) -> FloatImages:
    """Photographs (k, [channel,] h, w) of layers (2, [channel,] h, w) before any noise, clipping and rounding."""
    engine = exact_engine(scene, angles_deg)
    return np.asarray(engine.forward(_through_tint(layers, scene)), dtype=np.float32)


def _through_tint(layers: FloatImages, scene: SceneParameters) -> FloatImages:
    """Layers as an engine takes them: its transmission is what is seen through the tint."""
    return np.stack([np.float32(scene.tint) * layers[0], layers[1]]) if scene.absorption else layers


def _exact_in_strips(
    both: tuple[NDArray[Any], NDArray[Any]], scene: SceneParameters, angles_deg: Sequence[float]
) -> FloatImages:
    """The same of images (h, w[, channel]), some rows at a time with those around that ghosts bring in."""
    height, width, *channels = both[0].shape
    engine = exact_engine(scene, angles_deg)
    reach = vertical_reach(engine, height, width)
    photographs = np.empty((len(angles_deg), *channels, height, width), dtype=np.float32)
    for rows in strips(height, len(angles_deg) * math.prod(channels) * width, multiple=min(reach, height)):
        first, stop = max(0, rows.start - reach), min(height, rows.stop + reach)
        of_strip = engine.moved(0, -first, height, width) if isinstance(engine, VaryingPSE) else engine
        layers = stack_layers(*(image[first:stop] for image in both))
        seen = of_strip.forward(_through_tint(layers, scene))
        photographs[..., rows, :] = seen[..., rows.start - first : rows.stop - first, :]
    return photographs


def digitized(photographs: NDArray[np.float64], bits: int | None) -> NDArray[np.float64]:
    """What a sensor of `bits` makes of it, with some noise left below black: down to -0.9 % of white.

    What is cut off there brightens black by 0.01 % of white where the noise is 0.5 %, by 0.1 % where it is 1 % and by
    0.4 % where it is 2 %, as a camera's black level does that is no farther above its lowest level.
    """
    if bits is None:
        return np.clip(photographs, DARKEST, 1)
    white = 2**bits - 1
    steps = np.clip(np.round(photographs * white), np.ceil(DARKEST * white), white)
    return np.asarray(steps / white, dtype=np.float64)


def stack_layers(transmission: ArrayLike, reflection: ArrayLike) -> FloatImages:
    """Images (h, w[, channel]) to layers (2, [channel,] h, w), float32."""
    both = checked_layers(transmission, reflection)
    return np.ascontiguousarray(np.stack([planes_first(_as_linear(image)) for image in both]))


def checked_layers(transmission: ArrayLike, reflection: ArrayLike) -> tuple[NDArray[Any], NDArray[Any]]:
    """Two images (h, w[, channel]) as they are; InputError where they differ in shape or are no images."""
    both = np.asarray(transmission), np.asarray(reflection)
    if both[0].shape != both[1].shape or both[0].ndim not in (2, 3):
        shapes = f"{both[0].shape} and {both[1].shape}"
        raise InputError(f"the layers have shapes {shapes}; give two equal (h, w[, channel])")
    if not both[0].size:
        raise InputError(f"the layers have shape {both[0].shape}; they hold no pixels")
    for image in both:
        if image.dtype.kind not in "buif":
            raise InputError(f"a layer holds values of type {image.dtype}; real numbers are needed, white = 1")
        darkest, brightest = float(image.min()), float(image.max())
        if not (math.isfinite(darkest) and math.isfinite(brightest)):
            raise InputError("a layer holds NaN or infinite values; replace them")
        if max(-darkest, brightest) > _BRIGHTEST:
            raise InputError(f"a layer holds values up to {brightest:.3g}; white is 1: divide by the white level")
    return both


def _as_linear(values: NDArray[Any]) -> FloatImages:
    white = np.iinfo(values.dtype).max if values.dtype in (np.uint8, np.uint16) else 1
    return values.astype(np.float32) / np.float32(white)


Image = NDArray[np.float32]

_BRIGHTEST = 1e9
"""Of linear layers, far beyond any scene: what is made of more is beyond float32. Set by hand."""
MARGIN = 64
"""Pixels of the layers around a frame, so that what the ghosts carry in from outside is there; set by hand."""


@dataclass(frozen=True)
class Camera:
    """How the photographs are taken.

    Attributes
    ----------
    angles_deg : sequence of float
        Of the polarizer.
    noise : float
        Standard deviation of the noise of a photograph (white = 1).
    bits : int or None
        Depth; None: not quantized.
    seed : int
        Of the noise.
    lens_blur_px : float
        Standard deviation of the Gaussian that the lens makes of a point, in pixels.
    """

    angles_deg: Sequence[float] = ANGLES_DEG
    noise: float = 0.005
    bits: int | None = None
    seed: int = 0
    lens_blur_px: float = 0.0

    def through_lens(self, image: Image) -> Image:
        """A layer (h, w[, channel]) as the lens images it."""
        from scipy.ndimage import gaussian_filter

        if not 0 <= self.lens_blur_px < np.inf:
            raise InputError(f"the lens blur is {self.lens_blur_px} px; give a standard deviation of 0 or more")
        if self.lens_blur_px == 0:
            return image
        return np.asarray(gaussian_filter(image, self.lens_blur_px, axes=(0, 1)), dtype=np.float32)


def photograph_pair(
    transmission: Image, reflection: Image, scene: SceneParameters, camera: Camera, margin: int = MARGIN
) -> Capture:
    """Capture of two layers (h, w[, channel]); `margin` pixels on each side are in the layers only."""
    transmission, reflection = camera.through_lens(transmission), camera.through_lens(reflection)
    larger = simulate(transmission, reflection, scene, camera.angles_deg, camera.noise, camera.bits, camera.seed)
    if margin == 0:
        return larger
    inside = (..., slice(margin, -margin), slice(margin, -margin))
    return Capture.of_planes(larger.intensities[inside], larger.angles_deg, larger.valid[inside])


def photograph_mosaic(
    transmission: Image,
    reflection: Image,
    scene: SceneParameters,
    camera: Camera,
    color: bool,
    cell_order: Sequence[float] = SONY_CELL,
) -> Image:
    """Raw mosaic (h, w) of two layers, as a polarization camera would store it, white = 1.

    Parameters
    ----------
    transmission, reflection : ndarray, shape (h, w[, channel])
        Linear. A mono sensor sees the mean of the colours.
    scene : SceneParameters
        A complete scene.
    camera : Camera
        Its angles are those of the cell.
    color : bool
        Whether the sensor has a Bayer pattern of cells, R G / G B.
    cell_order : sequence of 4 floats
        Angles of a cell in degrees: top left, top right, bottom left, bottom right.
    """
    sampling, angles = sampling_of(color, cell_order)
    seen = (camera.through_lens(sensor_image(image, color)) for image in (transmission, reflection))
    photographs = exact_photographs(stack_layers(*seen), scene, angles)
    raw = sampling.sample(photographs.reshape(len(angles), sampling.n_channels, *photographs.shape[-2:]))
    noise = camera.noise * np.random.default_rng(camera.seed).standard_normal(raw.shape)
    return digitized(raw + noise, camera.bits).astype(np.float32)


def simulated_mosaic(raw: Image, color: bool, resolution: str = "sensor") -> Capture:
    """The capture of a raw mosaic (h, w) that was simulated with Sony's cells: linear, white = 1, without gains.

    Parameters
    ----------
    raw : ndarray, shape (h, w)
    color : bool
        Whether the sensor has colours.
    resolution : {"sensor", "cell"}
        As of `read_capture`.
    """
    return mosaic_capture(
        raw,
        sensor="color" if color else "mono",
        cell_order=SONY_CELL,
        pair_gain=1.0,
        white_level=1.0,
        gamma=1.0,
        resolution=resolution,
    )


def sensor_image(image: Image, color: bool) -> Image:
    """An image (h, w[, channel]) with the colours that a sensor tells: three, or their mean (h, w)."""
    if color:
        return in_color(image)
    return image if image.ndim == 2 else np.asarray(image.mean(axis=-1), dtype=np.float32)


def whole_patterns(image: Image, color: bool) -> Image:
    """An image (h, w[, channel]) without the last rows and columns that are no whole pattern of a sensor's mosaic."""
    period = sampling_of(color)[0].period
    height, width = (side // period * period for side in image.shape[:2])
    return image[:height, :width]


def without_margin(image: Image, margin: int = MARGIN) -> Image:
    """The frame of a layer (h, w[, channel])."""
    return np.ascontiguousarray(image[margin:-margin, margin:-margin])
