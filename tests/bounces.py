"""A slow version of the engine: Mueller matrices, one ray after the other, bounce by bounce."""

from __future__ import annotations

import math

import numpy as np

from polaropt import SceneParameters
from polaropt.optics.stokes import analyzer_matrix, stokes_vector
from tests.checks import Array
from tests.optics.test_shift import slow_shift


def rotation(azimuth_deg: float) -> Array:
    """Eq. (2): Stokes vectors of the plate's frame to those of the camera's."""
    double = math.radians(2 * azimuth_deg)
    cos, sin = math.cos(double), math.sin(double)
    return np.array([[1, 0, 0], [0, cos, -sin], [0, sin, cos]])


def mueller(parallel: float, perpendicular: float, third: float) -> Array:
    """Linear part of the Mueller matrix of an interface, basis (s0, s1', s2')."""
    mean, half = (parallel + perpendicular) / 2, (parallel - perpendicular) / 2
    return np.array([[mean, half, 0], [half, mean, 0], [0, 0, third]])


def interface_matrices(incidence: float, before: float, after: float) -> tuple[Array, Array]:
    """Mueller matrices of reflection and transmission between two media."""
    refracted = math.asin(before * math.sin(incidence) / after)
    cos_i, cos_t = math.cos(incidence), math.cos(refracted)
    r_s = (before * cos_i - after * cos_t) / (before * cos_i + after * cos_t)
    r_p = (after * cos_i - before * cos_t) / (after * cos_i + before * cos_t)
    t_s, t_p = 1 + r_s, (1 + r_p) * before / after
    flux = after * cos_t / (before * cos_i)
    return mueller(r_p**2, r_s**2, r_p * r_s), flux * mueller(t_p**2, t_s**2, t_p * t_s)


def shift_stokes(stokes: Array, dx: float, dy: float) -> Array:
    flat = stokes.reshape(-1, *stokes.shape[-2:])
    return np.stack([slow_shift(plane, dx, dy) for plane in flat]).reshape(stokes.shape)


def slow_forward(layers: Array, scene: SceneParameters, angles_deg: tuple[float, ...], n_ghosts: int) -> Array:
    """Eqs. (3)-(5) on Stokes images (2, 3, ..., h, w), one ray after the other."""
    incidence_deg, azimuth_deg, ghost_shift = scene.values()
    outside, n = math.radians(incidence_deg), scene.index
    inside = math.asin(math.sin(outside) / n)
    r1, t1 = interface_matrices(outside, 1.0, n)
    r2, t2 = interface_matrices(inside, n, 1.0)
    direction = math.cos(math.radians(azimuth_deg)), -math.sin(math.radians(azimuth_deg))
    ideal_mirror = np.diag([1.0, 1.0, -1.0])

    def through(matrix: Array, stokes: Array) -> Array:
        return np.tensordot(matrix, stokes, axes=1)

    def displaced(stokes: Array, k: int, step: float = ghost_shift) -> Array:
        return shift_stokes(stokes, k * step * direction[0], k * step * direction[1])

    own = ghost_shift if scene.transmission_ghost_shift is None else scene.transmission_ghost_shift

    local = [through(rotation(-azimuth_deg), layer) for layer in layers]
    local[1] = through(ideal_mirror, local[1])
    seen = through(r1, local[1])
    if scene.single_surface:
        return through(analyzer_matrix(angles_deg) @ rotation(azimuth_deg), seen + through(t1, local[0]))
    ray = through(t1, local[0])
    for k in range(n_ghosts + 1):
        seen = seen + displaced(through(t2, ray), k, own)
        ray = through(r2, through(r2, ray))
    ray = through(r2, through(t1, local[1]))
    for k in range(1, n_ghosts + 1):
        seen = seen + displaced(through(t2, ray), k - 1 if scene.literal_eq3 else k)
        ray = through(r2, through(r2, ray))
    return through(analyzer_matrix(angles_deg) @ rotation(azimuth_deg), seen)


def constantly_polarized(layers: Array, scene: SceneParameters) -> Array:
    light = [stokes_vector(*scene.transmission_polarization), stokes_vector(*scene.reflection_polarization)]
    return np.stack([np.multiply.outer(light[i], layers[i]) for i in (0, 1)])


SCENES = [
    (SceneParameters(60, 30, 1.7), 20),
    (SceneParameters(10, 200, -2.3, n_bounces=3), 3),
    (SceneParameters(85, 90, 4.0, n_bounces=10, reflection_polarization=(0.4, 20)), 10),
    (SceneParameters(40, 123, 0.0, 1.33, transmission_polarization=(0.7, 100)), 20),
    (SceneParameters(53, 90, 5.0, 1.33, single_surface=True, reflection_polarization=(0.2, 70)), 0),
    (SceneParameters(65, -20, 2.5, n_bounces=10, literal_eq3=True, reflection_polarization=(1.0, 5)), 10),
    (SceneParameters(70, 0, 40.5, 1.7, n_bounces=4, transmission_polarization=(0.3, 10)), 4),
    (SceneParameters(0, 12, 1.0, n_bounces=2, reflection_polarization=(0.8, 33)), 2),
    (SceneParameters(60, 30, 1.7, 1.0), 1),
    (SceneParameters(75, 30, 1.7, n_bounces=6, transmission_ghost_shift=-0.6), 6),
    (SceneParameters(70, 30, 0.0, transmission_ghost_shift=2.0, transmission_polarization=(0.7, 100)), 40),
    (SceneParameters(70, 30, 2.5, n_bounces=3, transmission_ghost_shift=0.0, literal_eq3=True), 3),
    (SceneParameters(53, 90, 5.0, 1.33, single_surface=True, transmission_ghost_shift=3.0), 0),
]
