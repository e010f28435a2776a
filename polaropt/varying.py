"""The polarization simulation engine where incidence and azimuth vary over the frame.

Each pixel weighs every ghost by its own incidence, in its own plane of incidence. Ghosts lie side by side along the
azimuth at the middle of the frame, at one distance: how it changes over the frame depends on how far the scenes are.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from array_api_compat import array_namespace, is_torch_namespace
from numpy.typing import NDArray

from polaropt.forward import Displacements, displacements, padded_frame
from polaropt.fresnel import interface_images
from polaropt.perspective import pixel_grid, scene_angles
from polaropt.plate import ghost_line, ghosts_until
from polaropt.scene import SceneParameters
from polaropt.shift import PaddedFrame, zeros
from polaropt.stokes import analyzer_matrix, as_floating, change_basis, stokes_vector

Planes = NDArray[np.float64]

# Cosine of the steepest incidence that is told apart from grazing.
_GRAZING = 1e-3
# Ghosts fainter than this everywhere are added to the last one kept, and those beyond so many: only from 88 degrees on
# do they show.
_FAINT = 1e-5
_MOST_GHOSTS = 48
# Rows of weights that are worked out at a time.
_ROWS = 64


class VaryingPSE:
    """Engine of one scene that varies over the frame; counterpart of `PSE`.

    Parameters
    ----------
    scene : SceneParameters
        A complete scene with a focal length or a bent pane.
    angles_deg : sequence of float
        Polarizer angles of the photographs, in degrees.
    center : (float, float), optional
        Column and row of the principal point in the images. Default: their middle.
    n_ghosts : int, optional
        Ghosts to keep where the scene asks for all; the light of the others is added to the last. Default: as many as
        carry light where the pane is seen most steeply.
    """

    def __init__(
        self,
        scene: SceneParameters,
        angles_deg: Sequence[float],
        center: tuple[float, float] | None = None,
        n_ghosts: int | None = None,
    ) -> None:
        scene.values()
        self.scene = scene
        self.angles_deg = tuple(float(angle) for angle in angles_deg)
        self.analyzer = analyzer_matrix(angles_deg)
        self._center = center
        self._n_ghosts = n_ghosts

    def mixtures(self, height: int, width: int) -> NDArray[np.float32]:
        """Stokes images (3, 2, height, width) that layers of intensity 1 give, in the camera's frame."""
        ghosts = self.ghost_mixtures(height, width)
        return ghosts[:, :, 0] if ghosts.shape[2] == 1 else ghosts.sum(axis=2)

    def ghost_mixtures(self, height: int, width: int) -> NDArray[np.float32]:
        """The same for each ghost alone, (3, 2, ghosts + 1, height, width), as seen by the pixel that shows it."""
        return _mixtures(self.scene, self.n_ghosts(height, width), height, width, self.center(height, width))

    def displacements(self, height: int, width: int) -> Displacements:
        """(ghosts + 1) times (dx, dy): columns to the right and rows down from the direct image."""
        line = ghost_line(self.scene, self.n_ghosts(height, width))
        return displacements(line, self.scene.values()[1])

    def n_ghosts(self, height: int, width: int) -> int:
        """Ghosts of each layer that are kept in images of this size."""
        if self._n_ghosts is not None or not self.scene.has_ghosts:
            return 1 if self._n_ghosts is None else self._n_ghosts
        return ghosts_seen(self.scene, (height, width), self._center, _FAINT)

    def center(self, height: int, width: int) -> tuple[float, float]:
        """Column and row of the principal point in images of this size."""
        return _center_of(self._center, height, width)

    def moved(self, columns: int, rows: int, height: int, width: int) -> VaryingPSE:
        """The engine for images that begin so much farther to the left and above than those of the size given."""
        column, row = self.center(height, width)
        center = (column + columns, row + rows)
        return VaryingPSE(self.scene, self.angles_deg, center, self.n_ghosts(height, width))

    def forward(self, layers: Any) -> Any:
        """Photographs (k, [channel,] h, w) of layers (2, [channel,] h, w)."""
        xp = array_namespace(layers)
        layers = as_floating(layers, xp)
        mixtures, frame = self._like(layers, xp), self._frame(layers)
        planes = frame.extend(layers, xp)
        stokes: list[Any] = [0, 0, 0]
        for k, shift in enumerate(frame.shifts):
            seen = frame.shifted(planes, shift, xp)
            for i in range(3):
                stokes[i] = stokes[i] + mixtures[i, 0, k, ...] * seen[0, ...] + mixtures[i, 1, k, ...] * seen[1, ...]
        return change_basis(self.analyzer, xp.stack(stokes))

    def adjoint(self, intensities: Any) -> Any:
        """Transpose of `forward`."""
        xp = array_namespace(intensities)
        stokes = change_basis(self.analyzer.T, intensities)
        mixtures, frame = self._like(stokes, xp), self._frame(stokes)
        planes = zeros((2, *stokes.shape[1:-2], frame.padded_size), stokes, xp)
        for k, shift in enumerate(frame.shifts):
            shown = [sum(mixtures[i, j, k, ...] * stokes[i, ...] for i in range(3)) for j in range(2)]
            frame.add_shifted_back(xp.stack(shown), shift, planes, xp)
        return frame.fold(planes, xp)

    def components(self, layers: Any) -> Any:
        """The parts of the photographs that come from each layer, (2, k, [channel,] h, w)."""
        xp = array_namespace(layers)
        nothing = xp.zeros_like(layers[0, ...])
        parts = ([layers[0, ...], nothing], [nothing, layers[1, ...]])
        return xp.stack([self.forward(xp.stack(part)) for part in parts])

    def _frame(self, images: Any) -> PaddedFrame:
        height, width = images.shape[-2:]
        return padded_frame(height, width, self.displacements(height, width))

    def _like(self, images: Any, xp: Any) -> Any:
        mixtures = self.ghost_mixtures(*images.shape[-2:])
        device = images.device if is_torch_namespace(xp) else None
        return xp.asarray(mixtures, dtype=images.dtype, device=device)


