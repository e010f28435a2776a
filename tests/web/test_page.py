"""`polaropt app` in a browser: photographs are dropped, looked at, separated and downloaded; by keys alone, too."""

from __future__ import annotations

import contextlib
import http.client
import json
import signal
import socket
import subprocess
import sys
import time
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest
from skimage import data

from polaropt.capture.files.write import write_png
from polaropt.cli.app import main
from polaropt.reporting.names import RESULT_FILES
from tests.browser import Tab, tab

pytest.importorskip("uvicorn", reason="the extra app is not installed")
pytest.importorskip("starlette", reason="the extra app is not installed")

ROOT = Path(__file__).parent.parent.parent
LIMIT_MB = 1
ENTER, RIGHT = ("Enter", 13, "\r"), ("ArrowRight", 39)


class Running:
    """The program, its address, and the folder in which it keeps what is dropped."""

    def __init__(self, temporary: Path, *options: str) -> None:
        command = [sys.executable, "-m", "polaropt", "app", "--no-browser", *options]
        environment = {"TMPDIR": str(temporary), "PATH": "", "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
        self.temporary = temporary
        self.process = subprocess.Popen(command, cwd=ROOT, env=environment, stdout=subprocess.PIPE, text=True)
        assert self.process.stdout is not None
        self.address = self.process.stdout.readline().split()[-1]
        self.place = urlsplit(self.address)

    def ask(self, method: str, path: str, body: Any = None, **headers: str) -> tuple[int, Any]:
        """Status and answer of a request below the address."""
        status, told, content = self.answer(method, self.place.path + path, body, **headers)
        return status, json.loads(content) if told.get("content-type") == "application/json" else content

    def answer(self, method: str, path: str, body: Any = None, **headers: str) -> tuple[int, dict[str, str], bytes]:
        """Status, headers and content of any request."""
        place = self.place.hostname or "", self.place.port
        with contextlib.closing(http.client.HTTPConnection(*place, timeout=60)) as connection:
            named = {name.replace("_", "-"): value for name, value in headers.items()}
            connection.request(method, path, body, named)
            answer = connection.getresponse()
            return answer.status, dict(answer.getheaders()), answer.read()

    @contextlib.contextmanager
    def sending(self, path: str, n_bytes: int) -> Iterator[Callable[[bytes], None]]:
        """A file that comes bit by bit."""
        connection = http.client.HTTPConnection(self.place.hostname or "", self.place.port, timeout=60)
        with contextlib.closing(connection):
            connection.putrequest("PUT", self.place.path + path)
            connection.putheader("Content-Length", str(n_bytes))
            connection.endheaders()
            yield connection.send

    def lay(self, *names: str) -> str:
        status, told = self.ask("POST", "captures", json.dumps({"names": names}))
        assert status == 201
        return f"captures/{told['capture']}/"

    def kept(self) -> list[Path]:
        """All files that it keeps."""
        return [path for path in self.temporary.rglob("*") if path.is_file()]

    def end(self, how: int) -> int:
        with self.process:
            self.process.send_signal(how)
        return self.process.returncode


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    program = Running(tmp_path_factory.mktemp("kept"), "--limit-mb", str(LIMIT_MB))
    yield program
    # Ended with a capture on it, of which nothing stays.
    program.ask("PUT", f"{program.lay('a.png')}files/a.png", b"photograph")
    assert program.kept()
    assert program.end(signal.SIGTERM) in (0, -signal.SIGTERM)
    assert list(program.temporary.iterdir()) == []


@pytest.fixture(scope="module")
def opened(running: Running, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Tab]:
    with tab(tmp_path_factory.mktemp("browser")) as page:
        page.call("Runtime.enable")
        yield page


@pytest.fixture
def page(running: Running, opened: Tab) -> Tab:
    opened.open(running.address)
    return opened


def drop(page: Tab, files: list[str]) -> None:
    page.drop("#drop", [Path(name) for name in files])
    page.wait_for("!busy && (capture !== null || !byId('problem').hidden)")


def every_control_has_a_name(page: Tab) -> None:
    """For screen readers: controls, pictures and parts of the page by what they are."""
    page.run("byId('options').open = true")
    names: dict[str, list[str]] = {}
    for node in page.call("Accessibility.getFullAXTree")["nodes"]:
        if not node["ignored"]:
            names.setdefault(node["role"]["value"], []).append(node.get("name", {}).get("value", "").strip())
    for role in ("button", "combobox", "checkbox", "spinbutton", "slider", "textbox", "link", "image", "region"):
        assert names[role], role
        assert all(names[role]), role
    assert "capture_045.png, angle in degrees:" in names["spinbutton"]
    assert len(names["status"]) == 1


def test_photographs_are_dropped_separated_and_downloaded(
    page: Tab, running: Running, small_photographs: list[str], tmp_path: Path
) -> None:
    # In any order: the names tell the angles.
    drop(page, small_photographs[::-1])
    assert page.run("angles()") == [0, 45, 90, 135]
    assert "4 photographs of 48x48 px, 3 channels" in page.run("byId('inspection').textContent")
    page.run("byId('separate').focus()")
    page.press(*ENTER)
    page.wait_for("busy")
    page.wait_for("byId('bar').value > 0")
    page.wait_for("!busy")
    assert page.run("byId('problem').textContent") == ""
    assert page.run("byId('status').textContent").startswith("Separated")
    # Who hears the page is led to what came of it.
    assert page.run("document.activeElement.id") == "result"
    page.wait_for("[...document.images].every((image) => image.complete && image.naturalWidth > 0)")
    assert page.run("[...document.querySelectorAll('.gallery img')].map((image) => image.naturalWidth)") == [48] * 3

    every_control_has_a_name(page)
    page.run("byId('slider').focus()")
    page.press(*RIGHT)
    assert page.run("getComputedStyle(byId('compare')).getPropertyValue('--at')") == "51%"
    assert page.run("byId('left').value + ' ' + byId('right').value") == "photograph transmission"

    page.call("Browser.setDownloadBehavior", behavior="allow", downloadPath=str(tmp_path))
    page.run("byId('download').click()")
    archive = tmp_path / "polaropt-results.zip"
    while not archive.exists():
        time.sleep(0.05)
    names = zipfile.ZipFile(archive).namelist()
    assert {f"polaropt-results/{name}" for name in ("transmission.tiff", "report.html")} <= set(names)
    report = json.loads(zipfile.ZipFile(archive).read("polaropt-results/report.json"))
    assert [Path(name).name for name in report["input"]["files"]] == [Path(name).name for name in small_photographs]
    assert str(running.temporary) not in json.dumps(report)

    # The report is a page of its own, whose script may run.
    page.open(page.run("byId('report').href"))
    assert page.run("byId('compare-section').hidden") is False


def test_what_is_wrong_is_said_in_one_line(
    page: Tab, running: Running, small_photographs: list[str], tmp_path: Path
) -> None:
    other = tmp_path / "capture_135.png"
    write_png(other, data.astronaut()[:40, :40])
    drop(page, [*small_photographs[:3], str(other)])
    said = page.run("byId('problem').textContent")
    assert said.startswith("capture_135.png: is 40x40 px")
    assert str(running.temporary) not in said
    # They can be mended: the files are still there.
    assert page.run("byId('separate').disabled") is False


def test_too_much_is_not_even_sent(page: Tab, running: Running, tmp_path: Path) -> None:
    (tmp_path / "huge.tiff").write_bytes(bytes(1_200_000))
    drop(page, [str(tmp_path / "huge.tiff")])
    said = page.run("byId('problem').textContent")
    assert said == "These are 1.20 MB, and at most 1 are taken; polaropt app --limit-mb takes more."


def test_a_folder_is_told_from_photographs(page: Tab, small_photographs: list[str]) -> None:
    folder = Path(small_photographs[0]).parent
    drop(page, [str(folder)])
    said = page.run("byId('problem').textContent")
    assert said == f"{folder.name} is a folder; drop the photographs that are in it."


def test_what_was_looked_at_is_not_shown_of_other_angles(page: Tab, small_photographs: list[str]) -> None:
    drop(page, small_photographs)
    assert page.run("byId('inspection').hidden") is False
    write = "byId('angle-1').value = {}; byId('angle-1').dispatchEvent(new Event('change', {{bubbles: true}}))"
    page.run(write.format(50))
    assert page.run("byId('inspection').hidden") is True
    assert page.run("byId('status').textContent").startswith("They will be read otherwise")
    page.run(write.format(45))
    assert page.run("byId('inspection').hidden") is False


def test_a_mosaic_is_one_file_without_an_angle(page: Tab, tmp_path: Path) -> None:
    write_png(tmp_path / "T.png", data.coffee()[150:246, 200:296])
    write_png(tmp_path / "R.png", data.astronaut()[30:126, 160:256])
    pair = [str(tmp_path / "T.png"), str(tmp_path / "R.png")]
    assert main(["simulate", *pair, "--sensor", "mono", "-o", str(tmp_path)]) == 0
    drop(page, [str(tmp_path / "mosaic.png")])
    assert page.run("byId('problem').textContent") == ""
    assert page.run("angles()") is None
    assert "(a mono mosaic)" in page.run("byId('inspection').textContent")


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({"Host": "polaropt.example"}, 400),
        ({"Host": "127.0.0.1.polaropt.example:80"}, 400),
        ({"Host": "localhost"}, 200),
        ({"Sec_Fetch_Site": "cross-site"}, 403),
        ({"Sec_Fetch_Site": "same-site"}, 403),
        ({"Sec_Fetch_Site": "none"}, 200),
    ],
)
def test_other_sites_are_refused(running: Running, headers: dict[str, str], status: int) -> None:
    assert running.ask("GET", "", **headers)[0] == status


