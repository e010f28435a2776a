"""What is kept of a function's results, and for how long."""

from __future__ import annotations

import gc
import weakref
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from polaropt.numerics import kept_while_alive


class Picture:
    """Something that can be told from its like, as they are all equal."""

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Picture)

    __hash__ = None  # type: ignore[assignment]


def test_results_are_kept_by_the_object_they_were_made_of() -> None:
    asked = []

    @kept_while_alive
    def spectra(of: Picture, angle: float = 0.0) -> list[float]:
        asked.append((of, angle))
        return [angle]

    first, second = Picture(), Picture()
    assert spectra(first, 1.0) is spectra(first, 1.0)
    assert spectra(first, 1.0) is not spectra(second, 1.0)
    assert spectra(first, angle=2.0) == [2.0]
    assert len(asked) == 3


def test_neither_object_nor_result_outlives_the_object() -> None:
    @kept_while_alive
    def result_of(of: Picture) -> np.ndarray:
        return np.zeros(1)

    picture = Picture()
    of_picture, of_result = weakref.ref(picture), weakref.ref(result_of(picture))
    assert of_result() is not None
    del picture
    gc.collect()
    assert of_picture() is None
    assert of_result() is None


def test_only_the_last_results_are_kept() -> None:
    made: list[weakref.ref[np.ndarray]] = []

    @kept_while_alive
    def result_of(of: Picture, number: int) -> np.ndarray:
        result = np.zeros(number)
        made.append(weakref.ref(result))
        return result

    picture = Picture()
    for number in range(20):
        result_of(picture, number)
    assert sum(result() is not None for result in made) == 4
    assert made[-1]() is not None


def test_threads_that_ask_at_once_get_their_own_results() -> None:
    @kept_while_alive
    def doubled(of: Picture, number: int) -> int:
        return 2 * number

    picture = Picture()
    with ThreadPoolExecutor(8) as pool:
        numbers = [k % 11 for k in range(4000)]
        assert list(pool.map(lambda number: doubled(picture, number), numbers)) == [2 * number for number in numbers]
