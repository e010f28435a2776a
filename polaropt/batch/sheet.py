"""``index.html``: a contact sheet of a batch, sorted and filtered in the browser."""

from __future__ import annotations

import json
import os
from collections import Counter
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any
from urllib.parse import quote

from polaropt.batch.job import DISAGREES, DONE, REPORT, Row
from polaropt.capture import result_file
from polaropt.judging import SeparationWarning
from polaropt.reporting import THUMBNAIL

SHEET = "index.html"
_TEMPLATE = "sheet_template.html"
_PAGE = "report.html"


def write_sheet(folder: Path, rows: Sequence[Row]) -> None:
    """Write the page. It shows thumbnails of the captures' folders and holds no picture itself.

    Parameters
    ----------
    folder : Path
        Of all results.
    rows : sequence of Row
    """
    from jinja2 import Environment, StrictUndefined

    environment = Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True, undefined=StrictUndefined)
    template = environment.from_string(files("polaropt.batch").joinpath(_TEMPLATE).read_text(encoding="utf-8"))
    counts = Counter(name for row in rows for name in row.warnings)
    page = template.render(
        n=len(rows),
        n_failed=sum(row.status != DONE for row in rows),
        warnings=[{"name": name, "count": count, "sentence": _sentence(name)} for name, count in counts.most_common()],
        # In a script "</" would end it.
        rows=json.dumps([_shown(folder, row) for row in rows], separators=(",", ":")).replace("</", "<\\/"),
    )
    with result_file(folder / SHEET) as work:
        work.write_text(page, encoding="utf-8", errors="backslashreplace")


def _sentence(warning: str) -> str:
    if warning == DISAGREES:
        return "The capture disagrees with the scene that the others share with it."
    # Journals may be of another version, or damaged.
    known = SeparationWarning.__members__.get(warning)
    return warning if known is None else str(known.value)


def _shown(folder: Path, row: Row) -> dict[str, Any]:
    """What the page's script knows of a capture."""
    told: dict[str, Any] = {"name": row.name, "seconds": round(row.seconds, 2)}
    if row.status != DONE:
        return {**told, "message": row.message or row.status}
    place = quote(os.fsencode(row.folder))
    report = _PAGE if (folder / row.folder / _PAGE).is_file() else REPORT
    told |= {"picture": f"{place}/{THUMBNAIL}", "report": f"{place}/{report}", "warnings": list(row.warnings)}
    return {**told, "rung": row.scene["rung"], "incidence": row.scene.get("incidence_deg"), "misfit": row.misfit}
