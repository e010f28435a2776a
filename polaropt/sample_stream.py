"""Samples made ahead in processes of their own, given in the order of their numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

_AHEAD = 8


def in_processes(sample: Callable[[int], Any], numbers: range, workers: int) -> Iterator[Any]:
    """What `sample` makes of each number, in their order.

    Parameters
    ----------
    sample : callable
        Sent to every process.
    numbers : range
    workers : int
        Processes; each works up to 8 samples ahead.
    """
    from torch.utils.data import DataLoader

    loader: DataLoader[Any] = DataLoader(
        _Numbered(sample),  # type: ignore[arg-type]
        batch_size=None,
        sampler=numbers,
        num_workers=workers,
        prefetch_factor=_AHEAD,
        collate_fn=_as_it_is,
        worker_init_fn=_one_thread,
        # A process with threads of its own, or with a GPU, must not be forked.
        multiprocessing_context="spawn",
    )
    return iter(loader)


class _Numbered:
    """What torch's loader asks for its items."""

    def __init__(self, sample: Callable[[int], Any]) -> None:
        self._sample = sample

    def __getitem__(self, number: int) -> Any:
        return self._sample(number)


def _as_it_is(sample: Any) -> Any:
    return sample


def _one_thread(_: int) -> None:
    """Torch sees to its own threads."""
    import numba

    numba.set_num_threads(1)
