"""The form that every study's document has."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from jsonschema import Draft202012Validator

import studies.kit.records

SCHEMA = json.loads(Path(studies.kit.records.__file__).with_name("record.schema.json").read_text(encoding="utf-8"))


def document_of(path: Path) -> dict[str, Any]:
    """A study's document, once it is seen to have the form of all, and rows of the same fields."""
    document: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    Draft202012Validator(SCHEMA).validate(document)
    assert len({tuple(row) for row in document["results"]}) == 1
    return document
