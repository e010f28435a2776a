"""Files of a capture as the page takes them: their order, their angles, their names."""

from __future__ import annotations

import asyncio
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from polaropt.web.desk import Desk, Gone, names_in_order, safe_name


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (["p_135.png", "p_000.png", "p_090.png", "p_045.png"], [0, 45, 90, 135]),
        (["b120deg.tif", "b_60deg.tif", "b_0deg.tif"], [0, 60, 120]),
        # Numbers that count files are no angles.
        (["i_003.png", "i_001.png", "i_002.png", "i_004.png"], [0, 45, 90, 135]),
        (["DSC_0123.NEF", "DSC_0121.NEF", "DSC_0122.NEF", "DSC_0124.NEF"], [0, 45, 90, 135]),
        (["c", "a", "b"], [0, 60, 120]),
        (["e", "d", "c", "b", "a"], [None] * 5),
        (["raw_045.png"], [None]),
    ],
)
def test_angles_are_those_of_the_names(names: list[str], expected: list[float | None]) -> None:
    ordered = names_in_order(names)
    assert sorted(name for name, _ in ordered) == sorted(names)
    if expected != [0, 60, 120] or "b_0deg.tif" not in names:
        assert [angle for _, angle in ordered] == expected


def test_photographs_of_one_name_are_all_kept() -> None:
    assert [name for name, _ in names_in_order(["a.png", "a.png", "a.png"])] == ["a.png"] * 3


@pytest.mark.parametrize("name", ["../evil", "/etc/passwd", "..", "", "a\x00b", "a\nb", "\\\\server\\x.png", "<b>.png"])
def test_a_name_keeps_nothing_that_leads_elsewhere(name: str) -> None:
    kept = safe_name(name)
    assert kept
    assert not kept.startswith(".")
    assert not set(kept) & set("/\\\0\n<>:")


def test_the_end_of_a_long_name_stays() -> None:
    assert safe_name("x" * 300 + ".tiff").endswith(".tiff")
    assert len(safe_name("x" * 300 + ".tiff")) < 255


def test_a_long_name_is_kept_by_its_bytes() -> None:
    kept = safe_name("\N{CYRILLIC SMALL LETTER ZHE}" * 300 + ".tiff")
    assert kept.endswith(".tiff")
    assert len(kept.encode()) < 255


def test_a_picture_is_sent_whole_though_others_take_its_place(tmp_path: Path) -> None:
    """A browser asks for it late, and the capture is removed while it is sent."""
    pytest.importorskip("starlette", reason="the extra app is not installed")
    from polaropt.web.server import _file

    desk = Desk(tmp_path, 100)
    laid = desk.lay()
    (laid.folder / "look.png").write_bytes(b"picture")
    request: Any = SimpleNamespace(path_params={"capture": laid.name, "name": "look.png"})

    async def asked_and_sent() -> bytes:
        response: Any = await _file(desk, request)
        assert (response.headers["content-length"], response.headers["content-type"]) == ("7", "image/png")
        desk.lay()
        return b"".join([part async for part in response.body_iterator])

    # Not asyncio.run, which leaves no loop to those tests that drive a browser.
    loop = asyncio.new_event_loop()
    try:
        assert loop.run_until_complete(asked_and_sent()) == b"picture"
        with pytest.raises(Gone):
            loop.run_until_complete(_file(desk, request))
    finally:
        loop.close()
