"""Every link within the built pages leads to a file, and to an anchor in it: ``python docs/check_links.py FOLDER``."""

from __future__ import annotations

import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit


class Page(HTMLParser):
    """What a page links to, and the anchors in it."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.anchors: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note a tag's links and its name."""
        for name, value in attrs:
            if name in ("href", "src") and value:
                self.links.append(value)
            elif name == "id" and value:
                self.anchors.add(value)


def broken_links(folder: Path) -> list[str]:
    """A line for each link within `folder` that leads nowhere."""
    files = sorted(folder.resolve().rglob("*.html"))
    # The theme keeps a template, which is no page, among its own files.
    pages = {path: Page(path.read_text(encoding="utf-8")) for path in files if "_static" not in path.parts}
    lines = []
    for path, page in pages.items():
        for link in page.links:
            url = urlsplit(link)
            if url.scheme or url.netloc or url.path.startswith("/"):
                continue
            target = (path.parent / unquote(url.path)).resolve() if url.path else path
            target = target / "index.html" if target.is_dir() else target
            anchor = unquote(url.fragment)
            if not target.exists():
                lines.append(f"{path.relative_to(folder.resolve())}: {link} is not there")
            elif anchor and target in pages and anchor not in pages[target].anchors:
                lines.append(f"{path.relative_to(folder.resolve())}: {link} has no such anchor")
    return lines


def main() -> int:
    """Print what is broken; 1 if anything is."""
    lines = broken_links(Path(sys.argv[1]))
    print(*lines, sep="\n", end="\n" if lines else "")
    return int(bool(lines))


if __name__ == "__main__":
    sys.exit(main())
