"""Steps that a GPU repeats from a recording: their many small operations take longer to ask for than to do."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, TypeVar

import torch
from torch import Tensor

Found = TypeVar("Found")

# Times that a function runs before it is recorded, as torch advises: nothing must be left to choose or make ready.
_WARM_UP = 3


class Recorded(Generic[Found]):
    """A function of tensors that does the same operations each time, and all of them on the GPU.

    Parameters
    ----------
    function : callable
        Takes tensors by name. What it returns, and what it leaves elsewhere, such as gradients, is written over
        by the next call. It is called a few times more than it is asked for.
    """

    def __init__(self, function: Callable[[dict[str, Tensor]], Found]) -> None:
        self._function = function
        self._recording: tuple[torch.cuda.CUDAGraph, dict[str, Tensor], Found] | None = None

    def __call__(self, inputs: dict[str, Tensor]) -> Found:
        """What the function makes of these; shapes and types are those of the first call."""
        if self._recording is None:
            self._recording = self._record(inputs)
        graph, places, found = self._recording
        for name, x in inputs.items():
            places[name].copy_(x)
        graph.replay()
        return found

    def _record(self, inputs: dict[str, Tensor]) -> tuple[torch.cuda.CUDAGraph, dict[str, Tensor], Found]:
        places = {name: x.clone(memory_format=torch.contiguous_format) for name, x in inputs.items()}
        beside = torch.cuda.Stream()  # type: ignore[no-untyped-call]
        beside.wait_stream(torch.cuda.current_stream())
        with torch.cuda.stream(beside):
            for _ in range(_WARM_UP):
                self._function(places)
        torch.cuda.current_stream().wait_stream(beside)
        graph = torch.cuda.CUDAGraph()
        # Other threads may bring samples to the GPU meanwhile.
        with torch.cuda.graph(graph, capture_error_mode="thread_local"):
            found = self._function(places)
        return graph, places, found
