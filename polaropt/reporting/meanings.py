"""What each warning means and what to do, as the documentation's page has it, for who reads a report without it."""

from __future__ import annotations

import re
from functools import lru_cache
from html import escape
from importlib.resources import files

_PAGE = "warnings.md"
_ENTRY = re.compile(r"^### ([A-Z_]+)\n(.*?)(?=^#|^<a|\Z)", re.MULTILINE | re.DOTALL)
# Of MyST: a link to another page or name by its text or its target, what is code, and what is stressed.
_LINK = re.compile(r"\{([a-z:]+)\}`(?:([^`<]+?) <[^`]*>|([^`]+))`")
_CODE = re.compile(r"`([^`]+)`")
_STRESSED = re.compile(r"\*([^*]+)\*")


def meaning_of(name: str) -> str:
    """Paragraphs of HTML beyond the warning's own sentence; empty for a name without an entry.

    Parameters
    ----------
    name : str
        Of a `polaropt.SeparationWarning`.
    """
    return _meanings().get(name, "")


@lru_cache(maxsize=1)
def _meanings() -> dict[str, str]:
    text = files("polaropt.reporting").joinpath(_PAGE).read_text(encoding="utf-8")
    return {name: _html(entry) for name, entry in _ENTRY.findall(text)}


def _html(entry: str) -> str:
    """An entry's paragraphs without the quoted sentence, which stands above them."""
    paragraphs = [" ".join(part.split()) for part in entry.split("\n\n")]
    return "".join(f"<p>{_marked_up(text)}</p>" for text in paragraphs if text and not text.startswith(">"))


def _marked_up(text: str) -> str:
    text = escape(_LINK.sub(_named, text), quote=False)
    return _STRESSED.sub(r"<em>\1</em>", _CODE.sub(r"<code>\1</code>", text))


def _named(link: re.Match[str]) -> str:
    """What a link leads to, in words."""
    role, words, target = link.groups()
    return words or (f"the documentation's page {target}" if role == "doc" else f"`{target}`")
