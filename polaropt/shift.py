"""Bilinear shifts along image axes, continued by the edge values, and their exact adjoints.

One code for numpy arrays and torch tensors: `xp` is the array's namespace (array API standard).
"""

from __future__ import annotations

import math
from typing import Any


def shift_image(x: Any, dx: float, dy: float, xp: Any) -> Any:
    """Shift images (..., h, w) by `dx` columns to the right and `dy` rows down, bilinearly."""
    return _shift_axis(_shift_axis(x, dy, -2, xp), dx, -1, xp)


def shift_image_adjoint(y: Any, dx: float, dy: float, xp: Any) -> Any:
    """Transpose of `shift_image`."""
    return _shift_axis_adjoint(_shift_axis_adjoint(y, dx, -1, xp), dy, -2, xp)


def _part(axis: int, start: int | None, stop: int | None) -> tuple[Any, ...]:
    return (..., slice(start, stop)) if axis == -1 else (..., slice(start, stop), slice(None))


def _shift_axis(x: Any, distance: float, axis: int, xp: Any) -> Any:
    whole = math.floor(distance)
    fraction = distance - whole
    n = x.shape[axis]
    if fraction == 0:
        return x if whole == 0 else _continued(x, whole, n, axis, xp)
    longer = _continued(x, whole + 1, n + 1, axis, xp)
    return (1 - fraction) * longer[_part(axis, 1, None)] + fraction * longer[_part(axis, None, -1)]


def _shift_axis_adjoint(y: Any, distance: float, axis: int, xp: Any) -> Any:
    whole = math.floor(distance)
    fraction = distance - whole
    n = y.shape[axis]
    if fraction == 0:
        return y if whole == 0 else _continued_adjoint(y, whole, n, axis, xp)
    shape = list(y.shape)
    shape[axis] = n + 1
    longer = xp.zeros(tuple(shape), dtype=y.dtype, device=_device(y, xp))
    longer[_part(axis, 1, None)] += (1 - fraction) * y
    longer[_part(axis, None, -1)] += fraction * y
    return _continued_adjoint(longer, whole + 1, n, axis, xp)


def _spans(lead: int, n: int, m: int) -> tuple[int, int, int]:
    """How m samples ``x[clamp(i - lead)]`` divide: copies of the first, samples of x itself, where those start."""
    first = min(max(lead, 0), m)
    last = min(max(m - n - lead, 0), m)
    return first, max(m - first - last, 0), max(-lead, 0)


def _continued(x: Any, lead: int, m: int, axis: int, xp: Any) -> Any:
    """Samples ``x[clamp(i - lead)]`` for i = 0..m-1."""
    n = x.shape[axis]
    first, inside, start = _spans(lead, n, m)
    shape = list(x.shape)
    parts = []
    if first:
        shape[axis] = first
        parts.append(xp.broadcast_to(x[_part(axis, 0, 1)], tuple(shape)))
    if inside:
        parts.append(x[_part(axis, start, start + inside)])
    if first + inside < m:
        shape[axis] = m - first - inside
        parts.append(xp.broadcast_to(x[_part(axis, n - 1, n)], tuple(shape)))
    return parts[0] if len(parts) == 1 else xp.concat(parts, axis=axis)


def _continued_adjoint(y: Any, lead: int, n: int, axis: int, xp: Any) -> Any:
    m = y.shape[axis]
    first, inside, start = _spans(lead, n, m)
    shape = list(y.shape)
    shape[axis] = n
    out = xp.zeros(tuple(shape), dtype=y.dtype, device=_device(y, xp))
    out[_part(axis, start, start + inside)] = y[_part(axis, first, first + inside)]
    if first:
        out[_part(axis, 0, 1)] += xp.sum(y[_part(axis, 0, first)], axis=axis, keepdims=True)
    if first + inside < m:
        out[_part(axis, n - 1, n)] += xp.sum(y[_part(axis, first + inside, m)], axis=axis, keepdims=True)
    return out


def _device(x: Any, xp: Any) -> Any:
    return getattr(x, "device", None) if xp.__name__.endswith("torch") else None
