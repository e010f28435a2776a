"""Settings for the whole suite."""

from __future__ import annotations

import gc
import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings

# Threads that wait actively take forever where cores are shared, and the images here are small. Before numpy and torch.
os.environ.setdefault("OMP_NUM_THREADS", "1")

# The machines that run this are slow at times; a deadline would fail for no reason. The same examples every time.
settings.register_profile("polaropt", deadline=None, derandomize=True, max_examples=60, database=None)
settings.load_profile("polaropt")

# What is imported stays: to look through it for garbage, again and again, takes seconds.
gc.disable()


def pytest_collection_finish() -> None:
    """Look for garbage of tests alone."""
    gc.freeze()
    gc.enable()


@pytest.fixture(scope="session")
def photographs(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Four files of a small colour capture: 65 degrees, azimuth 30, ghosts 4 px apart."""
    return _photographed(tmp_path_factory.mktemp("photographs"), 96)


@pytest.fixture(scope="session")
def small_photographs(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """The same of frames that are too small to find much in, for what is not about that."""
    return _photographed(tmp_path_factory.mktemp("small_photographs"), 48)


def _photographed(folder: Path, side: int) -> list[str]:
    from skimage import data

    from polaropt.capture.files.write import write_png
    from polaropt.cli.app import main

    write_png(folder / "behind.png", data.coffee()[150 : 150 + side, 200 : 200 + side])
    write_png(folder / "mirrored.png", data.astronaut()[30 : 30 + side, 160 : 160 + side])
    pair = [str(folder / "behind.png"), str(folder / "mirrored.png")]
    assert main(["simulate", *pair, "--incidence", "65", "--azimuth", "30", "--shift", "4", "-o", str(folder)]) == 0
    return [str(folder / f"capture_{angle}.png") for angle in ("000", "045", "090", "135")]


@pytest.fixture
def heard_keys() -> Iterator[None]:
    """Ctrl-C interrupts, as it does but for what a shell has started in its background."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)
