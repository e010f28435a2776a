"""One capture of many: what is to be done with it, its doing, and its row of the summary."""

from __future__ import annotations

import hashlib
import json
import os
import time
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import polaropt
from polaropt.batch.shared_scene import Estimate
from polaropt.capture import Capture, align, read_capture, result_folder, write_bytes
from polaropt.errors import InputError, in_one_line
from polaropt.optics import FIELDS, SceneErrors, SceneParameters
from polaropt.reporting import RESULT_FILES, THUMBNAIL, json_values, scene_of_report, thumbnail_strip, write_separation

if TYPE_CHECKING:
    from polaropt.separation import Separation


REPORT = "report.json"
DONE, ESTIMATED, FAILED, TOO_LARGE = "done", "estimated", "failed", "too large"
DISAGREES = "SCENE_DISAGREES"
"""Beside the names of warnings: a capture that disagrees with the scene that others share with it."""
_KEY_DIGITS = 16
# What a separation needs at its most: bytes for each value of the photographs, theirs included, and those of the
# libraries. Set by hand, about twice what 1224x1024 pixels in colour take: larger ones take less, in tiles.
_BYTES_PER_VALUE = 60
_BYTES_OF_LIBRARIES = 400 * 2**20


@dataclass(frozen=True)
class Options:
    """How captures are read, separated and written.

    Attributes
    ----------
    reading : mapping of str
        Arguments of `polaropt.read_capture` beside the files.
    separating : mapping of str
        Arguments of `polaropt.separation.separate` beside the capture; a scene may be the path of an earlier
        ``report.json``.
    align : bool
        Whether photographs are moved onto each other.
    relative : bool
        Whether only the steps between the angles are known.
    layers_only : bool
        Whether of the results only the layers and the report are written.
    uncertainty : bool
        Whether the layers' standard errors are found and written.
    """

    reading: Mapping[str, Any] = field(default_factory=dict)
    separating: Mapping[str, Any] = field(default_factory=dict)
    align: bool = False
    relative: bool = False
    layers_only: bool = False
    uncertainty: bool = True

    @property
    def further_files(self) -> tuple[str, ...]:
        """Files that are read beside the photographs."""
        named = (self.reading.get("analyzer"), self.separating.get("scene"))
        return tuple(str(name) for name in named if isinstance(name, str | Path))

    def chosen(self, capture: Capture) -> dict[str, Any]:
        """What separates a capture: an earlier scene is scaled to it."""
        scene = self.separating.get("scene")
        if isinstance(scene, str | Path):
            scene = scene_of_report(Path(scene), capture.shape[-2:])
        return {**self.separating, "scene": scene}

    def read(self, files: tuple[str, ...]) -> Capture:
        """The capture of files, as `polaropt separate` reads it."""
        capture = read_capture(files, **self.reading)
        if self.align:
            capture = align(capture, overwrite=True)
        if self.relative:
            from polaropt.estimation import find_start_angle

            capture = find_start_angle(capture)
        return capture


@dataclass(frozen=True)
class Job:
    """A capture to separate.

    Attributes
    ----------
    name : str
        Of the capture.
    files : tuple of str
        In the order of the angles; absolute, as other processes work elsewhere.
    folder : str
        Where the results go; absolute.
    options : Options
    problem : str
        Why the files are no capture; empty where they are one.
    """

    name: str
    files: tuple[str, ...]
    folder: str
    options: Options
    problem: str = ""

    def key(self) -> str:
        """Digest of files and options: the same as long as the result would be.

        A file counts as the same while name, size and time of its last change are.
        """
        files = [_state_of(name) for name in (*self.files, *self.options.further_files)]
        told = json.dumps([polaropt.__version__, files, json_values(self.options)], sort_keys=True, default=str)
        return hashlib.sha256(told.encode()).hexdigest()[:_KEY_DIGITS]


def _state_of(name: str) -> tuple[str, int, int]:
    try:
        status = os.stat(name)
    except (OSError, ValueError):
        return os.path.basename(name), -1, -1
    return os.path.basename(name), status.st_size, status.st_mtime_ns


@dataclass(frozen=True)
class Row:
    """What is told of a capture in the summary.

    Attributes
    ----------
    name, files
        Of the capture.
    status : str
        "done", "failed", or "too large" for the memory that it was given; "estimated" where only the scene was looked
        for.
    message : str
        The one line of what went wrong.
    folder : str
        Of the results, relative to that of all.
    scene : dict
        As ``report.json`` has it, with the rung; empty where there is none.
    errors : dict
        Standard errors of what was estimated.
    shape : (int, int) or None
        Height and width in pixels, where only the scene was looked for.
    warnings : tuple of str
        Names.
    misfit : float or None
        Mean squared residual in units of the noise.
    seconds : float
        That it took, reading and writing included.
    trace : str
        Of an error that nobody expected.
    key : str
        Of the job, see `Job.key`.
    """

    name: str
    files: tuple[str, ...]
    status: str
    message: str = ""
    folder: str = ""
    scene: dict[str, Any] = field(default_factory=dict)
    errors: dict[str, Any] = field(default_factory=dict)
    shape: tuple[int, int] | None = None
    warnings: tuple[str, ...] = ()
    misfit: float | None = None
    seconds: float = 0.0
    trace: str = ""
    key: str = ""


