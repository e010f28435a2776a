"""Files that ask for too much memory or time, or print: one line, and soon."""

from __future__ import annotations

import io
import logging
import os
import struct
import subprocess
import sys
import threading
import time
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import imagecodecs
import numpy as np
import pytest
import tifffile

from polaropt import InputError, read_capture
from polaropt.capture.files.child import SECONDS, DecoderError, decoded_in_child
from polaropt.capture.files.decode import read_file
from polaropt.capture.files.jpeg import jpeg_segments
from polaropt.capture.files.limits import Declared, check_declared, complaints, declared
from polaropt.errors import LONGEST_LINE
from polaropt.sequence.frames import open_frames

GREY = np.random.default_rng(0).integers(0, 256, (40, 50)).astype(np.uint8)
COLOR = np.repeat(GREY[..., None], 3, axis=-1)


def chunk(name: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))


def png(width: int, height: int, *others: bytes) -> bytes:
    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    data = chunk(b"IDAT", zlib.compress(bytes(1000)))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + b"".join(others) + data + chunk(b"IEND", b"")


def jpeg_of(width: int, height: int) -> bytes:
    data = bytearray(bytes(imagecodecs.jpeg8_encode(GREY)))
    at = data.index(b"\xff\xc0")
    data[at + 5 : at + 9] = struct.pack(">HH", height, width)
    return bytes(data)


def many_scans() -> bytes:
    data = bytes(imagecodecs.jpeg8_encode(COLOR))
    at = data.index(b"\xff\xda")
    scan = data[at:-2].replace(b"\xff\xd9", b"")
    return data[:at] + 200 * scan + b"\xff\xd9"


def tiff(**tags: object) -> bytes:
    file = io.BytesIO()
    tifffile.imwrite(file, GREY, metadata=None, **tags)
    return file.getvalue()


def with_tag(data: bytes, code: int, value: int) -> bytes:
    """A TIFF whose tag of one short or long number is another."""
    changed = bytearray(data)
    with tifffile.TiffFile(io.BytesIO(data)) as file:
        tag = file.pages.first.tags[code]
        changed[tag.offset + 2 : tag.offset + 4] = struct.pack("<H", 4)
        changed[tag.offset + 8 : tag.offset + 12] = struct.pack("<I", value)
    return bytes(changed)


def large_tile() -> bytes:
    return with_tag(with_tag(tiff(tile=(16, 16), compression="zlib"), 322, 65520), 323, 65520)


def jpeg2000() -> bytes:
    """A codestream of 60000 by 60000 pixels, in a page of 40 by 50."""
    data = bytearray(tiff(compression="jpeg2000"))
    at = data.index(b"\xff\x51") + 6
    data[at : at + 8] = struct.pack(">II", 60000, 60000)
    data[at + 16 : at + 24] = struct.pack(">II", 60000, 60000)
    return bytes(data)


def many_planes() -> bytes:
    """An OME-TIFF that says it has three thousand million planes."""
    file = io.BytesIO()
    tifffile.imwrite(file, np.stack([GREY] * 4), ome=True, photometric="minisblack", metadata={"axes": "ZYX"})
    return file.getvalue().replace(b'SizeZ="4"', b'SizeZ="3e9"'[:-1] + b'"').replace(b'SizeT="1"', b'SizeT="9"')


def npz(**arrays: np.ndarray) -> bytes:
    file = io.BytesIO()
    np.savez_compressed(file, **arrays)
    return file.getvalue()


def npz_of_shape(shape: tuple[int, ...]) -> bytes:
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": shape})
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("intensities.npy", header.getvalue() + bytes(64))
    return file.getvalue()


def npy_of_shape(shape: tuple[int, ...]) -> bytes:
    file = io.BytesIO()
    np.lib.format.write_array_header_1_0(file, {"descr": "<u2", "fortran_order": False, "shape": shape})
    return file.getvalue() + bytes(64)


