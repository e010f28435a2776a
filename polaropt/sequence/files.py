"""The files of a sequence: layers along time, a row for each frame, a video to look at."""

from __future__ import annotations

import csv
import json
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture, encode_srgb, planes_last
from polaropt.errors import InputError, check_installed
from polaropt.numerics import block_mean
from polaropt.reporting import LAYERS, json_values, reduced_intensity, viewing_exposure
from polaropt.separation import Separation

ZARR, TIFF = "zarr", "tiff"
SEQUENCE_FILES = (
    "layers.zarr",
    "transmission.tiff",
    "reflection.tiff",
    "transmission_error.tiff",
    "reflection_error.tiff",
    "side_by_side.mp4",
    "frames.csv",
    "sequence.json",
)
"""All that a sequence may write: what of it a run does not write, an earlier one has left."""
_ERRORS = tuple(f"{name}_error" for name in LAYERS)
_EXTRA = "'polaropt[sequence]'"
# Longest side in pixels of each of the three pictures of a video; set by hand.
_WIDEST = 640

Write = Callable[[NDArray[np.float32]], None]


class SequenceFiles:
    """Files that grow frame by frame.

    Parameters
    ----------
    folder : Path
        Gets ``layers.zarr`` (arrays "transmission" and "reflection", (frame, h, w[, 3]), a chunk each frame) or
        ``transmission.tiff`` and ``reflection.tiff``; ``frames.csv``, ``sequence.json`` and ``side_by_side.mp4``.
    kind : {"zarr", "tiff"}
    video : bool
        Whether there is a video.
    frames_per_second : float
        Of it.
    uncertainty : bool
        Whether there are standard errors, as arrays or stacks "transmission_error" and "reflection_error".
    """

    def __init__(
        self,
        folder: Path,
        kind: Literal["zarr", "tiff"],
        *,
        video: bool,
        frames_per_second: float,
        uncertainty: bool = False,
    ) -> None:
        self._folder, self._kind = folder, kind
        self._video, self._rate, self._uncertainty = video, frames_per_second, uncertainty
        self._files = ExitStack()
        self._layers: tuple[Write, ...] | None = None
        self._shape: tuple[int, ...] = ()
        self._show: Callable[[Separation, Capture], None] | None = None
        self.rows: list[dict[str, Any]] = []

    def __enter__(self) -> SequenceFiles:
        return self

    def __exit__(self, *error: object) -> None:
        self._files.close()

    def add(self, result: Separation, capture: Capture, seconds: float) -> None:
        """Write a frame.

        Parameters
        ----------
        result : Separation
        capture : Capture
            What was separated.
        seconds : float
            That it took.
        """
        images = [result.transmission, result.reflection]
        if self._uncertainty:
            images += [planes_last(error) for error in result.uncertainty]
        if self._layers is None:
            opened = _zarr_arrays if self._kind == ZARR else _tiff_stacks
            names = (*LAYERS, *(_ERRORS if self._uncertainty else ()))
            self._shape = images[0].shape
            self._layers = self._files.enter_context(opened(self._folder, names, self._shape))
            if self._video:
                self._show = self._files.enter_context(_video(self._folder / "side_by_side.mp4", self._rate))
        for write, image in zip(self._layers, images, strict=True):
            write(image)
        if self._show is not None:
            self._show(result, capture)
        self.rows.append(_row(len(self.rows), result, seconds))

    def add_lost(self, problem: str) -> None:
        """Write black layers for a frame that cannot be separated, and why; the first one must have been.

        Parameters
        ----------
        problem : str
            A sentence without a full stop.
        """
        assert self._layers is not None
        for write in self._layers:
            write(np.zeros(self._shape, np.float32))
        self.rows.append(dict.fromkeys(self.rows[0]) | {"frame": len(self.rows), "seconds": 0.0, "problem": problem})

    def finish(self, request: dict[str, Any]) -> dict[str, Any]:
        """Write ``frames.csv`` and ``sequence.json``; what the latter says.

        Parameters
        ----------
        request : dict
            What was asked for.
        """
        self._files.close()
        with (self._folder / "frames.csv").open("w", encoding="utf-8", errors="backslashreplace", newline="") as file:
            writer = csv.DictWriter(file, list(self.rows[0]) if self.rows else ["frame"])
            writer.writeheader()
            writer.writerows(self.rows)
        seconds = sum(row["seconds"] for row in self.rows)
        document = {
            "request": json_values(request),
            "frames": len(self.rows),
            "lost": {row["frame"]: row["problem"] for row in self.rows if row["problem"]},
            "warnings": dict(Counter(name for row in self.rows for name in (row["warnings"] or "").split())),
            "seconds": round(seconds, 3),
            "frames_per_second": round(len(self.rows) / seconds, 3) if seconds else None,
            "last": next((row for row in reversed(self.rows) if not row["problem"]), None),
        }
        text = json.dumps(document, indent=2, allow_nan=False)
        (self._folder / "sequence.json").write_text(text + "\n", encoding="utf-8")
        return document


