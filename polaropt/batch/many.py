"""Many captures in memory: one call, in this process or on the workers of a Dask client; Dask arrays along time."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from typing import Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from polaropt.batch.shared_scene import Estimate, SharedScene, combine_scenes
from polaropt.capture import ANGLES_DEG, Capture
from polaropt.errors import InputError
from polaropt.optics import SceneParameters
from polaropt.separation import Separation, estimate, scene_options, separate, separate_at_once
from polaropt.solving import n_at_once, n_values

SHARED = "shared"
_AHEAD = 2
"""Captures for each thread that are on their way to the workers: enough that none waits; set by hand."""

Result = TypeVar("Result")


def separate_many(
    captures: Iterable[Capture] | Any,
    scene: SceneParameters | Literal["shared"] | None = None,
    *,
    client: Any = None,
    angles_deg: Sequence[float] = ANGLES_DEG,
    **options: Any,
) -> Any:
    """`polaropt.separate_many`, which adds what shows the results."""
    if hasattr(captures, "dask"):
        return _of_array(captures, scene, tuple(angles_deg), options)
    return _of_captures(captures, scene, client, options)


def _of_captures(
    captures: Iterable[Capture], scene: SceneParameters | str | None, client: Any, options: dict[str, Any]
) -> Iterator[Separation]:
    if scene == SHARED:
        captures = list(captures)
        if not captures:
            return
        _check_one_size(captures)
        chosen = {**options, **_known(shared_scene_of(captures, client=client, **options))}
    else:
        chosen = {**options, "scene": scene}
    device = chosen.pop("device", None)
    if device is None or client is not None:
        yield from _each(partial(separate, **chosen, device=device), captures, client)
    else:
        yield from _on_device(captures, device, chosen)


def _on_device(captures: Iterable[Capture], device: str, chosen: dict[str, Any]) -> Iterator[Separation]:
    """As many captures of one shape at a time as the device solves together."""
    some: list[Capture] = []
    failures: list[Exception] = []
    for capture in _until_failure(captures, failures):
        if some and (capture.shape != some[0].shape or len(some) >= n_at_once(n_values(capture))):
            yield from _some_at_once(some, device, chosen)
            some = []
        some.append(capture)
    if some:
        yield from _some_at_once(some, device, chosen)
    if failures:
        raise failures[0]


def _until_failure(captures: Iterable[Capture], failures: list[Exception]) -> Iterator[Capture]:
    """Captures until one cannot be had, and why: those before it are on their way, and their results come first."""
    try:
        yield from captures
    except Exception as error:
        failures.append(error)


def _some_at_once(some: list[Capture], device: str, chosen: dict[str, Any]) -> Iterator[Separation]:
    # A large one may be solved in tiles, and a start is a capture's own.
    if len(some) == 1 or chosen.get("start") is not None:
        yield from (separate(capture, device=device, **chosen) for capture in some)
    else:
        chosen = {name: value for name, value in chosen.items() if name != "start"}
        yield from separate_at_once(some, device, **chosen)


def shared_scene_of(captures: Iterable[Capture], *, client: Any = None, **options: Any) -> SharedScene:
    """The scene of captures behind one pane that stands still against the camera, with what each says of it.

    Parameters
    ----------
    captures : iterable of Capture
    client : distributed.Client, optional
        Whose workers estimate. Default: this process.
    **options
        As of `separate`; those of the solve do not matter.
    """
    chosen = scene_options(options)
    return combine_scenes(list(_each(partial(_estimate, **chosen), captures, client)))


def _check_one_size(captures: list[Capture]) -> None:
    """InputError where lengths in pixels of one capture are none of another."""
    height, width = captures[0].shape[-2:]
    for number, capture in enumerate(captures):
        if capture.shape[-2:] != (height, width):
            raise InputError(
                f"capture {number} has {capture.shape[-1]}x{capture.shape[-2]} px, the first {width}x{height}: "
                "share a scene among captures of one size"
            )


def _known(shared: SharedScene) -> dict[str, Any]:
    """Options of `separate` behind a pane that is known; a thickness, which it was found with, no longer counts."""
    return {"scene": shared.scene, "scene_errors": shared.errors, "thickness_px": None}


def _estimate(capture: Capture, **chosen: Any) -> Estimate:
    found = estimate(capture, **chosen)
    return Estimate(found.scene, found.errors)


def _each(work: Callable[[Capture], Result], captures: Iterable[Capture], client: Any) -> Iterator[Result]:
    """What `work` makes of each capture, in their order."""
    if client is None:
        yield from map(work, captures)
        return
    window = max(2, _AHEAD * sum(client.nthreads().values()))
    running: deque[Any] = deque()
    failures: list[Exception] = []
    for capture in _until_failure(captures, failures):
        # Not as an argument: the scheduler would keep every capture.
        sent = client.scatter(capture, direct=True, hash=False)
        running.append(client.submit(work, sent, pure=False))
        del sent
        if len(running) >= window:
            yield client.gather(running.popleft(), direct=True)
    while running:
        yield client.gather(running.popleft(), direct=True)
    if failures:
        raise failures[0]


def _of_array(
    array: Any, scene: SceneParameters | str | None, angles_deg: tuple[float, ...], options: dict[str, Any]
) -> Any:
    import dask
    import dask.array

    shape = array.shape
    if not (array.ndim == 4 or (array.ndim == 5 and shape[-1] == 3)) or shape[1] != len(angles_deg):
        raise InputError(
            f"the array has shape {shape}; give (time, {len(angles_deg)} angles, height, width) or the same with 3 "
            "colours last"
        )
    if not len(array):
        none = np.zeros((0, 2, *shape[2:]), np.float32)
        return dask.array.from_array(none, chunks=none.shape)
    # A capture is solved as a whole.
    whole = array.rechunk(dict.fromkeys(range(1, array.ndim), -1))
    chosen = {**options, "scene": scene}
    if scene == SHARED:
        found = [dask.delayed(_estimates_of)(block, angles_deg, options) for block in whole.to_delayed().ravel()]
        shared = combine_scenes([one for part in dask.compute(*found) for one in part])
        chosen |= _known(shared)
    return dask.array.map_blocks(
        _layers_of,
        whole,
        angles_deg,
        chosen,
        dtype=np.float32,
        chunks=(whole.chunks[0], (2,), *whole.chunks[2:]),
        meta=np.empty((0,) * array.ndim, np.float32),
    )


def _estimates_of(block: NDArray[Any], angles_deg: tuple[float, ...], options: dict[str, Any]) -> list[Estimate]:
    chosen = scene_options(options)
    return [_estimate(Capture(photographs, angles_deg), **chosen) for photographs in block]


def _layers_of(block: NDArray[Any], angles_deg: tuple[float, ...], chosen: dict[str, Any]) -> NDArray[np.float32]:
    """Both layers of photographs along time."""
    layers = []
    for photographs in block:
        result = separate(Capture(photographs, angles_deg), **chosen)
        # The array has no other place for it.
        result.diagnostics.warn()
        layers.append(np.stack([result.transmission, result.reflection]))
    return np.stack(layers)
