"""Every study writes documents of one form, whatever its rows hold."""

from __future__ import annotations

import inspect
import math
import pkgutil
import types
import typing
from collections.abc import Iterator
from dataclasses import dataclass, fields
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator, ValidationError

from tests.documents import SCHEMA, document_of

pytest.importorskip("torch")

from studies.catalogue import STUDIES
from studies.kit.records import metadata, row_of, write_document
from studies.kit.run import run_jobs

VALIDATOR = Draft202012Validator(SCHEMA)
PLAIN = {int: 3, float: 1.5, str: "a", bool: True, type(None): None}


@dataclass(frozen=True)
class Job:
    """What an example row comes from."""

    study: str


def examples(annotation: Any) -> Iterator[Any]:
    """Values that a field may have: all kinds of what may stand in it, and for numbers that none was measured."""
    if annotation in PLAIN:
        yield PLAIN[annotation]
        if annotation is float:
            yield math.nan
    elif typing.get_origin(annotation) is tuple:
        (kind, *more) = typing.get_args(annotation)
        assert more in ([...], [kind] * len(more)), f"{annotation} holds several kinds"
        yield from ((), (PLAIN[kind], PLAIN[kind]))
    elif typing.get_origin(annotation) in (types.UnionType, typing.Union):
        # What need not be a number says so by None.
        yield from (PLAIN[part] for part in typing.get_args(annotation))
    else:
        assert typing.get_origin(annotation) is typing.Literal, f"{annotation} is no plain value"
        yield typing.get_args(annotation)[0]


def modules_with_rows(name: str) -> list[types.ModuleType]:
    """A study is a module, or a package; what makes rows is a function ``run``."""
    spec = find_spec(f"studies.{name}")
    assert spec is not None
    package = spec.submodule_search_locations
    names = [found.name for found in pkgutil.iter_modules(package, f"studies.{name}.")] if package else [spec.name]
    modules = [import_module(name) for name in names if not name.endswith("__main__")]
    return [module for module in modules if inspect.isfunction(getattr(module, "run", None))]


def test_every_study_makes_rows() -> None:
    assert [study.name for study in STUDIES if not modules_with_rows(study.name)] == []


@pytest.mark.parametrize("module", [part for study in STUDIES for part in modules_with_rows(study.name)])
def test_the_rows_of_every_study_fit_the_form_and_come_back(module: types.ModuleType, tmp_path: Path) -> None:
    name = module.__name__
    (kind,) = typing.get_args(typing.get_type_hints(module.run)["return"])
    hints = typing.get_type_hints(kind)
    values = {field.name: list(examples(hints[field.name])) for field in fields(kind)}
    most = max(len(kinds) for kinds in values.values())
    rows = [kind(**{name: kinds[i % len(kinds)] for name, kinds in values.items()}) for i in range(most)]
    path = tmp_path / f"{name}.json"
    run_jobs(lambda job: rows, [Job(name)], path, {"size": 64})
    found = [row_of(kind, row) for row in document_of(path)["results"]]
    # NaN is not equal to itself.
    assert list(map(repr, found)) == list(map(repr, rows))


@pytest.mark.parametrize(
    "broken",
    [{"seeds": None}, {"commit": "unknown"}, {"machine": {"cpu": "x", "cores": 0, "memory_gib": 1}}, {"more": 1}],
)
def test_metadata_of_another_form_are_refused(broken: dict[str, Any]) -> None:
    told = metadata({})
    VALIDATOR.validate({"metadata": told, "results": []})
    with pytest.raises(ValidationError):
        VALIDATOR.validate({"metadata": told | broken, "results": []})


@pytest.mark.parametrize("broken", [{"job": "a"}, {"value": {"nested": 1}}, {"value": [[1]]}])
def test_rows_of_another_form_are_refused(broken: dict[str, Any]) -> None:
    told, row = metadata({}), {"job": "0123456789ab", "scene": "a", "value": 1.0}
    VALIDATOR.validate({"metadata": told, "results": [row]})
    with pytest.raises(ValidationError):
        VALIDATOR.validate({"metadata": told, "results": [row | broken]})


def test_a_document_that_cannot_be_written_leaves_the_last_one(tmp_path, monkeypatch):
    path = tmp_path / "study.json"
    write_document(path, {"a": 1}, [{"b": 2}])
    whole, write = path.read_text(), Path.write_text

    def breaks(self, text, **options):
        write(self, text[: len(text) // 2], **options)
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_text", breaks)
    with pytest.raises(OSError, match="No space left"):
        write_document(path, {"a": 1}, [{"b": 3}])
    assert path.read_text() == whole