TOO_MUCH: dict[str, tuple[Callable[[], bytes], str]] = {
    "sides of a PNG": (lambda: png(100_000, 100_000), "10,000 million pixels"),
    "a PNG of little": (lambda: png(13_000, 13_000), "said to become 169 million"),
    "sides of a JPEG": (lambda: jpeg_of(65_000, 65_000), "4,225 million pixels"),
    "a JPEG of little": (lambda: jpeg_of(14_000, 14_000), "said to become"),
    "scans of a JPEG": (many_scans, "more than 100 scans"),
    "rows of a TIFF": (lambda: with_tag(tiff(), 257, 2**31), "million pixels"),
    "a tile of a TIFF": (large_tile, "said to become"),
    "JPEG 2000 in a TIFF": (jpeg2000, "cannot be"),
    "an array of an npz": (lambda: npz_of_shape((4, 100_000, 100_000)), "not that of an array"),
    "an array of an npy": (lambda: npy_of_shape((100_000, 100_000)), "not that of an array"),
    "negative sides": (lambda: npy_of_shape((-4, -8)), "not that of an array"),
}


@pytest.mark.parametrize("name", TOO_MUCH)
def test_what_asks_for_too_much_is_refused_before_it_is_decoded(
    tmp_path: Path, name: str, capfd: pytest.CaptureFixture[str]
) -> None:
    make, wanted = TOO_MUCH[name]
    (tmp_path / "file").write_bytes(make())
    with pytest.raises(InputError, match=wanted) as caught:
        read_file(tmp_path / "file")
    assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")


def test_an_ome_tiff_is_its_pages(tmp_path: Path) -> None:
    (tmp_path / "a.tiff").write_bytes(many_planes())
    np.testing.assert_array_equal(read_file(tmp_path / "a.tiff").pixels, np.stack([GREY] * 4))


def test_arrays_of_an_npz_that_are_not_needed_are_not_read(tmp_path: Path) -> None:
    (tmp_path / "a.npz").write_bytes(npz(intensities=np.stack([GREY] * 4), other=np.zeros(2**23)))
    assert read_file(tmp_path / "a.npz").pixels.shape == (4, 40, 50)


def test_a_thousand_bytes_of_each_byte_are_enough() -> None:
    assert declared((4, 30, 20, 3), 2) == declared((4, 3, 30, 20), 2) == Declared(2400, 14400)
    check_declared(Declared(1, 2**26 + 5000), 5)
    with pytest.raises(InputError, match="said to become"):
        check_declared(Declared(1, 2**26 + 5001), 5)


