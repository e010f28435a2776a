"""The readable objective as a function of whitened coordinates, on numpy arrays or on torch tensors."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from array_api_compat import array_namespace, is_torch_namespace
from numpy.typing import NDArray

from polaropt.inversion import FourierPreconditioner
from polaropt.solving.objective import Objective, Term

Images = NDArray[np.float32]
Place = Callable[[NDArray[Any]], Any]


class WhitenedObjective:
    """The counterpart of `polaropt.solving.compiled.FusedObjective` that is meant to be read, and that runs on a GPU.

    Parameters
    ----------
    objective : Objective
    preconditioner : FourierPreconditioner
    place : callable, optional
        Turns numpy arrays into those that the two were made with, such as tensors on a device.
    """

    def __init__(self, objective: Objective, preconditioner: FourierPreconditioner, place: Place = np.asarray) -> None:
        self._objective, self._whitened, self._place = objective, preconditioner, place

    @property
    def misfit(self) -> float:
        """Raw misfit at the last evaluation; infinite before the first."""
        return self._objective.misfit

    def coordinates(self, layers: Images) -> Any:
        """Coordinates of canvas layers, on the device."""
        return self._whitened.coordinates(self._place(layers))

    def value_and_grad(self, z: Any) -> tuple[float, Any]:
        """Value (float64) and gradient (float32) at coordinates z."""
        value, gradient = self._objective.value_and_grad(self._whitened.layers(z))
        return value, self._whitened.gradient(gradient)

    def solution(self, z: Any) -> tuple[Images, dict[str, Term]]:
        """Canvas layers (2, channel, H, W) at z as a numpy array, and the terms."""
        layers = self._whitened.layers(self._place(z) if isinstance(z, np.ndarray) else z)
        there = is_torch_namespace(array_namespace(layers))
        return np.asarray(layers.cpu() if there else layers), self._objective.terms(layers)


def on_device(device: str) -> Place:
    """What turns numpy arrays into tensors on a device.

    Parameters
    ----------
    device : str
        As torch names it: "cpu", "cuda", "cuda:1".
    """
    import torch

    def place(array: NDArray[Any]) -> Any:
        return torch.from_numpy(np.ascontiguousarray(array)).to(device)

    return place
