"""Captures in memory and Dask arrays come out as each alone."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
import pytest

from polaropt import Capture, InputError, ResultWarning, SceneParameters, separate, separate_many, simulate
from polaropt.batch import many

PANE = SceneParameters(60.0, 20.0, 4.0)


def captures(n: int = 3) -> Iterator[Capture]:
    from skimage.data import astronaut, coffee

    for seed in range(n):
        row = 150 + 20 * seed
        behind, before = coffee()[row : row + 64, 200:264], astronaut()[row - 120 : row - 56, 160:224]
        yield simulate(behind, before, PANE, noise=0.005, seed=seed)


def test_each_is_separated_as_alone_and_only_when_asked_for() -> None:
    taken = []

    def watched() -> Iterator[Capture]:
        for i, capture in enumerate(captures()):
            taken.append(i)
            yield capture

    results = separate_many(watched(), PANE)
    first = next(results)
    assert taken == [0]
    np.testing.assert_array_equal(first.layers, separate(next(captures()), PANE).layers)
    assert len(list(results)) == 2


class _Sent:
    """As much of a Dask client as is asked of it; it works when a result is."""

    def nthreads(self) -> dict[str, int]:
        return {"a": 4}

    def scatter(self, capture: Capture, **options: bool) -> Capture:
        return capture

    def submit(self, work: Any, capture: Capture, **options: bool) -> Any:
        return partial(work, capture)

    def gather(self, future: Any, **options: bool) -> Any:
        return future()


@pytest.mark.parametrize("options", [{}, {"client": _Sent()}, {"device": "cpu"}])
def test_results_of_captures_before_one_that_cannot_be_had_come_first(
    options: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(many, "separate", lambda capture, **chosen: capture)
    monkeypatch.setattr(many, "separate_at_once", lambda some, device, **chosen: some)
    taken = list(captures(2))

    def failing() -> Iterator[Capture]:
        yield from taken
        raise OSError("the camera is gone")

    results = many.separate_many(failing(), PANE, **options)
    assert [next(results) for _ in range(2)] == taken
    with pytest.raises(OSError, match="the camera is gone"):
        next(results)


def test_a_shared_scene_is_the_same_for_all() -> None:
    results = list(separate_many(captures(2), "shared", model="ghosts"))
    assert len({result.scene for result in results}) == 1
    assert results[0].errors.incidence_deg is not None


def test_a_shared_scene_is_looked_for_as_it_was_asked() -> None:
    results = list(separate_many(captures(2), "shared", refractive_index=1.33, single_surface=True))
    assert {(result.scene.refractive_index, result.scene.single_surface) for result in results} == {(1.33, True)}


def test_captures_of_other_sizes_share_no_scene_in_memory() -> None:
    light = np.random.default_rng(0).uniform(0.2, 0.8, (4, 40, 32))
    sizes = [Capture(light[:, :side]) for side in (32, 32, 40)]
    with pytest.raises(InputError, match="capture 2 has 32x40 px, the first 32x32"):
        next(separate_many(sizes, scene="shared"))


@pytest.mark.parametrize("color", [False, True])
def test_arrays_along_time(color: bool) -> None:
    array = pytest.importorskip("dask.array")
    frames = [np.moveaxis(capture.intensities, 1, -1) for capture in captures()]
    photographs = np.stack(frames if color else [frame[..., 1] for frame in frames])
    lazy = array.from_array(photographs, chunks=(2, 4, 32, *photographs.shape[3:]))
    layers = separate_many(lazy, PANE)
    assert layers.shape == (3, 2, *photographs.shape[2:])
    assert layers.chunks[0] == (2, 1)
    computed = layers.compute(scheduler="synchronous")
    alone = separate(Capture(photographs[2]), PANE)
    np.testing.assert_array_equal(computed[2], np.stack([alone.transmission, alone.reflection]))


def test_arrays_of_another_shape_are_refused() -> None:
    array = pytest.importorskip("dask.array")
    with pytest.raises(InputError, match="4 angles"):
        separate_many(array.zeros((3, 5, 32, 32)))


def test_frames_of_an_array_that_are_warned_of_warn() -> None:
    array = pytest.importorskip("dask.array")
    grey = np.repeat(np.random.default_rng(0).uniform(0.2, 0.8, (1, 1, 32, 32)), 4, axis=1)
    with pytest.warns(ResultWarning):
        separate_many(array.from_array(grey)).compute(scheduler="synchronous")