def test_only_this_computer_reaches_it(running: Running) -> None:
    assert running.place.hostname == "127.0.0.1"
    with pytest.raises(OSError, match="refused"):
        # Another address of the same computer.
        socket.create_connection(("127.0.0.2", running.place.port or 0), timeout=5)


def test_nothing_answers_who_does_not_know_the_key(running: Running) -> None:
    for path in ("/", "/page.js", "/captures", running.place.path[:-2] + "/"):
        assert running.answer("GET", path)[0] == 404


def test_other_sites_scripts_may_not_read_what_it_answers(running: Running) -> None:
    _, headers, _ = running.answer("GET", running.place.path, Origin="http://polaropt.example")
    assert not [name for name in headers if name.startswith("access-control")]
    assert "default-src 'none'" in headers["content-security-policy"]


@pytest.mark.parametrize("name", ["..%2F..%2F..%2Fevil", "%2Fetc%2Fevil", "..", ".%00evil", "a" * 300])
def test_a_files_name_leads_nowhere_else(running: Running, name: str) -> None:
    capture = running.lay("a.png")
    before = {path.parent for path in running.kept()}
    status, _ = running.ask("PUT", f"{capture}files/{name}", b"photograph")
    assert status in (201, 404)
    new = [path for path in running.kept() if path.parent not in before]
    assert all(path.parent.name == "0" and path.read_bytes() == b"photograph" for path in new)