def check_packages(kind: str, video: bool) -> None:
    """InputError where a package is missing."""
    if kind not in (ZARR, TIFF):
        raise InputError(f"--format {kind!r} does not exist; choose one of: {ZARR}, {TIFF}")
    if kind == ZARR:
        check_installed(("zarr",), "--format zarr", f"{_EXTRA}, or give --format tiff")
    if video:
        check_installed(("imageio_ffmpeg",), "--video", _EXTRA)


def _row(number: int, result: Separation, seconds: float) -> dict[str, Any]:
    incidence, azimuth, shift = result.scene.values() if result.scene.signal else (None, None, None)
    return {
        "frame": number,
        "rung": result.scene.rung,
        "incidence_deg": incidence,
        "incidence_deg_error": result.errors.incidence_deg,
        "azimuth_deg": azimuth,
        "azimuth_deg_error": result.errors.azimuth_deg,
        "ghost_shift": shift,
        "ghost_shift_error": result.errors.ghost_shift,
        "misfit": json_values(float(result.diagnostics.misfit_ratio)),
        "evaluations": result.solver.n_evaluations,
        "warnings": " ".join(warning.name for warning in result.diagnostics.warnings),
        "seconds": round(seconds, 4),
        "problem": "",
    }


@contextmanager
def _zarr_arrays(folder: Path, names: Sequence[str], shape: tuple[int, ...]) -> Iterator[tuple[Write, ...]]:
    import zarr

    group = zarr.create_group(folder / "layers.zarr")

    def grown(name: str) -> Write:
        array = group.create_array(name, shape=(0, *shape), chunks=(1, *shape), dtype="float32")

        def write(image: NDArray[np.float32]) -> None:
            place = array.shape[0]
            array.resize((place + 1, *shape))
            array[place] = image

        return write

    yield tuple(grown(name) for name in names)


@contextmanager
def _tiff_stacks(folder: Path, names: Sequence[str], shape: tuple[int, ...]) -> Iterator[tuple[Write, ...]]:
    import tifffile

    kind = "rgb" if len(shape) == 3 else "minisblack"
    with ExitStack() as files:

        def opened(name: str) -> Write:
            stack = files.enter_context(tifffile.TiffWriter(folder / f"{name}.tiff", bigtiff=True))

            def write(image: NDArray[np.float32]) -> None:
                stack.write(image, photometric=kind, contiguous=True)

            return write

        yield tuple(opened(name) for name in names)


@contextmanager
def _video(path: Path, frames_per_second: float) -> Iterator[Callable[[Separation, Capture], None]]:
    """Photograph, transmission and reflection side by side; exposed as the first frame is, so that nothing flickers."""
    import imageio.v2 as imageio

    exposures: list[float] = []
    opened: Any = imageio.get_writer
    with opened(path, fps=frames_per_second, codec="libx264", macro_block_size=2) as video:

        def show(result: Separation, capture: Capture) -> None:
            block = -(-max(capture.shape[-2:]) // _WIDEST)
            shown = (reduced_intensity(capture, block), *(block_mean(layer, block) for layer in result.layers))
            if not exposures:
                exposures.extend(viewing_exposure(np.asarray(part, dtype=np.float32)) for part in shown)
            parts = [
                planes_last(np.asarray(part * e, dtype=np.float32)) for part, e in zip(shown, exposures, strict=True)
            ]
            pixels = np.round(255 * encode_srgb(np.concatenate(parts, axis=1), capture.camera)).astype(np.uint8)
            pixels = pixels if pixels.ndim == 3 else np.repeat(pixels[..., None], 3, axis=-1)
            # Video has whole pairs of pixels.
            video.append_data(pixels[: pixels.shape[0] // 2 * 2, : pixels.shape[1] // 2 * 2])

        yield show
