"""PNGs of large pictures are made some rows at a time, and are those of small ones."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import imagecodecs
import numpy as np
import pytest
from PIL import Image

from polaropt.capture import CameraFacts, write_capture, write_picture, write_png, write_png_view
from polaropt.capture.files import write
from polaropt.numerics import MUCH_VALUES, arrays_apart
from tests.captured import photographed


def chunks(file: Path) -> list[bytes]:
    """Names of a PNG's chunks, each once."""
    data, at, names = file.read_bytes(), 8, []
    while at < len(data):
        names.append(data[at + 4 : at + 8])
        at += 12 + int.from_bytes(data[at : at + 4], "big")
    return list(dict.fromkeys(names))


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("shape", [(1, 1), (64, 50), (129, 70, 3)])
def test_it_is_the_same_picture(
    shape: tuple[int, ...], dtype: type, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pixels = np.random.default_rng(0).integers(0, np.iinfo(dtype).max + 1, shape).astype(dtype)
    facts = CameraFacts(exif=b"MM\0*\0\0\0\10\0\0\0\0\0\0")
    write_png(tmp_path / "small.png", pixels)
    write_picture(tmp_path / "small_picture.png", pixels, facts, "note")
    monkeypatch.setattr(write, "_LARGE_PNG", 0)
    write_png(tmp_path / "large.png", pixels)
    write_picture(tmp_path / "large_picture.png", pixels, facts, "note")
    for name in ("large.png", "large_picture.png"):
        read = imagecodecs.png_decode((tmp_path / name).read_bytes())
        assert read.dtype == dtype
        np.testing.assert_array_equal(read, pixels)
        with Image.open(tmp_path / name) as picture:
            picture.verify()
    assert chunks(tmp_path / "large.png") == chunks(tmp_path / "small.png")
    assert chunks(tmp_path / "large_picture.png") == chunks(tmp_path / "small_picture.png")


def test_views_and_captures_are_written_without_all_of_their_pixels(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    layer = np.random.default_rng(0).uniform(0, 1, (3, 3000, 400)).astype(np.float32)
    capture = photographed((600, 700))
    write_png_view(tmp_path / "small.png", layer, 0.7)
    small = write_capture(capture, tmp_path / "small_capture.png")
    monkeypatch.setattr(write, "_LARGE_PNG", 0)
    write_png_view(tmp_path / "warm.png", layer[:, :64])
    tracemalloc.start()
    write_png_view(tmp_path / "large.png", layer, 0.7)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < layer.size
    files = [tmp_path / "small.png", *small]
    for one, other in zip(files, [tmp_path / "large.png", *write_capture(capture, tmp_path / "c.png")], strict=True):
        pixels = [imagecodecs.png_decode(file.read_bytes()) for file in (one, other)]
        np.testing.assert_array_equal(*pixels)


def test_arrays_lie_apart_only_where_memory_is_scarce(monkeypatch: pytest.MonkeyPatch) -> None:
    from polaropt.numerics import memory

    asked = []
    monkeypatch.setattr(memory, "_lie_apart_from", asked.append)
    with arrays_apart(needed=False):
        pass
    assert asked == []
    with pytest.raises(KeyError), arrays_apart():
        raise KeyError
    assert asked == [2**20, 2**25]
    assert MUCH_VALUES < 2 * 3 * 24e6
