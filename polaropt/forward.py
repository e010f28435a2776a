"""PSE, the polarization simulation engine: from the two layers to the polarizer photographs, and its adjoint.

With the scene fixed the pane is linear in the layers. Each layer's light is taken apart in the plate's frame into
(I_par, I_perp, s2'), each entry is filtered along one line by a scalar series of ghosts, and a polarizer mixes them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from array_api_compat import array_namespace, is_numpy_namespace
from numpy.typing import NDArray

from polaropt.plate import GhostLine, ghost_line
from polaropt.scene import SceneParameters
from polaropt.shift import PaddedFrame, Shift, zeros
from polaropt.stokes import analyzer_matrix, as_floating, change_basis, frame_matrix, stokes_vector

TRANSMISSION, REFLECTION = 0, 1

Weights = NDArray[np.float64]
Displacements = tuple[tuple[float, float], ...]

# Samples that numpy works on at a time: few enough to stay in a core's cache through all ghosts.
_BLOCK = 1 << 15


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
    Where shapes say [channel,] any number of axes may stand, for batches too.
    Ghost k is interpolated once, at k times its layer's shift. Layers go on by their edge values beyond the frame.
    """

    def __init__(self, scene: SceneParameters, angles_deg: Sequence[float], n_ghosts: int | None = None) -> None:
        _, azimuth_deg, _ = scene.values()
        self.scene = scene
        self.angles_deg = tuple(float(angle) for angle in angles_deg)
        line = ghost_line(scene, n_ghosts)
        self.weights = line.weights
        self.displacements = displacements(line, azimuth_deg)
        """(ghosts + 1) times (dx, dy): columns to the right and rows down from the direct image."""
        self._to_frame = frame_matrix(azimuth_deg)
        self.mixing: NDArray[np.float64] = analyzer_matrix(angles_deg) @ np.linalg.inv(self._to_frame)
        """(k, 3): photographs from the plate's (I_par, I_perp, s2')."""
        incoming = (scene.transmission_polarization, scene.reflection_polarization)
        light = np.stack([stokes_vector(dolp, aolp_deg) for dolp, aolp_deg in incoming])
        n_entries = 3 if scene.polarized else 2
        entries = light @ self._to_frame.T
        self.taps: NDArray[np.float64] = (self.weights * entries[:, None, :])[..., :n_entries]
        """(2, ghosts + 1, entries): weight of each ghost of each layer in each entry; ghosts of one layer alone have
        none in the other."""

    def forward(self, layers: Any) -> Any:
        """Photographs of two layers whose light has the scene's constant polarization.

        Parameters
        ----------
        layers : array, shape (2, [channel,] h, w)
            [0] transmission, [1] reflection, linear.

        Returns
        -------
        array, shape (k, [channel,] h, w)

        Raises
        ------
        ValueError
            Another shape.
        """
        return self._photographs(self.entries(layers))

    def entries(self, layers: Any) -> Any:
        """The mixture in the plate's frame, (I_par, I_perp[, s2']), of layers (2, [channel,] h, w)."""
        return self._filtered(layers, self.taps)

    def forward_stokes(self, layers: Any) -> Any:
        """Photographs of two layers that have their own Stokes vector per pixel.

        Parameters
        ----------
        layers : array, shape (2, 3, [channel,] h, w)
            Stokes images (s0, s1, s2) in the camera's frame; the reflection's as an ideal mirror would show it.

        Returns
        -------
        array, shape (k, [channel,] h, w)

        Raises
        ------
        ValueError
            Another shape.
        """
        xp = array_namespace(layers)
        _check_shape("Stokes layers", layers, (2, 3))
        light = xp.stack([change_basis(self._to_frame, layers[i, ...]) for i in (TRANSMISSION, REFLECTION)])
        frame = self._frame(light)
        planes = frame.extend(light, xp)
        return self._photographs(
            xp.stack([_entry(frame, planes[:, i, ...], self.weights[..., i], xp) for i in range(3)])
        )

    def adjoint(self, intensities: Any) -> Any:
        """Transpose of `forward`: photographs (k, [channel,] h, w) to layers (2, [channel,] h, w)."""
        _check_shape("photographs", intensities, (len(self.angles_deg),))
        return self.entries_adjoint(change_basis(self.mixing[:, : self.taps.shape[2]].T, intensities))

    def entries_adjoint(self, entries: Any) -> Any:
        """Transpose of `entries`."""
        xp = array_namespace(entries)
        _check_shape("entries", entries, (self.taps.shape[2],))
        entries = as_floating(entries, xp)
        frame = self._frame(entries)
        planes = zeros((2, *entries.shape[1:-2], frame.padded_size), entries, xp)
        for i in range(entries.shape[0]):
            _add_entry_transposed(frame, frame.spread(entries[i, ...], xp), self.taps[..., i], planes, xp)
        return frame.fold(planes, xp)

    def components(self, layers: Any) -> Any:
        """The parts of the photographs that come from each layer, (2, k, [channel,] h, w)."""
        xp = array_namespace(layers)
        alone = np.eye(2)[:, :, None, None] * self.taps
        return xp.stack([self._photographs(self._filtered(layers, taps)) for taps in alone])

    def _filtered(self, layers: Any, taps: Weights) -> Any:
        xp = array_namespace(layers)
        _check_shape("layers", layers, (2,))
        layers = as_floating(layers, xp)
        frame = self._frame(layers)
        planes = frame.extend(layers, xp)
        return xp.stack([_entry(frame, planes, taps[..., i], xp) for i in range(taps.shape[2])])

    def _photographs(self, entries: Any) -> Any:
        return change_basis(self.mixing[:, : entries.shape[0]], entries)

    def _frame(self, images: Any) -> PaddedFrame:
        height, width = images.shape[-2:]
        return padded_frame(height, width, self.displacements)


