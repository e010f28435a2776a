"""A capture with all that its solve needs: the pane, the canvas, what is known beforehand, the objective."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from polaropt.canvas import Canvas, canvas_for
from polaropt.capture import Capture
from polaropt.closed_form import ClosedForm, natural_image_layers
from polaropt.forward import PSE
from polaropt.objective import Misfit, Term, Weights, build_objective, default_penalties
from polaropt.plate import ghosts_that_matter
from polaropt.preconditioner import FourierPreconditioner
from polaropt.scene import SceneParameters
from polaropt.starts import start_layers

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
    """

    def __init__(
        self, capture: Capture, scene: SceneParameters, noise: float, weights: Weights, robust: bool = False
    ) -> None:
        self.capture, self.scene, self.noise = capture, scene, noise
        self._weights, self._robust = weights, robust
        # Ghosts that drown in the noise cost as much as the others; their light is added to the last one kept.
        self.pse = PSE(scene, capture.angles_deg, n_ghosts=ghosts_that_matter(scene, _GHOST_SHARE * noise))
        self.canvas: Canvas = canvas_for(self.pse, *capture.shape[-2:])
        self.known: ClosedForm = natural_image_layers(capture, self.pse, self.canvas, noise)
        self.penalties = default_penalties(self.known, noise)

    def take_start(self, init: str) -> Images:
        """Canvas layers to start from, by name; what only the start needs of the closed form is given up."""
        start = start_layers(init, self.capture, self.scene, self.canvas, self.known)
        nothing = np.empty(0, dtype=np.float32)
        self.known = replace(self.known, layers=nothing, prior=nothing)
        return start

    def compiled(self, start: Images) -> Coordinates:
        """The objective in compiled passes, in coordinates made for `start` (2, channel, H, W)."""
        from polaropt.fused import FusedObjective, ReadableMisfit
        from polaropt.fused_misfit import FusedMisfit

        parts = (self.capture, self.pse, self.canvas, self.noise)
        misfit = ReadableMisfit(Misfit(*parts, robust=True)) if self._robust else FusedMisfit(*parts)
        return FusedObjective(misfit, self.penalties, self._weights, self.known, self.canvas, start)

    def readable(self, start: Images, device: str | None = None) -> Coordinates:
        """The same in its readable form, on numpy arrays or on torch tensors of a device."""
        from polaropt.fused import assumed_hessian
        from polaropt.whitened import WhitenedObjective, on_device

        place = np.asarray if device is None else on_device(device)
        misfit = Misfit(self.capture, self.pse, self.canvas, self.noise, self._robust, place)
        objective = build_objective(misfit, self.penalties.placed(place), self.canvas, self._weights)
        hessian = assumed_hessian(self.penalties, self._weights, self.known, self.canvas, start)
        known = self.known
        whitened = FourierPreconditioner(hessian, known.mean, known.basis, self.canvas.shape[1], place)
        return WhitenedObjective(objective, whitened, place)

    def misfit_ratio(self, misfit: float) -> float:
        """Mean squared residual in units of the noise, less what the unknowns take up."""
        k = len(self.capture.angles_deg)
        free = max(1.0, float(self.capture.valid.sum()) * (k - 2) / k)
        return 2 * misfit / free


def component_images(pse: PSE, canvas: Canvas, layers: Images) -> Images:
    """The parts of the photographs that come from each layer of the canvas, (2, k, channel, h, w)."""
    # A colour at a time: the engine holds several times its input.
    return np.concatenate([canvas.crop(pse.components(layers[:, c : c + 1])) for c in range(layers.shape[1])], axis=2)
