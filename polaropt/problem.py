"""A capture with all that its solve needs: the pane, the canvas, what is known beforehand, the objective."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from polaropt.canvas import Canvas, canvas_for
from polaropt.capture import Capture
from polaropt.closed_form import ClosedForm, natural_image_layers
from polaropt.forward import PSE
from polaropt.noise_model import NoiseClasses, NoiseModel, noise_classes
from polaropt.objective import Misfit, Term, Weights, build_objective, default_penalties
from polaropt.plate import ghosts_that_matter
from polaropt.preconditioner import FourierPreconditioner
from polaropt.scene import SceneParameters
from polaropt.starts import start_layers
from polaropt.varying import VaryingPSE

if TYPE_CHECKING:
    from polaropt.fused import MisfitInPlace

Images = NDArray[np.float32]

# A ghost shows if it carries more than this share of the noise where the light is white.
_GHOST_SHARE = 0.3


class Coordinates(Protocol):
    """An objective of a flat vector, with the way from layers to the vector and back."""

    def coordinates(self, layers: Images) -> Any:
        """Coordinates of canvas layers."""

    def value_and_grad(self, z: Any) -> tuple[float, Any]:
        """Value and gradient at coordinates z."""

    def solution(self, z: Any) -> tuple[Images, dict[str, Term]]:
        """Canvas layers at coordinates z, and raw value and weight of every term."""


class Problem:
    """One separation to be solved.

    Parameters
    ----------
    capture : Capture
    scene : SceneParameters
        A complete scene.
    noise : float
    weights : Weights
    robust : bool
        Residuals beyond 3 sigma count linearly.
    center : (float, float), optional
        Column and row of the camera's principal point. Default: the middle of the frame.
    growth : NoiseModel, optional
        How the noise grows with the light. Default: it is the same everywhere.
    """

    def __init__(
        self,
        capture: Capture,
        scene: SceneParameters,
        noise: float,
        weights: Weights,
        robust: bool = False,
        center: tuple[float, float] | None = None,
        *,
        growth: NoiseModel | None = None,
    ) -> None:
        classes = None if growth is None else noise_classes(capture, growth)
        self.noise = noise if classes is None else classes.typical
        self._pixel_noise: float | NoiseClasses = noise if classes is None else classes
        self.capture, self.scene = capture, scene
        self._weights, self._robust = weights, robust
        self.pse = engine_for(scene, capture.angles_deg, noise, center)
        self.canvas: Canvas = canvas_for(self.pse, *capture.shape[-2:])
        self.known: ClosedForm = self._closed_form()
        self.penalties = default_penalties(self.known, noise)

    def _closed_form(self) -> ClosedForm:
        if isinstance(self.pse, PSE):
            return natural_image_layers(self.capture, self.pse, self.canvas, self.noise)
        from polaropt.varying_closed_form import varying_layers

        return varying_layers(self.capture, self.pse, self.canvas, self.noise)

    def take_start(self, init: str) -> Images:
        """Canvas layers to start from, by name; what only the start needs of the closed form is given up."""
        start = start_layers(init, self.capture, self.pse, self.canvas, self.known)
        nothing = np.empty(0, dtype=np.float32)
        self.known = replace(self.known, layers=nothing, prior=nothing)
        return start

    def compiled(self, start: Images) -> Coordinates:
        """The objective in compiled passes, in coordinates made for `start` (2, channel, H, W)."""
        from polaropt.fused import FusedObjective

        return FusedObjective(self._compiled_misfit(), self.penalties, self._weights, self.known, self.canvas, start)

    def _compiled_misfit(self) -> MisfitInPlace:
        from polaropt.fused import ReadableMisfit
        from polaropt.fused_misfit import FusedMisfit, FusedVaryingMisfit

        if self._robust:
            return ReadableMisfit(Misfit(self.capture, self._on_canvas(), self.canvas, self._pixel_noise, robust=True))
        if isinstance(self.pse, PSE):
            return FusedMisfit(self.capture, self.pse, self.canvas, self._pixel_noise)
        return FusedVaryingMisfit(self.capture, self.pse, self.canvas, self._pixel_noise)

    def _on_canvas(self) -> PSE | VaryingPSE:
        """The engine for images of the canvas's size."""
        if isinstance(self.pse, PSE):
            return self.pse
        column, row = self.pse.center(self.canvas.height, self.canvas.width)
        center = (column + self.canvas.left, row + self.canvas.top)
        return VaryingPSE(self.scene, self.capture.angles_deg, center)

    def readable(self, start: Images, device: str | None = None) -> Coordinates:
        """The same in its readable form, on numpy arrays or on torch tensors of a device."""
        from polaropt.fused import assumed_hessian
        from polaropt.fused_penalties import FusedPenalties
        from polaropt.whitened import WhitenedObjective, on_device

        place = np.asarray if device is None else on_device(device)
        misfit = Misfit(self.capture, self._on_canvas(), self.canvas, self._pixel_noise, self._robust, place)
        objective = build_objective(misfit, self.penalties.placed(place), self.canvas, self._weights)
        known, natural = self.known, self.penalties.natural_image
        local = FusedPenalties(self.penalties, self.canvas, start.shape[1])
        hessian = assumed_hessian(local, natural, self._weights, known, start)
        whitened = FourierPreconditioner(hessian, known.mean, known.basis, self.canvas.shape[1], place)
        return WhitenedObjective(objective, whitened, place)

    def misfit_ratio(self, misfit: float) -> float:
        """Mean squared residual in units of the noise, less what the unknowns take up."""
        k = len(self.capture.angles_deg)
        free = max(1.0, float(self.capture.valid.sum()) * (k - 2) / k)
        return 2 * misfit / free


def engine_for(
    scene: SceneParameters,
    angles_deg: Sequence[float],
    noise: float,
    center: tuple[float, float] | None = None,
) -> PSE | VaryingPSE:
    """The engine that a scene needs, for images of the frame's size."""
    if scene.varies:
        return VaryingPSE(scene, angles_deg, center)
    # Ghosts that drown in the noise cost as much as the others; their light is added to the last one kept.
    return PSE(scene, angles_deg, n_ghosts=ghosts_that_matter(scene, _GHOST_SHARE * noise))


def component_images(pse: PSE | VaryingPSE, canvas: Canvas, layers: Images) -> Images:
    """The parts of the photographs that come from each layer of the canvas, (2, k, channel, h, w)."""
    if isinstance(pse, VaryingPSE):
        components: Images = pse.components(np.ascontiguousarray(canvas.crop(layers)))
        return components
    # A colour at a time: the engine holds several times its input.
    return np.concatenate([canvas.crop(pse.components(layers[:, c : c + 1])) for c in range(layers.shape[1])], axis=2)
