"""What README and the documentation say: their pages, and the commands in them."""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
# Shipped in the package: report.html shows what a warning means.
WARNINGS = ROOT / "polaropt" / "reporting" / "warnings.md"
PAGES = [ROOT / "README.md", WARNINGS, *sorted(path for path in DOCS.rglob("*.md") if "_build" not in path.parts)]
_BLOCK = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_INDENTED = re.compile(r"(?:^|\n\n)((?:    .*\n)+)")
_INLINE = re.compile(r"`(polaropt [^`]+|make [a-z]+)`")


class Command(NamedTuple):
    """A line for the command line, and the page that it stands on."""

    page: str
    line: str


def blocks(page: Path, language: str) -> list[str]:
    """Texts of a page's code blocks in that language."""
    return [text for name, text in _BLOCK.findall(page.read_text(encoding="utf-8")) if name == language]


def commands() -> list[Command]:
    """All commands of polaropt and make, once each: in blocks, and those within sentences that are whole."""
    found: dict[str, Command] = {}
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        lines = [line.strip() for block in blocks(page, "bash") for line in block.splitlines()]
        if page.name == "README.md":
            # Comments behind a command explain it.
            lines += [line.split(" # ")[0].strip() for block in _INDENTED.findall(text) for line in block.splitlines()]
        lines += [" ".join(line.split()) for line in _INLINE.findall(text)]
        for line in lines:
            for part in line.split(" && "):
                if part.startswith(("polaropt ", "make ")) and part not in found:
                    found[part] = Command(str(page.relative_to(ROOT)), part)
    return list(found.values())
