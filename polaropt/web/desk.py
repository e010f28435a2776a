"""What lies on the page's desk: one capture, and one job at a time that works on it."""

from __future__ import annotations

import re
import secrets
import shutil
import sys
import threading
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from polaropt.batch import angles_in_names
from polaropt.errors import InputError
from polaropt.progress import Progress

MOST_FILES = 36
"""Photographs of one capture: every 5 degrees of half a turn; set by hand."""
_LONGEST_NAME = 120
"""Bytes of a file's name that are kept, its end included; set by hand."""
_UNSAFE = re.compile(r"[^\w.,()+= -]")
"""What of a name is not kept: what separates folders, and what a terminal or another system may take otherwise."""
_HALF_TURN_DEG = 180.0
_USUAL: dict[int, tuple[float | None, ...]] = {4: (0.0, 45.0, 90.0, 135.0), 3: (0.0, 60.0, 120.0)}
"""Polarizer angles in degrees of so many photographs whose names tell none."""
_PATIENCE_S = 20.0
"""Seconds that a job has to see that it is to end, before its files are removed below it; set by hand."""


class Busy(Exception):
    """A job is running, and there is one at a time."""


class Arriving(Exception):
    """A file of the capture is still being sent: what is there of it is no photograph."""


class Gone(Exception):
    """That capture does not lie here any more."""


class TooLarge(InputError):
    """More bytes or files than a capture may have."""


class _Cancelled(Exception):
    """A person no longer wants what a job works on."""


@dataclass
class Job:
    """Something that is done to the capture, and how far it is.

    Attributes
    ----------
    kind : str
    stage : str
        What is being done.
    fraction : float
        How much of it is done, 0 to 1.
    running, cancelled : bool
    problem : str
        Why it failed, one sentence; empty where it did not.
    outcome : str
        What came of it, as HTML.
    """

    kind: str
    stage: str = "Starting"
    fraction: float = 0.0
    running: bool = True
    cancelled: bool = False
    problem: str = ""
    outcome: str = ""


@dataclass
class Laid:
    """A capture on the desk: its files, one after another, and the folder that all of it is in."""

    name: str
    folder: Path
    most_bytes: int
    files: list[Path] = field(default_factory=list)
    n_bytes: int = 0
    n_arriving: int = 0

    @contextmanager
    def new_file(self, name: str) -> Iterator[Path]:
        """Where the next file goes, in a folder of its own so that it keeps its name; it arrives within this context.

        Raises
        ------
        TooLarge
            There are too many.
        """
        if len(self.files) >= MOST_FILES:
            raise TooLarge(f"more than {MOST_FILES} files; give the photographs of one capture")
        folder = self.folder / str(len(self.files))
        folder.mkdir()
        self.files.append(folder / safe_name(name))
        self.n_arriving += 1
        try:
            yield self.files[-1]
        finally:
            self.n_arriving -= 1

    def whole_files(self) -> tuple[Path, ...]:
        """Its files; Arriving where one is not there as a whole."""
        if self.n_arriving:
            raise Arriving
        return tuple(self.files)

    def count(self, n_bytes: int) -> None:
        """Count bytes before they are written; TooLarge where they are too many."""
        self.n_bytes += n_bytes
        if self.n_bytes > self.most_bytes:
            raise TooLarge(
                f"the photographs have more than {self.most_bytes / 1e6:.0f} MB in all; give fewer or smaller ones, or "
                "start polaropt app with a larger --limit-mb"
            )


def safe_name(name: str) -> str:
    """A file's name without what could lead elsewhere; its end, which tells the format, stays."""
    kept = _UNSAFE.sub("_", name).lstrip(". ")
    # Systems count bytes.
    kept = kept.encode("utf-8", "ignore")[-_LONGEST_NAME:].decode("utf-8", "ignore")
    return kept.strip() or "photograph"


