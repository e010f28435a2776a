"""PSE, the polarization simulation engine: from the two layers to the polarizer photographs, and its adjoint.

With the scene fixed the pane is linear in the layers. Each layer's light is taken apart in the plate's frame into
(I_par, I_perp, s2'), each entry is filtered along one line by a scalar series of ghosts, and a polarizer mixes them.

Each pixel weighs every ghost by its own incidence, in its own plane of incidence. Ghosts lie side by side along the
azimuth at the middle of the frame, at one distance: how it changes over the frame depends on how far the scenes are.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from array_api_compat import array_namespace, is_numpy_namespace, is_torch_namespace
from numpy.typing import NDArray

from polaropt.errors import InputError
from polaropt.optics.geometry import pixel_grid, scene_angles
from polaropt.optics.plate import double_images, ghosts_that_matter, ghosts_until, images_that_show, plate_images
from polaropt.optics.scene import SceneParameters
from polaropt.optics.shift import PaddedFrame, Shift, zeros
from polaropt.optics.stokes import analyzer_matrix, as_floating, change_basis, frame_matrix, stokes_vector

TRANSMISSION, REFLECTION = 0, 1

Weights = NDArray[np.float64]
Displacements = tuple[tuple[float, float], ...]

# Samples that numpy works on at a time: few enough to stay in a core's cache through all ghosts. By trial.
_BLOCK = 1 << 15
# Weight that cannot be told from nothing, in units of a type's precision: well below half a unit in the last place of
# the direct image, which is at most 1.
_NOTHING = 1 / 8


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

    Examples
    --------
    Photographs of white in both layers: a lossless pane passes what it does not mirror, so that every photograph is
    half as bright, whatever the pane.

    >>> import numpy as np
    >>> from polaropt import PSE, SceneParameters
    >>> engine = PSE(SceneParameters(60.0, 20.0, 4.0), (0, 45, 90, 135))
    >>> photographs = engine.forward(np.ones((2, 32, 48)))
    >>> photographs.shape, bool(np.allclose(photographs, 0.5))
    ((4, 32, 48), True)

    `adjoint` is the transpose of `forward`:

    >>> random = np.random.default_rng(0)
    >>> layers, images = random.random((2, 32, 48)), random.random((4, 32, 48))
    >>> bool(np.isclose(np.vdot(engine.forward(layers), images), np.vdot(layers, engine.adjoint(images))))
    True
    """

    def __init__(self, scene: SceneParameters, angles_deg: Sequence[float], n_ghosts: int | None = None) -> None:
        if not isinstance(scene, SceneParameters):
            raise InputError(f"scene is a {type(scene).__name__}; give SceneParameters")
        _, azimuth_deg, _ = scene.values()
        self.scene = scene
        try:
            self.angles_deg = tuple(float(angle) for angle in angles_deg)
        except (TypeError, ValueError):
            raise InputError(f"{angles_deg!r} are no polarizer angles; give numbers in degrees") from None
        images = double_images(scene, n_ghosts)
        self.weights = images.weights
        self.n_ghosts = int(images.orders.max())
        """Ghosts of each layer that are kept."""
        self.displacements: Displacements = images.places
        """(ghosts + 1) times (dx, dy): columns to the right and rows down from the direct image."""
        self._to_frame = frame_matrix(azimuth_deg)
        self.mixing: NDArray[np.float64] = analyzer_matrix(self.angles_deg) @ np.linalg.inv(self._to_frame)
        """(k, 3): photographs from the plate's (I_par, I_perp, s2')."""
        incoming = (scene.transmission_polarization, scene.reflection_polarization)
        light = np.stack([stokes_vector(dolp, aolp_deg) for dolp, aolp_deg in incoming])
        n_entries = 3 if scene.polarized else 2
        entries = light @ self._to_frame.T
        self.taps: NDArray[np.float64] = (self.weights * entries[:, None, :])[..., :n_entries]
        """(2, ghosts + 1, entries): weight of each ghost of each layer in each entry; ghosts of one layer alone have
        none in the other."""

    def distinct_images(self, height: int, width: int) -> tuple[Displacements, Weights]:
        """Places and weights (2, image, entry) of the images that frames of this size tell apart in single precision.

        Those farther off than the frame is long show its edge alone, wherever they are; near grazing incidence there
        are thousands, which carry next to no light.
        """
        together: dict[tuple[float, float], Weights] = {}
        for (across, down), taps in zip(self.displacements, self.taps.swapaxes(0, 1), strict=True):
            place = (max(1.0 - width, min(across, width - 1.0)), max(1.0 - height, min(down, height - 1.0)))
            together[place] = together[place] + taps if place in together else taps
        places, weights = tuple(together), np.stack(list(together.values()), axis=1)
        shown = np.abs(weights).max(axis=(0, 2)) > _NOTHING * float(np.finfo(np.float32).eps)
        shown[0] = True
        return tuple(place for place, told in zip(places, shown, strict=True) if told), weights[:, shown]

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
    least = _NOTHING * float(xp.finfo(like.dtype).eps)
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


