"""Frames through one pane: read one by one, the pane followed, layers that change no more than the noise does."""

from __future__ import annotations

import csv
import json
import threading
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile

import polaropt.sequence
from polaropt import (
    Capture,
    FrameReader,
    InputError,
    SceneParameters,
    StoppingRule,
    separate,
    separate_sequence,
    simulate,
)
from polaropt.capture.files.headless import PIXEL_FORMATS
from polaropt.cli.app import main
from polaropt.sequence.ahead import read_ahead
from polaropt.sequence.averaging import averaged
from polaropt.sequence.follow import flicker
from polaropt.sequence.frames import open_frames
from tests.captured import mono_mosaic, scene_intensities
from tests.command_line import QUICK

PANE = SceneParameters(60.0, 20.0, 4.0)
# Of one clear pane, of which the incidence alone is looked for.
OPEN = SceneParameters(None, 20.0, 4.0)


def film(n: int, pane: SceneParameters = PANE, noise: float = 0.005) -> Iterator[Capture]:
    from skimage.data import astronaut, coffee

    for seed in range(n):
        yield simulate(coffee()[150:214, 200:264], astronaut()[30:94, 160:224], pane, noise=noise, seed=seed)


def test_a_still_scene_flickers_no_more_than_its_noise() -> None:
    results = list(separate_sequence(film(5), OPEN, pane="still", first=2, model="ghosts"))
    assert len({result.scene.values() for result in results}) == 1
    alone = [separate(capture, results[0].scene) for capture in film(3)]
    together, apart = flicker(results[2:]), flicker(alone)
    # Started from the frame before, layers change less than where each starts anew.
    assert together[0] <= 1.05 * apart[0]
    assert together[1] <= 1.05 * apart[1]
    # What noise leaves to the transmission of a frame, twice for a difference.
    assert together[0] <= 2**0.5 * 2 * 0.005