def test_more_than_the_limit_is_refused_and_removed(running: Running) -> None:
    capture = running.lay("a.png")
    assert running.ask("PUT", f"{capture}files/a.png", bytes(600_000))[0] == 201
    try:
        status, told = running.ask("PUT", f"{capture}files/b.png", bytes(600_000))
    except OSError:  # it stops listening before all is sent
        pass
    else:
        assert (status, "--limit-mb" in told["problem"]) == (413, True)
    assert not running.kept()
    assert running.ask("GET", f"{capture}job")[0] == 404


def test_other_photographs_take_the_place_of_those_before(running: Running, small_photographs: list[str]) -> None:
    first = running.lay("a.png")
    running.ask("PUT", f"{first}files/a.png", b"first")
    second = running.lay("b.png")
    running.ask("PUT", f"{second}files/b.png", b"second")
    assert [path.read_bytes() for path in running.kept()] == [b"second"]
    assert running.ask("GET", f"{first}job")[0] == 404
    assert running.ask("DELETE", second[:-1])[0] == 200
    assert not running.kept()


def test_one_job_at_a_time_and_it_can_be_cancelled(running: Running, small_photographs: list[str]) -> None:
    capture = running.lay(*(Path(name).name for name in small_photographs))
    for name in small_photographs:
        running.ask("PUT", f"{capture}files/{Path(name).name}", Path(name).read_bytes())
    job = json.dumps({"do": "separate", "options": {"angles_deg": [0, 45, 90, 135]}})
    assert running.ask("POST", f"{capture}job", job)[0] == 202
    assert running.ask("POST", f"{capture}job", job)[0] == 409
    assert running.ask("POST", "captures", json.dumps({"names": ["a.png"]}))[0] == 409
    assert running.ask("PUT", f"{capture}files/a.png", b"")[0] == 409
    assert running.ask("DELETE", f"{capture}job")[0] == 200
    while (state := running.ask("GET", f"{capture}job")[1])["running"]:
        time.sleep(0.05)
    assert "Cancelled" in state["problem"]
    assert running.ask("GET", f"{capture}polaropt-results.zip")[0] == 404
    assert running.ask("POST", f"{capture}job", job)[0] == 202
    while (state := running.ask("GET", f"{capture}job")[1])["running"]:
        time.sleep(0.05)
    assert state["problem"] == ""
    assert running.ask("GET", f"{capture}results/transmission.tiff")[0] == 200
    for name in ("results/secret.txt", "results/..%2Flook.png", "0", "results/"):
        assert running.ask("GET", f"{capture}{name}")[0] == 404
    assert {path.name for path in running.kept()} >= set(RESULT_FILES) - {
        "misfit.tiff",
        "misfit.png",
        "moving.png",
        "unglazed.png",
    }