Planes = NDArray[np.float64]

# Cosine of the steepest incidence that is told apart from grazing, 89.94 degrees. Set by hand.
_GRAZING = 1e-3
# Ghosts fainter than this share of the light everywhere are added to the last one kept, and those beyond so many: only
# from 88 degrees on do they show. Set by hand; each costs a plane of weights per layer and Stokes component.
_FAINT = 1e-5
_MOST_VARYING_GHOSTS = 48
# Rows of weights that are worked out at a time, which bounds the memory. By trial.
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
        return double_images(self.scene, self.n_ghosts(height, width)).places

    def n_ghosts(self, height: int, width: int) -> int:
        """Ghosts of each layer that are kept in images of this size."""
        if self._n_ghosts is not None or not self.scene.has_ghosts:
            return 1 if self._n_ghosts is None else self._n_ghosts
        return ghosts_that_show(self.scene, (height, width), self._center, _FAINT)

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


def ghosts_that_show(
    scene: SceneParameters, shape: tuple[int, int], center: tuple[float, float] | None, share: float
) -> int:
    """Ghosts that carry more than `share` of the light somewhere in images of this shape."""
    if scene.stacked:
        return min(_MOST_VARYING_GHOSTS, images_that_show(scene, share))
    cosine = scene_angles(scene, *pixel_grid(*shape, _center_of(center, *shape)))[0]
    steepest = plate_images(np.atleast_1d(max(float(cosine.min()), _GRAZING)), scene)
    return min(_MOST_VARYING_GHOSTS, ghosts_until(float(steepest.rho[:2].max()), share))


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
    weights = double_images(scene, n_ghosts, np.maximum(cosine, _GRAZING)).weights
    incoming = (scene.transmission_polarization, scene.reflection_polarization)
    mixtures = [
        shown_stokes(np.moveaxis(weight, 1, 0), stokes_vector(*light), cos, sin)
        for weight, light in zip(weights, incoming, strict=True)
    ]
    return np.stack(mixtures, axis=1).astype(np.float32)


def shown_stokes(weights: Planes, light: NDArray[np.float64], cos: Planes, sin: Planes) -> Planes:
    """Stokes images (3, n, h, w) of light that passed the pane: into its frame, weighted (3, n, h, w), and back."""
    along, across = cos * light[1] + sin * light[2], cos * light[2] - sin * light[1]
    par, perp = weights[0] * (light[0] + along) / 2, weights[1] * (light[0] - along) / 2
    s1, s2 = par - perp, weights[2] * across
    return np.stack([par + perp, cos * s1 - sin * s2, sin * s1 + cos * s2])


# A ghost shows if it carries more than this share of the noise where the light is white. Set by hand.
_GHOST_SHARE = 0.3


def engine_for(
    scene: SceneParameters,
    angles_deg: Sequence[float],
    noise: float,
    shape: tuple[int, ...],
    center: tuple[float, float] | None = None,
) -> PSE | VaryingPSE:
    """The engine that a scene needs, for images of the frame's size (h, w)."""
    kept = bounces_that_show(scene, noise, shape, center)
    return VaryingPSE(scene, angles_deg, center, kept) if scene.varies else PSE(scene, angles_deg, n_ghosts=kept)


def bounces_that_show(
    scene: SceneParameters, noise: float, shape: tuple[int, ...], center: tuple[float, float] | None = None
) -> int:
    """Bounces that stand out of the noise somewhere in a frame (h, w); parameters as for `engine_for`.

    Those that drown cost as much as the others; their light is added to the last one kept.
    """
    share = _GHOST_SHARE * noise
    if scene.stacked and not scene.varies:
        return images_that_show(scene, share) if scene.has_ghosts else 0
    if not scene.varies:
        return ghosts_that_matter(scene, share)
    return ghosts_that_show(scene, (shape[0], shape[1]), center, share) if scene.has_ghosts else 1


def vertical_reach(engine: PSE | VaryingPSE, height: int, width: int) -> int:
    """Rows above and below that any row of images of this size takes light from: by ghosts, and interpolation."""
    shifts = engine.displacements(height, width) if isinstance(engine, VaryingPSE) else engine.displacements
    return 1 + math.ceil(max(abs(down) for _, down in shifts))
