"""Python: what is of a wrong type, or beyond what float32 holds, is refused in a line before anything is worked out."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from polaropt import (
    PSE,
    Capture,
    InputError,
    SceneParameters,
    StoppingRule,
    read_capture,
    separate,
    separate_many,
    separate_sequence,
    simulate,
)
from tests.captured import photographed

PANE = SceneParameters(60.0, 20.0, 3.0)
GREY = np.full((32, 32), 0.5)
ANY: Any = None


def hot(value: float) -> np.ndarray:
    """The usual photographs, of which one has a pixel that stands for nothing."""
    images = photographed((32, 32)).intensities.copy()
    images[1, 5, 5] = value
    return images


def separated(**options: Any) -> Any:
    return separate(photographed((32, 32)), PANE, stopping=StoppingRule(max_evaluations=1), **options)


WRONG: dict[str, tuple[Callable[[], Any], str]] = {
    "a pixel beyond any light": (lambda: Capture(hot(1e30)), "values up to 1e"),
    "one that is not trusted": (lambda: Capture(hot(3e38), valid=hot(0) > 0), "trusted or not"),
    "doubles beyond single precision": (lambda: Capture(np.full((4, 32, 32), 1e300)), "values up to 1e"),
    "nothing, masked": (lambda: Capture(np.ma.masked), "have shape"),
    "a layer of NaN": (lambda: simulate(GREY, math.nan * GREY, PANE), "NaN"),
    "a layer beyond any light": (lambda: simulate(1e30 * GREY, GREY, PANE), "white is 1"),
    "a layer without pixels": (lambda: simulate(GREY[:0], GREY[:0], PANE), "no pixels"),
    "a layer of texts": (lambda: simulate(GREY.astype(str), GREY, PANE), "real numbers"),
    "noise": (lambda: simulate(GREY, GREY, PANE, noise=ANY), "noise is None"),
    "a truth for a number": (lambda: PANE.replace(ghost_shift=True), "ghost_shift is True"),
    "scaled by nothing": (lambda: PANE.scaled(0), "factor is 0"),
    "scaled by a text": (lambda: PANE.scaled("2"), "factor is '2'"),  # type: ignore[arg-type]
    "scene of an engine": (lambda: PSE(3, (0, 45, 90, 135)), "scene is a int"),  # type: ignore[arg-type]
    "angles of an engine": (lambda: PSE(PANE, 3), "no polarizer angles"),  # type: ignore[arg-type]
    "captures": (lambda: next(separate_many(3)), "captures is a int"),  # type: ignore[call-overload]
    "frames": (lambda: next(separate_sequence(3)), "captures is a int"),  # type: ignore[arg-type]
    "progress": (lambda: separate_many([photographed((32, 32))], progress=3), "progress is a int"),
    "device": (lambda: separated(device=np.zeros(2)), "device is"),
    "exposures": (lambda: read_capture("glass.png", exposures=3.0), "exposures are 3"),  # type: ignore[arg-type]
    "folder": (lambda: separated().save(3), "no path"),
}


@pytest.mark.filterwarnings("error", "ignore::polaropt.ResultWarning")
@pytest.mark.parametrize("name", WRONG)
def test_wrong_values_are_refused_in_a_line(name: str) -> None:
    call, told = WRONG[name]
    with pytest.raises(InputError, match=told) as refused:
        list(call())
    assert str(refused.value).isprintable()


def test_whole_numbers_that_are_floats_do() -> None:
    layers = hot(0)[0], hot(0)[2]
    seeds: tuple[Any, ...] = (3, 3.0)
    one, other = (simulate(*layers, PANE, noise=0.01, seed=seed).intensities for seed in seeds)
    np.testing.assert_array_equal(one, other)