def test_work_of_a_page_that_was_closed_can_be_cancelled(
    page: Tab, running: Running, small_photographs: list[str]
) -> None:
    capture = running.lay(*(Path(name).name for name in small_photographs))
    for name in small_photographs:
        running.ask("PUT", f"{capture}files/{Path(name).name}", Path(name).read_bytes())
    job = json.dumps({"do": "separate", "options": {"angles_deg": [0, 45, 90, 135]}})
    assert running.ask("POST", f"{capture}job", job)[0] == 202
    drop(page, small_photographs)
    assert "is being worked on" in page.run("byId('problem').textContent")
    assert page.run("byId('others').hidden") is False
    page.run("byId('cancel-others').click()")
    page.wait_for("byId('status').textContent.startsWith('Ended')")
    assert running.ask("GET", "job")[1] == {"running": False}
    drop(page, small_photographs)
    assert page.run("byId('status').textContent") == "Looked at."


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"angles_deg": [0, 45]}, "angle"),
        ({"angles_deg": [0, 45, None, 135]}, "angle"),
        ({"angles_deg": [0, 45, 90, 135], "gamma": "3"}, "gamma"),
        ({"angles_deg": [0, 45, 90, 135], "shape": "many"}, "height and width"),
        ({"angles_deg": [0, 45, 90, int("1" + 400 * "0")]}, "beyond any number"),
        ([], "options"),
    ],
)
def test_options_that_cannot_be_are_refused(running: Running, options: Any, said: str) -> None:
    capture = running.lay(*"abcd")
    for name in "abcd":
        running.ask("PUT", f"{capture}files/{name}", b"")
    status, told = running.ask("POST", f"{capture}job", json.dumps({"do": "inspect", "options": options}))
    assert status == 400
    assert said in told["problem"]


@pytest.mark.parametrize("kind", [["inspect"], {}, None, 3])
def test_work_of_another_kind_is_refused(running: Running, kind: object) -> None:
    status, told = running.ask("POST", f"{running.lay('a')}job", json.dumps({"do": kind}))
    assert (status, told["problem"].startswith("there is no ")) == (400, True)


def test_half_a_character_is_no_name(running: Running) -> None:
    status, told = running.ask("POST", "captures", b'{"names": ["\\ud800.png"]}')
    assert (status, told["problem"]) == (400, "no files are named; choose some")


def test_what_comes_late_removes_no_other_photographs(running: Running) -> None:
    first = running.lay("a.png")
    with running.sending(f"{first}files/a.png", 9_000_000) as send:
        send(bytes(400_000))
        second = running.lay("b.png")
        assert running.ask("PUT", f"{second}files/b.png", b"second")[0] == 201
        with contextlib.suppress(OSError):
            send(bytes(1_000_000))
    assert running.ask("GET", f"{second}job")[0] == 200


def test_nothing_begins_on_a_photograph_that_is_still_being_sent(
    running: Running, small_photographs: list[str]
) -> None:
    capture = running.lay("a.png", "b.png", "c.png")
    first, second, third = (Path(name).read_bytes() for name in small_photographs[:3])
    job = json.dumps({"do": "inspect", "options": {"angles_deg": [0, 45, 90]}})
    for content in (first, second):
        assert running.ask("PUT", f"{capture}files/a.png", content)[0] == 201
    with running.sending(f"{capture}files/c.png", len(third)) as send:
        send(third[:-100])
        while len(running.kept()) < 3:
            time.sleep(0.01)
        status, told = running.ask("POST", f"{capture}job", job)
        assert (status, told["problem"]) == (409, "The photographs are still being sent; wait until all are here.")
        send(third[-100:])
        while running.ask("POST", f"{capture}job", job)[0] == 409:
            time.sleep(0.01)
    while (state := running.ask("GET", f"{capture}job")[1])["running"]:
        time.sleep(0.05)
    assert "3 photographs" in state["outcome"]


def test_options_nested_without_end_are_refused(running: Running) -> None:
    nested = b"[" * 20_000
    status, told = running.ask("POST", "captures", nested)
    assert (status, told["problem"]) == (400, "the options are no JSON")


def test_nothing_stays_when_it_ends(tmp_path: Path) -> None:
    program = Running(tmp_path)
    program.ask("PUT", f"{program.lay('a.png')}files/a.png", b"photograph")
    assert program.kept()
    assert program.end(signal.SIGINT) == 0
    assert list(tmp_path.iterdir()) == []


def test_a_port_that_is_taken_is_told(running: Running, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["app", "--no-browser", "--port", str(running.place.port)]) == 2
    assert "cannot be used" in capsys.readouterr().err


def test_without_the_extra_it_is_named(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setitem(sys.modules, "uvicorn", None)
    assert main(["app", "--no-browser"]) == 2
    assert capsys.readouterr().err.endswith("pip install 'polaropt[app]'\n")
