"""A headless browser for tests of pages; they are skipped where there is none."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

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
    found = next(filter(None, map(shutil.which, _NAMES)), None)
    if found is None:
        pytest.skip(f"no browser; install one of {', '.join(_NAMES)}")
    command = [found, "--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={profile / 'profile'}", *options]
    return subprocess.run([*command, page.as_uri()], capture_output=True, text=True, check=True, timeout=_SECONDS)
