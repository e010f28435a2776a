"""Values are frozen: who holds one need not fear that another changes it."""

from __future__ import annotations

import dataclasses
import importlib
from pathlib import Path

import pytest

PACKAGES = ("optics", "judging", "estimation", "capture", "reporting", "solving", "inversion")
ROOT = Path(__file__).parents[1]
MODULES = sorted(path for wing in PACKAGES for path in (ROOT / "polaropt" / wing).rglob("*.py"))


@pytest.mark.parametrize("path", MODULES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_values_are_frozen(path: Path) -> None:
    name = ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
    if "@dataclass" not in path.read_text(encoding="utf-8"):
        return
    values = [value for value in vars(importlib.import_module(name)).values() if isinstance(value, type)]
    own = [value for value in values if value.__module__ == name and dataclasses.is_dataclass(value)]
    assert [value.__name__ for value in own if not value.__dataclass_params__.frozen] == []
