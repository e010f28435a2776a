"""The polarization simulation engine where incidence and azimuth vary over the frame, all bounces summed in place."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from array_api_compat import array_namespace, is_torch_namespace
from numpy.typing import NDArray

from polaropt.fresnel import interface_images
from polaropt.perspective import pixel_grid, scene_angles
from polaropt.scene import SceneParameters
from polaropt.stokes import analyzer_matrix, as_floating, change_basis, stokes_vector

Planes = NDArray[np.float64]

# Cosine of the steepest incidence that is told apart from grazing.
_GRAZING = 1e-3


class VaryingPSE:
    """Engine of one scene that varies over the frame; counterpart of `PSE`, without ghosts beside their origin.

    Parameters
    ----------
    scene : SceneParameters
        A complete scene with a focal length or a bent pane.
    angles_deg : sequence of float
        Polarizer angles of the photographs, in degrees.
    center : (float, float), optional
        Column and row of the principal point in the images. Default: their middle.
    """

    def __init__(
        self, scene: SceneParameters, angles_deg: Sequence[float], center: tuple[float, float] | None = None
    ) -> None:
        scene.values()
        self.scene = scene
        self.angles_deg = tuple(float(angle) for angle in angles_deg)
        self.analyzer = analyzer_matrix(angles_deg)
        self._center = center

    def mixtures(self, height: int, width: int) -> NDArray[np.float32]:
        """Stokes images (3, 2, height, width) that layers of intensity 1 give, in the camera's frame."""
        return _mixtures(self.scene, height, width, self.center(height, width))

    def center(self, height: int, width: int) -> tuple[float, float]:
        """Column and row of the principal point in images of this size."""
        return ((width - 1) / 2, (height - 1) / 2) if self._center is None else self._center

    def forward(self, layers: Any) -> Any:
        """Photographs (k, [channel,] h, w) of layers (2, [channel,] h, w)."""
        xp = array_namespace(layers)
        layers = as_floating(layers, xp)
        mixtures = self._like(layers, xp)
        stokes = xp.stack(
            [mixtures[i, 0, ...] * layers[0, ...] + mixtures[i, 1, ...] * layers[1, ...] for i in range(3)]
        )
        return change_basis(self.analyzer, stokes)

    def adjoint(self, intensities: Any) -> Any:
        """Transpose of `forward`."""
        xp = array_namespace(intensities)
        stokes = change_basis(self.analyzer.T, intensities)
        mixtures = self._like(stokes, xp)
        return xp.stack([sum(mixtures[i, j, ...] * stokes[i, ...] for i in range(3)) for j in range(2)])

    def components(self, layers: Any) -> Any:
        """The parts of the photographs that come from each layer, (2, k, [channel,] h, w)."""
        xp = array_namespace(layers)
        nothing = xp.zeros_like(layers[0, ...])
        parts = ([layers[0, ...], nothing], [nothing, layers[1, ...]])
        return xp.stack([self.forward(xp.stack(part)) for part in parts])

    def _like(self, images: Any, xp: Any) -> Any:
        mixtures = self.mixtures(*images.shape[-2:])
        device = images.device if is_torch_namespace(xp) else None
        return xp.asarray(mixtures, dtype=images.dtype, device=device)


@lru_cache(maxsize=4)
def _mixtures(scene: SceneParameters, height: int, width: int, center: tuple[float, float]) -> NDArray[np.float32]:
    cosine, cos, sin = scene_angles(scene, *pixel_grid(height, width, center))
    weights = in_place_weights(np.maximum(cosine, _GRAZING), scene.refractive_index, scene.single_surface)
    incoming = (scene.transmission_polarization, scene.reflection_polarization)
    mixtures = [
        _stokes(weight, stokes_vector(*light), cos, sin) for weight, light in zip(weights, incoming, strict=True)
    ]
    return np.stack(mixtures, axis=1).astype(np.float32)


def in_place_weights(cosine: Planes, refractive_index: float, single_surface: bool) -> tuple[Planes, Planes]:
    """Diagonal entries (3, ...) of the whole pane for transmitted and reflected light, all bounces in place."""
    rho, tau = interface_images(cosine, refractive_index)
    if single_surface:
        transmitted, reflected = tau, rho
    else:
        beyond = tau * tau / (1 - rho * rho)
        transmitted, reflected = beyond, rho + beyond * rho
    # A mirror image is described as an ideal mirror shows it, which flips the reflection's s2' entry.
    return transmitted, reflected * np.array([1.0, 1.0, -1.0])[:, None, None]


def _stokes(weights: Planes, light: NDArray[np.float64], cos: Planes, sin: Planes) -> Planes:
    """Stokes images (3, h, w) of light that passed the pane: into its frame, weighted there, and back."""
    along, across = cos * light[1] + sin * light[2], cos * light[2] - sin * light[1]
    par, perp = weights[0] * (light[0] + along) / 2, weights[1] * (light[0] - along) / 2
    s1, s2 = par - perp, weights[2] * across
    return np.stack([par + perp, cos * s1 - sin * s2, sin * s1 + cos * s2])
