"""What attacks came to: ``OUT/attacks`` gets a document for each kind, of a study's form, and its table.

``python -m tests.fuzz``, ``tests.crash`` and ``tests.mutants`` add to them where ``-o`` names a folder; in
``studies/results`` they are kept, and ``python -m studies.kit.page`` shows them.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from studies.kit.records import code_state, metadata, write_document

FOLDER = "attacks"
Row = Mapping[str, Any]


def begun(settings: dict[str, Any]) -> dict[str, Any]:
    """What a document says of a run that begins now: machine, versions and commit."""
    told = metadata(settings)
    command = told["command"].replace("polaropt study ", "python -m tests.", 1)
    return told | {"command": command, "seeds": "each row names its first seed; nothing was fixed on them before"}


def add(out: Path, name: str, told: dict[str, Any], row: Row) -> None:
    """Add a row to the document of a kind of attack, and write its table anew.

    Parameters
    ----------
    out : Path
    name : str
        Of the kind of attack.
    told : dict
        As `begun` gives it; the document tells that of the latest run, and each row its own commit.
    row : mapping
        The first value names what was attacked; whole numbers but the seed are added up over its rows.
    """
    folder = out / FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    document = folder / f"{name}.json"
    rows = json.loads(document.read_text(encoding="utf-8"))["results"] if document.is_file() else []
    row = {**row, "commit": code_state(told).removeprefix("commit ")}
    job = hashlib.sha256(json.dumps([len(rows), row]).encode()).hexdigest()[:12]
    rows.append({"job": job, **row})
    write_document(document, told, rows)
    (folder / f"{name}.md").write_text(table(rows), encoding="utf-8")


def table(rows: Sequence[Row]) -> str:
    """A line of Markdown for each row, and one of the sums where several are of the same; lists are left out."""
    names = [name for name, value in rows[0].items() if name != "job" and not isinstance(value, list)]
    counted = [name for name in names if isinstance(rows[0][name], int) and name != "seed"]
    lines = [names, ["---"] * len(names)]
    for what in dict.fromkeys(row[names[0]] for row in rows):
        of_one = [row for row in rows if row[names[0]] == what]
        lines += [[row[name] for name in names] for row in of_one]
        if len(of_one) > 1:
            sums = {name: sum(row[name] for row in of_one) for name in counted}
            lines.append([f"{what}, all", *(sums.get(name, "") for name in names[1:])])
    return "".join(f"| {' | '.join(map(str, line))} |\n" for line in lines)