def separate_files(job: Job, memory: int | None = None) -> Row:
    """Read, separate and write one capture; its results appear together, or not at all.

    Parameters
    ----------
    job : Job
    memory : int, optional
        Bytes that may be used. A capture that is likely to need more is not separated.

    Returns
    -------
    Row
        Of a capture that failed with what went wrong.
    """
    return _tried(job, memory, _separated)


def estimate_files(job: Job, memory: int | None = None) -> Row:
    """Read one capture and find its scene: a row with all numbers of the scene, as `scene_of_row` reads them."""
    return _tried(job, memory, _estimated)


def _tried(job: Job, memory: int | None, work: Callable[[Job, Capture], Row]) -> Row:
    """A row, whatever happens."""
    began = time.perf_counter()
    key = job.key()

    def failed(message: str, trace: str = "") -> Row:
        seconds = time.perf_counter() - began
        return Row(job.name, job.files, FAILED, in_one_line(message), seconds=seconds, trace=trace, key=key)

    if job.problem:
        return failed(f"{job.files[0]}: {job.problem}")
    try:
        capture = job.options.read(job.files)
        if memory is not None and needed_memory(capture) > memory:
            return Row(job.name, job.files, TOO_LARGE, key=key)
        row = work(job, capture)
    except InputError as error:
        return failed(str(error))
    except MemoryError:
        return (
            Row(job.name, job.files, TOO_LARGE, key=key) if memory is not None else failed("there is not enough memory")
        )
    except Exception as error:  # a bug that one capture meets keeps its trace, and the others go on
        return failed(f"unexpected {type(error).__name__}: {error}", traceback.format_exc())
    return replace(row, seconds=time.perf_counter() - began, key=key)


def needed_memory(capture: Capture) -> int:
    """Bytes that a separation of this capture takes at most."""
    return _BYTES_OF_LIBRARIES + _BYTES_PER_VALUE * capture.intensities.size


def _separated(job: Job, capture: Capture) -> Row:
    from polaropt.separation import separate

    options = job.options
    result = separate(capture, **options.chosen(capture))
    with result_folder(Path(job.folder), (*RESULT_FILES, THUMBNAIL)) as work:
        write_separation(work, result, capture, uncertainty=options.uncertainty, layers_only=options.layers_only)
        write_bytes(work / THUMBNAIL, thumbnail_strip(result, capture))
    return row_of(job.name, job.files, result)


def _estimated(job: Job, capture: Capture) -> Row:
    from polaropt.separation import estimate, scene_options

    chosen = job.options.chosen(capture)
    found = estimate(capture, chosen.get("scene"), **scene_options(chosen))
    scene, errors = json_values(found.scene), json_values(found.errors)
    height, width = capture.shape[-2:]
    return Row(job.name, job.files, ESTIMATED, scene=scene, errors=errors, shape=(height, width))


def scene_of_row(row: Row) -> Estimate | None:
    """The scene that `estimate_files` found; None where it failed."""
    if row.status != ESTIMATED:
        return None
    scene, errors = ({name: _tupled(value) for name, value in told.items()} for told in (row.scene, row.errors))
    return Estimate(SceneParameters(**scene), SceneErrors(**errors), row.shape)


def _tupled(value: Any) -> Any:
    """JSON has no tuples."""
    return tuple(value) if isinstance(value, list) else value


def row_of(name: str, files: tuple[str, ...], result: Separation) -> Row:
    """The numbers of a separation that a summary shows."""
    return Row(
        name,
        files,
        DONE,
        scene={"rung": result.scene.rung, **_told(result.scene)},
        errors=_told(result.errors),
        warnings=tuple(warning.name for warning in result.diagnostics.warnings),
        misfit=json_values(float(result.diagnostics.misfit_ratio)),
    )


def _told(numbers: Any) -> dict[str, Any]:
    """Fields of a scene, or of its errors, that say something, one number each."""
    told: dict[str, Any] = {}
    signal = not isinstance(numbers, SceneParameters) or numbers.signal
    for one in FIELDS if signal else ():
        value = json_values(getattr(numbers, one.name, None))
        if value is None:
            continue
        parts = value if isinstance(value, list) else [value]
        for component, part in zip(one.components, parts, strict=True):
            told["_".join(filter(None, (one.name, component.words)))] = part
    return told
