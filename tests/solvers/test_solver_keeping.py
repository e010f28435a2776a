"""Machine code that is kept: loaded from folders that nobody else may write to alone, and missed without harm."""

from __future__ import annotations

import os
import pickle
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from solvers.keeping import is_ours
from tests.forks import Forks, forks

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


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the program: what is kept counts for this place of it alone."""
    folder = tmp_path_factory.mktemp("program")
    (folder / "kernel.py").write_text(KERNEL)
    return folder


@pytest.fixture
def place(tmp_path: Path, program: Path) -> Path:
    """A program, a folder for the cache and a home."""
    (tmp_path / "program").symlink_to(program)
    for name in ("cache", "home"):
        (tmp_path / name).mkdir()
    return tmp_path


@pytest.fixture(scope="module")
def kept_once(tmp_path_factory: pytest.TempPathFactory, program: Path) -> Path:
    """A folder in which the program has kept its machine code."""
    folder = tmp_path_factory.mktemp("kept")
    (folder / "program").symlink_to(program)
    for name in ("cache", "home"):
        (folder / name).mkdir()
    # A process from its start, as users begin it; what it keeps is what the copies of another one find.
    code, own = told(folder, "home", "")
    command = [sys.executable, "-c", code]
    ran = subprocess.run(command, cwd=ROOT, env=os.environ | own, capture_output=True, text=True, check=True)
    assert (ran.stdout.strip(), ran.stderr) == ("doubled", "")
    return folder / "cache"


@pytest.fixture
def filled(place: Path, kept_once: Path) -> Path:
    """The same after a run that compiled."""
    shutil.copytree(kept_once, place / "cache", dirs_exist_ok=True)
    return place


def told(place: Path, home: str, before: str) -> tuple[str, dict[str, str]]:
    """A program that keeps its kernel in a folder that it is told, and what its environment says beside ours."""
    own = {"NUMBA_CACHE_DIR": str(place / "cache"), "XDG_CACHE_HOME": str(place / home)}
    return before + RUN.format(folder=str((place / "program").resolve())), own


@pytest.fixture(scope="module")
def process() -> Iterator[Forks]:
    with forks(os.environ) as started:
        yield started


@pytest.fixture
def run(process: Forks) -> Callable[..., bool]:
    """Whether a kernel was compiled by a process that keeps it in a folder that it is told."""

    def forked(place: Path, *, home: str = "home", before: str = "") -> bool:
        ran = process.run(*told(place, home, before))
        if ran.code:
            raise subprocess.CalledProcessError(ran.code, "a program", ran.out, ran.err)
        assert ran.err == ""
        return ran.out.strip() == "doubled"

    return forked


def kept(place: Path, name: str) -> list[Path]:
    return sorted((place / name).rglob("*.nb*"))


def plant(index: Path, trace: Path) -> None:
    """Put what tells that it was unpickled into an index, behind the version that stands in it."""
    with index.open("rb") as file:
        version = pickle.load(file)
    index.write_bytes(pickle.dumps(version) + pickle.dumps(Planted(trace)))


def test_what_was_planted_in_a_folder_of_our_own_would_be_run(filled: Path, run: Callable[..., bool]) -> None:
    index = kept(filled, "cache")[-1]
    assert index.suffix == ".nbi"
    assert not run(filled)
    plant(index, filled / "trace")
    with pytest.raises(subprocess.CalledProcessError):
        run(filled)
    assert (filled / "trace").is_dir()


@pytest.mark.parametrize("mode", [0o757, 0o777, 0o1777])
def test_from_a_folder_that_anyone_may_write_to_nothing_is_run(
    filled: Path, run: Callable[..., bool], mode: int
) -> None:
    index = kept(filled, "cache")[-1]
    plant(index, filled / "trace")
    index.parent.chmod(mode)
    # Compiled again, and kept where nobody else may write.
    assert [run(filled), run(filled)] == [True, False]
    assert not (filled / "trace").exists()
    (folder,) = {path.parent for path in kept(filled, "home")}
    assert folder.stat().st_mode & 0o777 == 0o700


@as_root
@pytest.mark.parametrize("what", ["folder", "index", "code"])
def test_what_belongs_to_a_stranger_is_not_run(filled: Path, run: Callable[..., bool], what: str) -> None:
    code, index = kept(filled, "cache")
    given = {"folder": index.parent, "index": index, "code": code}[what]
    if what == "code":
        code.write_bytes(pickle.dumps(Planted(filled / "trace")))
    else:
        plant(index, filled / "trace")
    os.chown(given, STRANGER, STRANGER)
    assert [run(filled), run(filled)] == [True, False]
    assert not (filled / "trace").exists()
    assert bool(kept(filled, "home")) == (what == "folder")


@as_root
def test_who_owns_the_program_is_trusted(filled: Path, run: Callable[..., bool]) -> None:
    paths = [filled / "program" / "kernel.py", filled / "cache", *(filled / "cache").rglob("*")]
    for path in paths:
        os.chown(path, STRANGER, STRANGER)
    compiled = run(filled)
    os.chown(paths[0], os.getuid(), os.getgid())
    assert not compiled


@pytest.mark.parametrize("home", ["file", "home"])
def test_without_a_folder_of_one_s_own_kernels_are_compiled_every_time(
    filled: Path, run: Callable[..., bool], home: str
) -> None:
    for path in kept(filled, "cache"):
        path.parent.chmod(0o777)
    (filled / "file").write_text("no folder")
    assert [run(filled, home=home), run(filled, home=home)] == [True, home == "file"]


def test_what_cannot_be_read_is_compiled(filled: Path, run: Callable[..., bool]) -> None:
    index = kept(filled, "cache")[-1]
    index.unlink()
    index.mkdir()
    assert [run(filled), run(filled)] == [True, True]


def test_on_a_full_disk_nothing_is_kept(place: Path, run: Callable[..., bool]) -> None:
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