def ghosts_seen(
    scene: SceneParameters, shape: tuple[int, int], center: tuple[float, float] | None, share: float
) -> int:
    """Ghosts that carry more than `share` of the light somewhere in images of this shape."""
    cosine = scene_angles(scene, *pixel_grid(*shape, _center_of(center, *shape)))[0]
    steepest = interface_images(np.atleast_1d(max(float(cosine.min()), _GRAZING)), scene.refractive_index)[0]
    return min(_MOST_GHOSTS, ghosts_until(float(steepest[:2].max()), share))


def _center_of(center: tuple[float, float] | None, height: int, width: int) -> tuple[float, float]:
    return ((width - 1) / 2, (height - 1) / 2) if center is None else center


@lru_cache(maxsize=4)
def _mixtures(
    scene: SceneParameters, n_ghosts: int, height: int, width: int, center: tuple[float, float]
) -> NDArray[np.float32]:
    x, y = pixel_grid(height, width, center)
    top = _rows_of_mixtures(scene, n_ghosts, x, y[:_ROWS])
    mixtures = np.empty((*top.shape[:3], height, width), dtype=np.float32)
    mixtures[..., :_ROWS, :] = top
    # All ghosts of all rows are much memory, in double precision or twice.
    for row in range(_ROWS, height, _ROWS):
        rows = slice(row, row + _ROWS)
        mixtures[..., rows, :] = _rows_of_mixtures(scene, n_ghosts, x, y[rows])
    return mixtures


def _rows_of_mixtures(scene: SceneParameters, n_ghosts: int, x: Planes, y: Planes) -> NDArray[np.float32]:
    cosine, cos, sin = scene_angles(scene, x, y)
    entries = interface_images(np.maximum(cosine, _GRAZING), scene.refractive_index)
    weights = ghost_line(scene, n_ghosts, entries).weights
    incoming = (scene.transmission_polarization, scene.reflection_polarization)
    mixtures = [
        shown_stokes(np.moveaxis(weight, 1, 0), stokes_vector(*light), cos, sin)
        for weight, light in zip(weights, incoming, strict=True)
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


def shown_stokes(weights: Planes, light: NDArray[np.float64], cos: Planes, sin: Planes) -> Planes:
    """Stokes images (3, n, h, w) of light that passed the pane: into its frame, weighted (3, n, h, w), and back."""
    along, across = cos * light[1] + sin * light[2], cos * light[2] - sin * light[1]
    par, perp = weights[0] * (light[0] + along) / 2, weights[1] * (light[0] - along) / 2
    s1, s2 = par - perp, weights[2] * across
    return np.stack([par + perp, cos * s1 - sin * s2, sin * s1 + cos * s2])
