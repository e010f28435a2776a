"""PSE, the polarization simulation engine: from the two layers to the polarizer photographs, and its adjoint.

With the scene fixed the pane is linear in the layers. Each layer's light is taken apart in the plate's frame into
(I_par, I_perp, s2'), each entry is filtered along one line by a scalar series of ghosts, and a polarizer mixes them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from array_api_compat import array_namespace
from numpy.typing import NDArray

from polaropt.plate import ghost_weights
from polaropt.scene import SceneParameters
from polaropt.shift import shift_image, shift_image_adjoint
from polaropt.stokes import analyzer_matrix, frame_matrix, stokes_vector

TRANSMISSION, REFLECTION = 0, 1


class PSE:
    """Polarization simulation engine of one scene.

    Parameters
    ----------
    scene : SceneParameters
        A complete scene.
    angles_deg : sequence of float
        Polarizer angles of the photographs, in degrees.
    n_ghosts : int, optional
        Ghosts to keep where the scene asks for all; default: as many as carry light. The light of the others is
        added to the last.

    Notes
    -----
    Layers and photographs are numpy arrays or torch tensors; results come back in their dtype and on their device.
    Ghost k is interpolated once, at k times the ghost shift. Layers go on by their edge values beyond the frame.
    """

    def __init__(self, scene: SceneParameters, angles_deg: Sequence[float], n_ghosts: int | None = None) -> None:
        _, azimuth_deg, ghost_shift = scene.values()
        self.scene = scene
        self.angles_deg = tuple(float(angle) for angle in angles_deg)
        self.weights = ghost_weights(scene, n_ghosts)
        azimuth = math.radians(azimuth_deg)
        self.step = (ghost_shift * math.cos(azimuth), -ghost_shift * math.sin(azimuth))
        """(dx, dy): columns to the right and rows down from one ghost to the next."""
        self._to_frame = frame_matrix(azimuth_deg)
        self.mixing: NDArray[np.float64] = analyzer_matrix(angles_deg) @ np.linalg.inv(self._to_frame)
        """(k, 3): photographs from the plate's (I_par, I_perp, s2')."""
        light = np.stack([stokes_vector(*scene.transmission_polarization), stokes_vector(*scene.reflection_polarization)])
        n_entries = 3 if scene.polarized else 2
        entries = light @ self._to_frame.T
        self.taps: NDArray[np.float64] = (self.weights * entries[:, None, :])[..., :n_entries]
        """(2, ghosts + 1, entries): weight of each ghost of each layer in each entry."""

    def forward(self, layers: Any) -> Any:
        """Photographs of two layers whose light has the scene's constant polarization.

        Parameters
        ----------
        layers : array, shape (2, [channel,] h, w)
            [0] transmission, [1] reflection, linear.

        Returns
        -------
        array, shape (k, [channel,] h, w)
        """
        return self._photographs(self.entries(layers))

    def entries(self, layers: Any) -> Any:
        """The mixture in the plate's frame, (I_par, I_perp[, s2']), of layers (2, [channel,] h, w)."""
        xp = array_namespace(layers)
        total = None
        for k, (dx, dy) in enumerate(self._shifts(layers.shape)):
            part = _mix(self.taps[:, k].T, shift_image(layers, dx, dy, xp), xp)
            total = part if total is None else total + part
        return total

    def forward_stokes(self, layers: Any) -> Any:
        """Photographs of two layers that have their own Stokes vector per pixel.

        Parameters
        ----------
        layers : array, shape (2, 3, [channel,] h, w)
            Stokes images (s0, s1, s2) in the camera's frame; the reflection's as an ideal mirror would show it.

        Returns
        -------
        array, shape (k, [channel,] h, w)
        """
        xp = array_namespace(layers)
        light = xp.stack([_mix(self._to_frame, layers[i, ...], xp) for i in (TRANSMISSION, REFLECTION)])
        total = None
        for k, (dx, dy) in enumerate(self._shifts(layers.shape)):
            shifted = shift_image(light, dx, dy, xp)
            weights = xp.asarray(self.weights[:, k], dtype=layers.dtype, device=_device_of(layers, xp))
            part = xp.sum(shifted * xp.reshape(weights, (2, 3) + (1,) * (layers.ndim - 2)), axis=0)
            total = part if total is None else total + part
        return self._photographs(total)

    def adjoint(self, intensities: Any) -> Any:
        """Transpose of `forward`: photographs (k, [channel,] h, w) to layers (2, [channel,] h, w)."""
        xp = array_namespace(intensities)
        return self.entries_adjoint(_mix(self.mixing[:, : self.taps.shape[2]].T, intensities, xp))

    def entries_adjoint(self, entries: Any) -> Any:
        """Transpose of `entries`."""
        xp = array_namespace(entries)
        total = None
        for k, (dx, dy) in enumerate(self._shifts(entries.shape)):
            part = shift_image_adjoint(_mix(self.taps[:, k], entries, xp), dx, dy, xp)
            total = part if total is None else total + part
        return total

    def components(self, layers: Any) -> Any:
        """The parts of the photographs that come from each layer, (2, k, [channel,] h, w)."""
        xp = array_namespace(layers)
        nothing = xp.zeros_like(layers[0, ...])
        only = (xp.stack([layers[0, ...], nothing]), xp.stack([nothing, layers[1, ...]]))
        return xp.stack([self.forward(part) for part in only])

    def _photographs(self, entries: Any) -> Any:
        return _mix(self.mixing[:, : entries.shape[0]], entries, array_namespace(entries))

    def _shifts(self, shape: Sequence[int]) -> list[tuple[float, float]]:
        return [(k * self.step[0], k * self.step[1]) for k in range(self.taps.shape[1])]


def _device_of(x: Any, xp: Any) -> Any:
    return getattr(x, "device", None) if xp.__name__.endswith("torch") else None


def _mix(matrix: NDArray[np.float64], images: Any, xp: Any) -> Any:
    """Matrix product over the first axis of `images`, in their dtype."""
    factors = xp.asarray(np.ascontiguousarray(matrix), dtype=images.dtype, device=_device_of(images, xp))
    flat = xp.reshape(images, (images.shape[0], -1))
    return xp.reshape(factors @ flat, (matrix.shape[0], *images.shape[1:]))