def raw_film(shift: int, n: int = 3) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Raw mono mosaics of a camera before which the scene moves so many pixels a frame, and their layers in cells."""
    from skimage.data import astronaut, coffee

    from polaropt.numerics import block_mean
    from polaropt.simulation import Camera, photograph_mosaic

    behind, before = (
        np.kron(image.mean(axis=-1), np.ones((2, 2))).astype(np.float32) / 255
        for image in (coffee()[100:260, 150:310], astronaut()[30:190, 160:320])
    )
    raws, layers = [], []
    for i in range(n):
        seen = [image[:256, i * shift : i * shift + 256] for image in (behind, before)]
        raws.append(photograph_mosaic(seen[0], seen[1], PANE.scaled(2), Camera(bits=12, seed=i), color=False))
        layers.append(np.stack([block_mean(image, 2) for image in seen]))
    return raws, layers


@pytest.mark.parametrize("shift", [0, 8])
def test_a_frame_is_as_good_as_separated_alone(shift: int) -> None:
    """What is kept of the frame before, and that a solve is short, costs less than a tenth of a decibel."""
    raws, truths = raw_film(shift)
    reader = FrameReader(resolution="cell", sensor="mono")
    captures = [reader.read(raw) for raw in raws]
    results = list(separate_sequence(captures, PANE))
    inner = (..., slice(16, -16), slice(16, -16))
    for capture, result, truth in zip(captures, results, truths, strict=True):
        alone = separate(capture, PANE)
        for i in (0, 1):
            errors = [np.mean((one.layers[i] - truth[i])[inner] ** 2) for one in (result, alone)]
            assert 10 * np.log10(errors[0] / errors[1]) < 0.1
    if shift == 0:
        change = flicker(results)
        raw_change = float(np.sqrt(np.mean((captures[2].intensities - captures[1].intensities) ** 2)))
        # Unpolarized light of intensity 1 gives 0.5 behind a polarizer.
        assert change[0] < 2 * raw_change


def test_the_next_item_is_taken_while_one_is_in_use(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("polaropt.sequence.ahead.thread_count", lambda: 2)
    taken = []
    two = threading.Event()

    def items() -> Iterator[int]:
        for i in range(4):
            taken.append(threading.get_ident())
            if i == 1:
                two.set()
            if i == 3:
                raise InputError("no frame 3")
            yield i

    ahead = read_ahead(items())
    assert next(ahead) == 0
    # Of another thread, and no third one before the second is asked for.
    assert two.wait(20)
    assert len(taken) == 2
    assert threading.get_ident() not in taken
    assert [next(ahead), next(ahead)] == [1, 2]
    with pytest.raises(InputError, match="no frame 3"):
        next(ahead)


def test_who_leaves_waits_for_no_item(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("polaropt.sequence.ahead.thread_count", lambda: 2)
    last = threading.Event()

    def items() -> Iterator[int]:
        yield 0
        last.wait(20)

    ahead = read_ahead(items())
    assert next(ahead) == 0
    ahead.close()
    last.set()


def test_frames_that_are_read_ahead_give_the_same_layers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("polaropt.sequence.ahead.thread_count", lambda: 2)
    raws, _ = raw_film(8)
    layers = []
    for ahead in (True, False):
        reader = FrameReader(resolution="cell", sensor="mono")
        captures = (reader.read(raw) for raw in raws)
        layers.append([result.layers for result in separate_sequence(captures, PANE, ahead=ahead)])
    np.testing.assert_array_equal(*layers)


def test_results_come_as_frames_do() -> None:
    taken = []

    def live() -> Iterator[Capture]:
        for i, capture in enumerate(film(6)):
            taken.append(i)
            yield capture

    results = separate_sequence(live(), PANE, ahead=False)
    next(results)
    assert taken == [0]
    next(results)
    assert taken == [0, 1]


def test_a_pane_that_moves_is_followed() -> None:
    def moving() -> Iterator[Capture]:
        for seed in range(5):
            yield from film(1, PANE.replace(incidence_deg=60.0 + 1.5 * seed), noise=0.002)

    results = list(separate_sequence(moving(), OPEN, first=2, every=2, model="ghosts"))
    assert results[-1].scene.values()[0] > results[0].scene.values()[0] + 1
    assert results[-1].errors.incidence_deg is not None


def test_a_pane_that_is_said_to_stand_still_stays_though_frames_are_explained_worse() -> None:
    frames = [*film(2), *film(3, PANE.replace(azimuth_deg=28.0))]
    asked = PANE.replace(azimuth_deg=None)
    results = list(separate_sequence(frames, asked, first=2, pane="still", model="ghosts"))
    assert results[-1].diagnostics.misfit_ratio > 2 * results[0].diagnostics.misfit_ratio
    assert len({result.scene.azimuth_deg for result in results}) == 1


def test_frames_without_polarization_come_as_they_are() -> None:
    flat = list(film(2, PANE.replace(incidence_deg=0.0)))
    results = list(separate_sequence([*flat, *film(2)], OPEN, first=2, model="ghosts"))
    assert [result.scene.signal for result in results] == [False, False, True, True]


def test_more_first_frames_than_there_can_be_are_all_of_them() -> None:
    results = list(
        separate_sequence(film(2), OPEN, first=2**70, model="ghosts", stopping=StoppingRule(max_evaluations=1))
    )
    assert len(results) == 2


@pytest.mark.parametrize("wrong", [{"pane": "gone"}, {"first": 0}, {"every": 0}])
def test_wrong_arguments_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(InputError):
        next(separate_sequence(film(1), **wrong))  # type: ignore[arg-type]


def mosaics(n: int, shape: tuple[int, int] = (64, 64)) -> np.ndarray:
    """Frames (n, h, w) of 12 bits in 16."""
    random = np.random.default_rng(0)
    clean = mono_mosaic(scene_intensities(shape))
    noisy = clean + 0.005 * random.standard_normal((n, *shape))
    return np.round(4095 * np.clip(noisy, 0, 1)).astype(np.uint16)


def test_all_ways_to_store_frames_are_read(tmp_path: Path) -> None:
    frames = mosaics(11)
    np.save(tmp_path / "film.npy", frames)
    tifffile.imwrite(tmp_path / "film.tiff", frames, photometric="minisblack")
    (tmp_path / "film.raw").write_bytes(frames.tobytes())
    (tmp_path / "numbered").mkdir()
    for i, frame in enumerate(frames):
        tifffile.imwrite(tmp_path / "numbered" / f"f{i}.tif", frame, photometric="minisblack")
    for name in ("film.npy", "film.tiff", "numbered"):
        np.testing.assert_array_equal(list(open_frames([str(tmp_path / name)])), frames)
    for name in ("film.tiff", "numbered"):
        if (tmp_path / name).exists():
            with pytest.raises(InputError, match="more than 100;"):
                open_frames([str(tmp_path / name)], max_pixels=100)
    raw = open_frames([str(tmp_path / "film.raw")], (64, 64), "Mono12")
    assert raw.bits == PIXEL_FORMATS["Mono12"].bits
    np.testing.assert_array_equal(list(raw), frames)
    for source, shape, words in (
        ("film.raw", (60, 64), "no whole number of frames"),
        ("nothing", None, "no such file"),
        ("numbered/f0.tif", None, ""),
    ):
        if words:
            with pytest.raises(InputError, match=words):
                open_frames([str(tmp_path / source)], shape, "Mono12" if shape else None)


@pytest.mark.parametrize(
    ("names", "missing"),
    [
        (("f000", "f001", "f004", "f007"), (2, 3, 5, 6)),
        (("f9", "f10", "f11"), ()),
        (("cam1_3", "cam1_5"), (4,)),
        (("cam1_3", "cam2_5"), ()),
        (("one", "two"), ()),
        (("f0",), ()),
    ],
)
def test_numbers_that_no_frame_has_are_told(tmp_path: Path, names: tuple[str, ...], missing: tuple[int, ...]) -> None:
    frame = mosaics(1)[0]
    for name in names:
        tifffile.imwrite(tmp_path / f"{name}.tif", frame, photometric="minisblack")
    assert open_frames([str(tmp_path)]).missing == missing


def test_the_command_says_which_numbers_are_missing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "film").mkdir()
    for i, frame in zip((0, 1, 9), mosaics(3), strict=True):
        tifffile.imwrite(tmp_path / "film" / f"f{i}.tif", frame, photometric="minisblack")
    command = ["sequence", str(tmp_path / "film"), "--resolution", "cell", "--white-level", "4095", "--first", "2"]
    command += ["--model", "pixelwise", "--panes", "1", *QUICK, "--format", "tiff", "-o", str(tmp_path / "out")]
    assert main(command) == 0
    assert "ATTENTION: no file has the number 2, 3, 4, 5, 6, ...;" in capsys.readouterr().out


def test_means_take_frames_that_lie_on_each_other() -> None:
    frames = mosaics(6)
    means = list(averaged(frames, 3))
    assert len(means) == 2
    np.testing.assert_allclose(means[0], frames[:3].mean(axis=0))
    moved = np.concatenate([frames[:2], np.roll(frames[2:4], (0, 4), axis=(1, 2)), np.roll(frames[4:], 2, axis=2)])
    first, second = averaged(moved, 6)
    np.testing.assert_allclose(first[:, :-4], frames[:4].mean(axis=0)[:, :-4])
    np.testing.assert_allclose(second, moved[4:].mean(axis=0))


def test_the_command_writes_layers_along_time(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    tifffile.imwrite(tmp_path / "film.tiff", mosaics(4), photometric="minisblack")
    command = ["sequence", str(tmp_path / "film.tiff"), "--resolution", "cell", "--white-level", "4095"]
    command += ["--model", "pixelwise", "--panes", "1", *QUICK]
    assert main([*command, "-o", str(tmp_path / "tiff"), "--format", "tiff", "--json", "--first", "2"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["frames"] == 4
    assert tifffile.imread(tmp_path / "tiff" / "transmission.tiff").shape == (4, 32, 32)
    assert not (tmp_path / "tiff" / "transmission_error.tiff").exists()
    with (tmp_path / "tiff" / "frames.csv").open(encoding="utf-8") as file:
        assert [row["frame"] for row in csv.DictReader(file)] == ["0", "1", "2", "3"]
    zarr = pytest.importorskip("zarr")
    pytest.importorskip("imageio_ffmpeg")
    options = ["--pane-still", "--average", "2", "--video", "--uncertainty", "-q"]
    for _ in range(2):  # the second time in the place of the first
        assert main([*command, *options, "-o", str(tmp_path / "zarr")]) == 0
    layers = zarr.open_group(tmp_path / "zarr" / "layers.zarr", mode="r")
    assert layers["reflection"].shape == (2, 32, 32)
    assert layers["reflection"].chunks == (1, 32, 32)
    assert layers["reflection_error"].shape == (2, 32, 32)
    assert np.all(layers["transmission_error"][:] > 0)
    assert (tmp_path / "zarr" / "side_by_side.mp4").stat().st_size > 0


@pytest.mark.parametrize(("done", "said"), [(0, "nothing was written"), (1, "1 frame is written")])
def test_an_interrupted_film_keeps_what_is_done(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], done: int, said: str
) -> None:
    tifffile.imwrite(tmp_path / "film.tiff", np.stack(raw_film(0, 2)[0]), photometric="minisblack")
    separated = polaropt.sequence.separate_sequence

    def interrupted(*given: Any, **chosen: Any) -> Iterator[Any]:
        yield from islice(separated(*given, **chosen), done)
        raise KeyboardInterrupt

    monkeypatch.setattr(polaropt.sequence, "separate_sequence", interrupted)
    command = ["sequence", str(tmp_path / "film.tiff"), "--incidence", "60", "--azimuth", "20", "--shift", "4", *QUICK]
    assert main([*command, "--resolution", "cell", "--panes", "1", "-o", str(tmp_path / "out")]) == 130
    assert capsys.readouterr().err == f"polaropt: interrupted; {said}\n"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["film.tiff", *(["out"] if done else [])]


@pytest.mark.parametrize("black", [0, 1, 3])
def test_a_film_goes_on_after_a_frame_that_is_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], black: int
) -> None:
    frames = mosaics(4).copy()
    frames[black] = 0
    np.save(tmp_path / "film.npy", frames)
    command = ["sequence", str(tmp_path / "film.npy"), "--resolution", "cell", "--white-level", "4095", "--first", "2"]
    command += ["--model", "pixelwise", "--panes", "1", *QUICK, "--format", "tiff", "-o", str(tmp_path / "out")]
    assert main(command) == (3 if black else 2)
    said = capsys.readouterr()
    if not black:
        assert "frame 0: the capture is all black" in said.err
        return
    assert f"ATTENTION: frame {black} is lost, its layers are black: the capture is all black" in said.out
    layers = tifffile.imread(tmp_path / "out" / "transmission.tiff")
    assert [bool(layer.any()) for layer in layers] == [frame != black for frame in range(4)]
    with (tmp_path / "out" / "frames.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["frame"] for row in rows] == ["0", "1", "2", "3"]
    assert [bool(row["problem"]) for row in rows] == [frame == black for frame in range(4)]


@pytest.mark.parametrize("average", [1, 4])
def test_a_film_goes_on_after_a_frame_that_cannot_be_read(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], average: int
) -> None:
    (tmp_path / "film").mkdir()
    for i, frame in enumerate(mosaics(6)):
        tifffile.imwrite(tmp_path / "film" / f"f{i}.tif", frame, photometric="minisblack")
    (tmp_path / "film" / "f3.tif").write_bytes(b"")
    command = ["sequence", str(tmp_path / "film"), "--resolution", "cell", "--white-level", "4095", "--first", "1"]
    command += ["--model", "pixelwise", "--panes", "1", *QUICK, "--format", "tiff", "--average", str(average)]
    assert main([*command, "-o", str(tmp_path / "out"), "--json"]) == 3
    told = json.loads(capsys.readouterr().out)
    assert told["frames"] == (6 if average == 1 else 3)
    ((place, problem),) = told["lost"].items()
    assert (place, "f3.tif: the file is empty" in problem) == ("3" if average == 1 else "1", True)


def test_films_without_frames_and_those_cut_off_are_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "none.npy", mosaics(2)[:0])
    with pytest.raises(InputError, match="holds no frames"):
        open_frames([str(tmp_path / "none.npy")])
    with tifffile.TiffWriter(tmp_path / "film.tif") as stack:
        for frame in mosaics(4):
            stack.write(frame, photometric="minisblack", contiguous=False)
    whole = (tmp_path / "film.tif").read_bytes()
    assert open_frames([str(tmp_path / "film.tif")]).number == 4
    (tmp_path / "film.tif").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match="is cut off, and 2 of its frames are listed"):
        open_frames([str(tmp_path / "film.tif")])


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--angles", "0,45,90"], "leave --angles out"),
        (["--average", "0"], "--average is 0"),
        (["--frames-per-second", "0"], "--frames-per-second"),
        (["--align"], "leave --align"),
    ],
)
def test_wrong_options_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], words: str
) -> None:
    assert main(["sequence", "film.tiff", "-o", str(tmp_path / "out"), *arguments]) == 2
    assert words in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
