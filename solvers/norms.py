"""Norms of gradients without a copy in float64."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

# BLAS works on rows of this length in one thread.
_ROW = 8192
# Squares between these are held by float32 with all their digits.
_SMALL, _LARGE = 1e-24, 1e30


@dataclass(frozen=True)
class Norms:
    """How to measure a gradient, of whatever kind of array."""

    euclidean: Callable[[Any], float]
    """Not finite where an entry is not."""
    largest: Callable[[Any], float]
    """The largest absolute entry."""


def euclidean(gradient: NDArray[Any]) -> float:
    """Euclidean norm: rows in the array's own precision, their sum in float64."""
    flat = gradient.ravel()
    whole = flat.size // _ROW * _ROW
    rows, rest = flat[:whole].reshape(-1, _ROW), flat[whole:]
    with np.errstate(all="ignore"):
        square = float(np.vecdot(rows, rows).sum(dtype=np.float64)) + float(np.dot(rest, rest))
    if not _SMALL < square < _LARGE:
        # Zero, overflow, underflow or not finite: once more, carefully.
        square = sum(_square(flat[start : start + _ROW]) for start in range(0, flat.size, _ROW))
    return math.sqrt(square)


def _square(part: NDArray[Any]) -> float:
    with np.errstate(all="ignore"):
        return float(np.square(part, dtype=np.float64).sum())


def distance(a: NDArray[Any], b: NDArray[Any]) -> float:
    """Euclidean distance of two points, part by part."""
    parts = (slice(start, start + _ROW) for start in range(0, a.size, _ROW))
    return math.sqrt(sum(_square(a[part].astype(np.float64) - b[part]) for part in parts))


def largest(gradient: NDArray[Any]) -> float:
    """Largest absolute entry; 0 where there is none."""
    return max(float(gradient.max(initial=0)), -float(gradient.min(initial=0)))


NUMPY = Norms(euclidean, largest)