def test_large_pictures_are_read_where_they_are_allowed(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(bytes(imagecodecs.png_encode(GREY)))
    assert read_file(tmp_path / "a.png", 2000).pixels.shape == (40, 50)
    with pytest.raises(InputError, match=r"2000 pixels, more than 1999; give --max-pixels"):
        read_capture(tmp_path / "a.png", max_pixels=1999)
    for wrong in (0, -1, 1.5, True):
        with pytest.raises(InputError, match="max_pixels"):
            read_capture(tmp_path / "a.png", max_pixels=wrong)


def test_devices_and_pipes_are_no_files(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path in (Path("/dev/zero"), tmp_path / "pipe"):
        with pytest.raises(InputError, match="is no file but a device or a pipe"):
            read_file(path)


def test_what_libraries_say_is_not_heard(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """libpng's "iCCP: too short" stood beside our line."""
    (tmp_path / "a.png").write_bytes(png(8, 8, chunk(b"iCCP", b"x")))
    program = f"from polaropt.capture import read_file; print(read_file({str(tmp_path / 'a.png')!r}).pixels.shape)"
    ran = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert (ran.stdout, ran.stderr) == ("(8, 8)\n", "")


def test_each_thread_hears_its_own_libraries_and_others_are_left_alone(caplog: pytest.LogCaptureFixture) -> None:
    logger, heard = logging.getLogger("tifffile"), {}

    def listen(name: str) -> None:
        with complaints() as collected:
            together.wait()
            logger.warning(name)
            together.wait()
        heard[name] = collected

    together = threading.Barrier(2)
    threads = [threading.Thread(target=listen, args=(name,)) for name in ("one", "two")]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert heard == {"one": ["one"], "two": ["two"]}
    assert not caplog.records
    logger.warning("a program of somebody else")
    assert [record.message for record in caplog.records] == ["a program of somebody else"]


def test_jpeg_segments_are_found_behind_what_decoders_pass_over() -> None:
    data = bytes(imagecodecs.jpeg8_encode(GREY))
    padded = data[:2] + b"noise\xff\xff" + data[3:]
    assert list(jpeg_segments(padded)) == list(jpeg_segments(data))


def sleeping(data: bytes) -> dict[str, np.ndarray]:
    time.sleep(60)
    return {}


def greedy(data: bytes) -> dict[str, np.ndarray]:
    return {"a": np.ones(2**32, np.uint8)}


def talkative(data: bytes, times: int) -> dict[str, np.ndarray]:
    os.write(1, b"text of a library")
    os.write(2, b"text of a library")
    return {"a": np.frombuffer(data, np.uint8) * times, "b": np.array([True])}


def ending(data: bytes) -> dict[str, np.ndarray]:
    os.abort()


def test_a_process_with_limits(capfd: pytest.CaptureFixture[str]) -> None:
    found = decoded_in_child(f"{__name__}:talkative", b"\1\2", {"times": 3}, 2)
    assert (found["a"].tolist(), found["b"].tolist()) == ([3, 6], [True])
    with pytest.raises(InputError, match="takes more than 1 s"):
        decoded_in_child(f"{__name__}:sleeping", b"", {}, 0, seconds=1)
    with pytest.raises(DecoderError, match="more memory"):
        decoded_in_child(f"{__name__}:greedy", b"", {}, 0)
    with pytest.raises(InputError, match="cannot be decoded"):
        decoded_in_child(f"{__name__}:ending", b"", {}, 0)
    assert SECONDS <= 60
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("compression", ["jpeg", "jpeg2000", "lzma", "zstd", "webp"])
def test_all_compressions_are_read(tmp_path: Path, compression: str) -> None:
    options = {"compressionargs": {"level": 100}} if compression == "jpeg" else {}
    image = COLOR if compression in ("jpeg", "webp") else GREY
    if compression == "webp":
        options = {"compressionargs": {"lossless": True}}
    kind = "minisblack" if image is GREY else "rgb"
    tifffile.imwrite(tmp_path / "a.tiff", np.stack([image] * 3), photometric=kind, compression=compression, **options)
    pixels = read_file(tmp_path / "a.tiff").pixels
    assert pixels.shape == (3, *image.shape)
    np.testing.assert_allclose(pixels, np.stack([image] * 3), atol=3 if compression == "jpeg" else 0)


NAMES = ("a\nb.png", "\x1b[31mred.png", "very" * 60 + ".png", "\udcff.png")


@pytest.mark.parametrize("name", NAMES)
def test_an_error_is_one_line_that_a_terminal_can_show(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError) as caught:
        read_file(tmp_path / name)
    assert str(caught.value).isprintable()
    assert str(caught.value).endswith("no such file; check the name")


def test_names_of_arrays_and_long_lines_are_shortened(tmp_path: Path) -> None:
    (tmp_path / "a.npz").write_bytes(npz(**{"\x1b[2J" + "n" * 20_000: GREY}))
    with pytest.raises(InputError, match=r"a\.npz: holds .* but no array 'intensities'") as caught:
        read_file(tmp_path / "a.npz")
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 400
    assert len(str(InputError("x" * 10_000))) <= LONGEST_LINE


class Harm:
    """What runs a program where it is unpickled."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def __reduce__(self) -> tuple[object, ...]:
        return Path.touch, (self._path,)


@pytest.mark.parametrize("which", ["intensities", "valid", "angles_deg", "npy"])
def test_arrays_are_data_and_never_a_program(tmp_path: Path, which: str) -> None:
    harm = np.array([Harm(tmp_path / "harm")], dtype=object)
    if which == "npy":
        np.save(tmp_path / "a.npy", harm, allow_pickle=True)
    else:
        np.savez(tmp_path / "a.npy", **{"intensities": np.stack([GREY] * 4), which: harm})
        (tmp_path / "a.npy.npz").rename(tmp_path / "a.npy")
    for read in (read_file, lambda path: list(open_frames([str(path)]))):
        with pytest.raises(InputError):
            read(tmp_path / "a.npy")
    assert not (tmp_path / "harm").exists()
