"""A headless browser for tests of pages; they are skipped where there is none."""

from __future__ import annotations

import asyncio
import contextlib
import json
import shutil
import subprocess
import time
import urllib.request
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest

_NAMES = ("chromium", "chromium-browser", "google-chrome")
_SECONDS = 60


def dom_of(page: Path, profile: Path) -> str:
    """The page's elements after its scripts have run."""
    return _run(page, profile, "--dump-dom").stdout


def screenshot_of(page: Path, profile: Path, width: int, height: int, *, dark: bool = False) -> Path:
    """Picture of the page in a window of that size."""
    picture = profile / "screenshot.png"
    # Blink's setting: 0 is dark, 1 is light.
    colors = f"--blink-settings=preferredColorScheme={0 if dark else 1}"
    _run(page, profile, f"--window-size={width},{height}", "--hide-scrollbars", colors, f"--screenshot={picture}")
    return picture


def _run(page: Path, profile: Path, *options: str) -> subprocess.CompletedProcess[str]:
    command = [*_command(profile), *options, page.as_uri()]
    return subprocess.run(command, capture_output=True, text=True, check=True, timeout=_SECONDS)


def _command(profile: Path) -> list[str]:
    found = next(filter(None, map(shutil.which, _NAMES)), None)
    if found is None:
        pytest.skip(f"no browser; install one of {', '.join(_NAMES)}")
    return [found, "--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={profile / 'profile'}"]


class Tab:
    """A page in a running browser, driven over its DevTools protocol as a person does: by mouse, keys and files."""

    def __init__(self, address: str) -> None:
        from tornado.websocket import websocket_connect

        self._loop = asyncio.new_event_loop()
        # Pictures of a page come in one message.
        self._socket = self._awaited(lambda: websocket_connect(address, max_message_size=1 << 28))
        self._sent = 0

    def call(self, method: str, **arguments: Any) -> dict[str, Any]:
        """A command of the protocol, and what it returns."""
        self._sent += 1
        message = json.dumps({"id": self._sent, "method": method, "params": arguments})
        self._awaited(lambda: self._socket.write_message(message))
        while True:
            answer = json.loads(self._awaited(self._socket.read_message))
            if answer.get("id") == self._sent:
                assert "error" not in answer, answer
                result: dict[str, Any] = answer["result"]
                return result

    def run(self, expression: str) -> Any:
        """Value of an expression of JavaScript, awaited."""
        result = self.call("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in result, result
        return result["result"].get("value")

    def wait_for(self, expression: str) -> None:
        """Until an expression is true."""
        end = time.monotonic() + _SECONDS
        while not self.run(expression):
            assert time.monotonic() < end, f"never: {expression}"
            time.sleep(0.05)

    def open(self, address: str) -> None:
        """Load a page."""
        self.call("Page.navigate", url=address)
        self.wait_for(f"document.readyState === 'complete' && location.href === {json.dumps(address)}")

    def drop(self, selector: str, files: Sequence[Path]) -> None:
        """Drop files onto an element."""
        box = f"document.querySelector({json.dumps(selector)}).getBoundingClientRect()"
        x, y = self.run(f"[{box}.x + {box}.width / 2, {box}.y + {box}.height / 2]")
        data = {"items": [], "files": [str(file) for file in files], "dragOperationsMask": 1}
        for kind in ("dragEnter", "dragOver", "drop"):
            self.call("Input.dispatchDragEvent", type=kind, x=x, y=y, data=data)

    def press(self, key: str, code: int, text: str = "") -> None:
        """Press a key where the focus is."""
        for kind in ("keyDown", "keyUp"):
            more = {"text": text} if text and kind == "keyDown" else {}
            self.call("Input.dispatchKeyEvent", type=kind, key=key, code=key, windowsVirtualKeyCode=code, **more)

    def close(self) -> None:
        """Leave the page."""
        self._socket.close()
        self._loop.close()

    def _awaited(self, call: Any) -> Any:
        async def awaited() -> Any:
            return await asyncio.wait_for(call(), _SECONDS)

        return self._loop.run_until_complete(awaited())


@contextlib.contextmanager
def tab(profile: Path) -> Iterator[Tab]:
    """A page of a browser of its own."""
    command = [*_command(profile), "--remote-debugging-port=0", "about:blank"]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as browser:
        try:
            page = Tab(_address_of_page(profile / "profile" / "DevToolsActivePort"))
            try:
                yield page
            finally:
                page.close()
        finally:
            browser.terminate()


def _address_of_page(told: Path) -> str:
    end = time.monotonic() + _SECONDS
    while not (told.exists() and told.read_text()):
        assert time.monotonic() < end, "the browser does not start"
        time.sleep(0.05)
    port = told.read_text().splitlines()[0]
    with urllib.request.urlopen(f"http://127.0.0.1:{port}/json/list") as answer:
        pages = [target for target in json.load(answer) if target["type"] == "page"]
    return str(pages[0]["webSocketDebuggerUrl"])
