"""One HTML page that shows the tables and figures of all studies in a folder."""

from __future__ import annotations

import html
import re
from pathlib import Path

from studies.catalogue import STUDIES, Study
from studies.record import origin

_STYLE = """
:root { color-scheme: light dark; }
body { font: 16px/1.5 system-ui, sans-serif; max-width: 75rem; margin: 2rem auto; padding: 0 1rem; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-size: 0.85rem; font-variant-numeric: tabular-nums; }
th, td { border-bottom: 1px solid #8886; padding: 0.25rem 0.6rem; text-align: right; }
th:first-child, td:first-child { text-align: left; }
figure { margin: 1.5rem 0; }
img { max-width: 100%; background: white; }
iframe { width: 100%; height: 42rem; border: 1px solid #8886; background: white; }
"""
_WORDS = (
    "<p><b>T</b> and <b>R</b> are the transmission (what is behind the glass) and the reflection (what it mirrors). "
    "Accuracy is PSNR in dB, 16 px at the border left out: 20 dB is an error of 10 % of white, 40 dB of 1 %. "
    "<b>SSIM</b> is structural similarity, 1 is perfect. <b>Blind</b>: nothing is told of the pane; <b>known</b>: it "
    "is given. <b>s0</b> is the plain intensity, which is what doing nothing shows. <b>theta</b>, the incidence, is "
    "the angle in degrees between the view and the glass's normal. <b>s</b>: seconds. A <b>rung</b> is a model of the "
    "scene, from few to more parameters; <b>auto</b> lets the photographs choose.</p>"
)


def write_index(out: Path) -> Path:
    """Write ``index.html`` into a folder whose subfolders bear the names of studies.

    Parameters
    ----------
    out : Path

    Returns
    -------
    Path
        The page. Pictures and data are linked beside it.
    """
    out.mkdir(parents=True, exist_ok=True)
    there = [study for study in STUDIES if (out / study.name).is_dir()]
    links = "".join(f'<li><a href="#{study.name}">{html.escape(study.question)}</a></li>' for study in there)
    sections = "".join(_section(study, out) for study in there)
    page = (
        '<!doctype html><html lang="en"><head><meta charset="utf-8"><title>polaropt: studies</title>'
        f'<meta name="viewport" content="width=device-width"><style>{_STYLE}</style></head><body>'
        f"<h1>polaropt: studies</h1>{_WORDS}<nav><ul>{links}</ul></nav>{sections}</body></html>\n"
    )
    target = out / "index.html"
    target.write_text(page, encoding="utf-8")
    return target


def _section(study: Study, out: Path) -> str:
    from markdown_it import MarkdownIt

    folder = out / study.name
    markdown = MarkdownIt("commonmark").enable("table")
    # A table's own headings stand below the study's.
    tables = [
        markdown.render(re.sub(r"^#", "###", file.read_text(encoding="utf-8"), flags=re.MULTILINE))
        for file in sorted(folder.glob("*.md"))
    ]
    document = folder / f"{study.name}.json"
    command = markdown.renderInline(origin(document)) if document.is_file() else "It has not come to its end."
    pictures = [file for file in sorted(folder.iterdir()) if _shown(file)]
    figures = "".join(
        f'<figure><img src="{study.name}/{file.name}" alt="{html.escape(_caption(file))}">'
        f"<figcaption>{html.escape(_caption(file))}</figcaption></figure>"
        for file in pictures
    )
    data = ", ".join(
        f'<a href="{study.name}/{file.name}">{file.name}</a>'
        for file in sorted(folder.iterdir())
        if file.suffix in (".json", ".csv", ".html")
    )
    return (
        f'<section id="{study.name}"><h2>{html.escape(study.question)}</h2>'
        f"<p>{command} Data: {data}</p>"
        f'<div class="wide">{"".join(tables)}</div>{_pages(study, folder)}{figures}</section>'
    )


def _pages(study: Study, folder: Path) -> str:
    """The study's own pages within this one, loaded when they come into sight."""
    return "".join(
        f'<iframe src="{study.name}/{file.name}" title="{html.escape(_caption(file))}" loading="lazy"></iframe>'
        for file in sorted(folder.glob("*.html"))
    )


def _shown(file: Path) -> bool:
    """A figure; of those that come as PNG and SVG, the SVG."""
    return file.suffix == ".svg" or (file.suffix == ".png" and not file.with_suffix(".svg").exists())


def _caption(file: Path) -> str:
    return file.stem.replace("_", " ")
