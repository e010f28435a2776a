"""Machine code that is kept: loaded from folders that nobody else may write to alone, and missed without harm."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from pathlib import Path

import pytest

from solvers.keeping import is_ours

ROOT = Path(__file__).parents[2]
pytestmark = pytest.mark.skipif(not hasattr(os, "getuid"), reason="files have no owners here")
as_root = pytest.mark.skipif(not hasattr(os, "getuid") or os.getuid() != 0, reason="only root gives files away")
STRANGER = 54321
KERNEL = """
from solvers.kernels import compiled

@compiled
def doubled(x):
    return 2 * x
"""
RUN = """
import sys
sys.path.insert(0, {folder!r})
from solvers.kernels import compilations_reported_to
told = []
with compilations_reported_to(told.append):
    from kernel import doubled
    assert doubled(3) == 6
print(*told)
"""


class Planted:
    """What tells that it was unpickled."""

    def __init__(self, trace: Path) -> None:
        self.trace = trace

    def __reduce__(self) -> tuple[object, ...]:
        return os.mkdir, (str(self.trace),)


@pytest.fixture
def place(tmp_path: Path) -> Path:
    """A program, a folder for the cache and a home."""
    for name in ("program", "cache", "home"):
        (tmp_path / name).mkdir()
    (tmp_path / "program" / "kernel.py").write_text(KERNEL)
    return tmp_path


def run(place: Path, *, home: str = "home", before: str = "") -> bool:
    """Whether a kernel was compiled by a program that keeps it in a folder that it is told."""
    own = {"NUMBA_CACHE_DIR": str(place / "cache"), "XDG_CACHE_HOME": str(place / home)}
    command = [sys.executable, "-c", before + RUN.format(folder=str(place / "program"))]
    ran = subprocess.run(command, cwd=ROOT, env=os.environ | own, capture_output=True, text=True, check=True)
    assert ran.stderr == ""
    return ran.stdout.strip() == "doubled"


def kept(place: Path, name: str) -> list[Path]:
    return sorted((place / name).rglob("*.nb*"))


def plant(index: Path, trace: Path) -> None:
    """Put what tells that it was unpickled into an index, behind the version that stands in it."""
    with index.open("rb") as file:
        version = pickle.load(file)
    index.write_bytes(pickle.dumps(version) + pickle.dumps(Planted(trace)))


def test_what_was_planted_in_a_folder_of_our_own_would_be_run(place: Path) -> None:
    assert run(place)
    index = kept(place, "cache")[-1]
    assert index.suffix == ".nbi"
    assert not run(place)
    plant(index, place / "trace")
    with pytest.raises(subprocess.CalledProcessError):
        run(place)
    assert (place / "trace").is_dir()


@pytest.mark.parametrize("mode", [0o757, 0o777, 0o1777])
def test_from_a_folder_that_anyone_may_write_to_nothing_is_run(place: Path, mode: int) -> None:
    assert run(place)
    index = kept(place, "cache")[-1]
    plant(index, place / "trace")
    index.parent.chmod(mode)
    # Compiled again, and kept where nobody else may write.
    assert [run(place), run(place)] == [True, False]
    assert not (place / "trace").exists()
    (folder,) = {path.parent for path in kept(place, "home")}
    assert folder.stat().st_mode & 0o777 == 0o700


@as_root
@pytest.mark.parametrize("what", ["folder", "index", "code"])
def test_what_belongs_to_a_stranger_is_not_run(place: Path, what: str) -> None:
    assert run(place)
    code, index = kept(place, "cache")
    given = {"folder": index.parent, "index": index, "code": code}[what]
    if what == "code":
        code.write_bytes(pickle.dumps(Planted(place / "trace")))
    else:
        plant(index, place / "trace")
    os.chown(given, STRANGER, STRANGER)
    assert [run(place), run(place)] == [True, False]
    assert not (place / "trace").exists()
    assert bool(kept(place, "home")) == (what == "folder")


@as_root
def test_who_owns_the_program_is_trusted(place: Path) -> None:
    assert run(place)
    for path in (place / "program" / "kernel.py", place / "cache", *(place / "cache").rglob("*")):
        os.chown(path, STRANGER, STRANGER)
    assert not run(place)


@pytest.mark.parametrize("home", ["file", "home"])
def test_without_a_folder_of_one_s_own_kernels_are_compiled_every_time(place: Path, home: str) -> None:
    assert run(place)
    for path in kept(place, "cache"):
        path.parent.chmod(0o777)
    (place / "file").write_text("no folder")
    assert [run(place, home=home), run(place, home=home)] == [True, home == "file"]


def test_what_cannot_be_read_is_compiled(place: Path) -> None:
    assert run(place)
    index = kept(place, "cache")[-1]
    index.unlink()
    index.mkdir()
    assert [run(place), run(place)] == [True, True]


def test_on_a_full_disk_nothing_is_kept(place: Path) -> None:
    lines = "import resource, signal\nsignal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
    lines += "resource.setrlimit(resource.RLIMIT_FSIZE, (10, 10))\n"
    assert run(place, before=lines)
    assert kept(place, "cache") == []
    assert [run(place), run(place)] == [True, False]


def test_a_group_of_one_s_own_is_nobody_else(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    grp, pwd = pytest.importorskip("grp"), pytest.importorskip("pwd")
    tmp_path.chmod(0o775)
    program = tmp_path / "program.py"
    program.write_text("")
    user = pwd.getpwuid(os.getuid())
    found = tmp_path.stat()

    def is_so(name: str, members: list[str], primary: int) -> bool:
        monkeypatch.setattr(grp, "getgrgid", lambda group: grp.struct_group((name, "x", group, members)))
        monkeypatch.setattr(pwd, "getpwuid", lambda uid: pwd.struct_passwd((*user[:3], primary, *user[4:])))
        return is_ours(tmp_path, program)

    name = user.pw_name
    assert is_so(name, [], found.st_gid)
    assert is_so(name, [name], found.st_gid)
    assert not is_so(name, ["another"], found.st_gid)
    assert not is_so("users", [], found.st_gid)
    assert not is_so(name, [], found.st_gid + 1)
    monkeypatch.setattr(grp, "getgrgid", lambda group: {}[group])
    assert not is_ours(tmp_path, program)
    tmp_path.chmod(0o755)
    assert is_ours(tmp_path, program)
    assert not is_ours(tmp_path / "nothing", program)