def _check_shape(name: str, images: Any, first: tuple[int, ...]) -> None:
    if tuple(images.shape[: len(first)]) != first or len(images.shape) < len(first) + 2:
        expected = ", ".join(map(str, first))
        raise ValueError(f"{name} have shape {tuple(images.shape)}; expected ({expected}, [channel,] height, width)")


def displacements(line: GhostLine, azimuth_deg: float) -> Displacements:
    """Columns to the right and rows down to each image of a line along the azimuth."""
    azimuth = math.radians(azimuth_deg)
    across, down = line.steps * math.cos(azimuth), -line.steps * math.sin(azimuth)
    return tuple(zip((line.orders * across).tolist(), (line.orders * down).tolist(), strict=True))


@lru_cache(maxsize=16)
def padded_frame(height: int, width: int, shifts: Displacements) -> PaddedFrame:
    """The frame that holds all shifts of an engine."""
    return PaddedFrame(height, width, shifts)


def _entry(frame: PaddedFrame, planes: Any, taps: Weights, xp: Any) -> Any:
    """One entry of the mixture (..., h, w): all ghosts of both layers' planes (2, ..., samples)."""
    ghosts = _ghosts_that_show(frame, taps, planes, xp)
    lead = planes.shape[1:-1]
    planes = xp.reshape(planes, (2, -1, planes.shape[-1]))
    parts = []
    for which, start, stop in _blocks(planes.shape[1], 0, frame.size, xp):
        total = None
        for shift, factors in ghosts:
            span = slice(shift.offset + start - frame.reach(shift), shift.offset + stop)
            part = frame.interpolate(_weighted_sum(planes[:, which, span], factors), shift)
            total = part if total is None else _add(total, part)
        parts.append(xp.reshape(total, (-1,)))
    return frame.crop(xp.reshape(xp.concat(parts), (*lead, frame.size)), xp)


def _add_entry_transposed(frame: PaddedFrame, samples: Any, taps: Weights, planes: Any, xp: Any) -> None:
    """Add the transpose of `_entry` to planes (2, ..., samples); `samples` come from `PaddedFrame.spread`."""
    planes = xp.reshape(planes, (2, -1, planes.shape[-1]))
    samples = xp.reshape(samples, (-1, samples.shape[-1]))
    ahead = frame.stride + 1
    for shift, factors in _ghosts_that_show(frame, taps, planes, xp):
        reach = frame.reach(shift)
        for which, start, stop in _blocks(samples.shape[0], -reach, frame.size, xp):
            part = frame.interpolate_transposed(samples[which, ahead + start : ahead + stop + reach], shift)
            for layer, factor in enumerate(factors):
                if factor:
                    planes[layer, which, shift.offset + start : shift.offset + stop] += factor * part


def _ghosts_that_show(frame: PaddedFrame, taps: Weights, like: Any, xp: Any) -> list[tuple[Shift, tuple[float, float]]]:
    """Shifts with the factors of both layers, less what the arrays' precision cannot tell from nothing."""
    least = float(xp.finfo(like.dtype).eps) / 8
    together: dict[Shift, Weights] = {}
    for shift, factors in zip(frame.shifts, taps.T, strict=True):
        together[shift] = together.get(shift, 0.0) + factors
    shown = {shift: np.where(np.abs(factors) > least, factors, 0.0) for shift, factors in together.items()}
    direct = frame.shifts[0]
    return [
        (shift, (shift.scale * float(factors[0]), shift.scale * float(factors[1])))
        for shift, factors in shown.items()
        if factors.any() or shift == direct
    ]


def _blocks(n_planes: int, start: int, stop: int, xp: Any) -> Iterator[tuple[Any, int, int]]:
    """What to work on at a time: planes and a range of samples. Libraries other than numpy take all at once."""
    if not is_numpy_namespace(xp):
        yield slice(None), start, stop
        return
    for plane in range(n_planes):
        for first in range(start, stop, _BLOCK):
            yield plane, first, min(first + _BLOCK, stop)


def _weighted_sum(pair: Any, factors: tuple[float, float]) -> Any:
    if not factors[0]:
        return factors[1] * pair[1, ...]
    if not factors[1]:
        return factors[0] * pair[0, ...]
    return _add(factors[0] * pair[0, ...], factors[1] * pair[1, ...])


def _add(total: Any, part: Any) -> Any:
    total += part
    return total