class Desk:
    """One capture at a time, in a folder of which nothing stays.

    Parameters
    ----------
    folder : Path
        Empty; removed by `clear_all`.
    most_bytes : int
        Of the files of a capture.
    """

    def __init__(self, folder: Path, most_bytes: int) -> None:
        self._folder, self._most_bytes = folder, most_bytes
        self._laid: Laid | None = None
        self._job: Job | None = None
        self._thread: threading.Thread | None = None

    def lay(self) -> Laid:
        """A new capture, without files yet, in place of the one before, whose files are removed.

        Raises
        ------
        Busy
            That one is being worked on.
        """
        self.clear()
        name = secrets.token_urlsafe(12)
        folder = self._folder / name
        folder.mkdir()
        self._laid = Laid(name, folder, self._most_bytes)
        return self._laid

    def laid(self, name: str) -> Laid:
        """The capture of that name; Gone where another took its place."""
        if self._laid is None or self._laid.name != name:
            raise Gone
        return self._laid

    def job(self, name: str) -> Job | None:
        """The last job of the capture of that name."""
        self.laid(name)
        return self._job

    def start(self, kind: str, work: Callable[[Progress], str]) -> Job:
        """Work in the background.

        Parameters
        ----------
        kind : str
        work : callable
            Takes what it is to tell its progress, and gives HTML.

        Raises
        ------
        Busy
        """
        if self.working:
            raise Busy
        job = Job(kind)
        self._job = job
        self._thread = threading.Thread(target=_run, args=(job, work), name=f"polaropt {kind}", daemon=True)
        self._thread.start()
        return job

    def cancel(self) -> None:
        """Tell the running job to end; it does so where it next tells its progress."""
        if self._job is not None:
            self._job.cancelled = True

    def clear(self) -> None:
        """Remove the capture and its files; Busy where it is worked on."""
        if self.working:
            raise Busy
        if self._laid is not None:
            shutil.rmtree(self._laid.folder, ignore_errors=True)
        self._laid = self._job = self._thread = None

    def clear_all(self) -> None:
        """End the job and remove everything."""
        self.cancel()
        if self._thread is not None:
            self._thread.join(_PATIENCE_S)
        shutil.rmtree(self._folder, ignore_errors=True)

    @property
    def working(self) -> bool:
        """Whether a job runs."""
        return self._job is not None and self._job.running


def _run(job: Job, work: Callable[[Progress], str]) -> None:
    """Do a job and note how it ends; nothing of it reaches the thread's end as an error."""

    def tell(stage: str, fraction: float) -> None:
        if job.cancelled:
            raise _Cancelled
        job.stage, job.fraction = stage, fraction

    try:
        job.outcome = work(tell)
    except _Cancelled:
        job.problem = "Cancelled; the photographs are still here."
    except InputError as error:
        job.problem = str(error)
    except MemoryError:
        job.problem = "There is not enough memory for photographs of this size; give smaller ones."
    except Exception:
        # A bug: what it was stands where the program runs, and the page stays usable.
        traceback.print_exc(file=sys.stderr)
        job.problem = "This failed for a reason of the program's own; the window in which polaropt runs tells more."
    finally:
        job.running = False


def names_in_order(names: Sequence[str]) -> list[tuple[str, float | None]]:
    """Names of photographs in the order of the angles that they end in, and these; by name where some end in none.

    Four without angles are taken for 0, 45, 90 and 135 degrees, three for 0, 60 and 120.
    """
    angles = angles_in_names([Path(name) for name in names])
    # Of 000, 001, ... the numbers count files.
    counted = max(angles, default=0.0) - min(angles, default=0.0) < len(names)
    if angles and not counted and max(angles) <= _HALF_TURN_DEG:
        return [(name, angle) for angle, name in sorted(zip(angles, names, strict=True))]
    usual = _USUAL.get(len(names), (None,) * len(names))
    return list(zip(sorted(names), usual, strict=True))
