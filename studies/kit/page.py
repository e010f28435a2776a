"""The pages of results: one HTML page of a run, and the tables that are kept in the repository.

A run's page is written into its folder by ``polaropt study``. ``python -m studies.kit.page [OUT ...]`` keeps results:
``OUT`` are folders that ``polaropt study`` wrote; tables, figures and small data of each study in them replace those in
``studies/results``, and ``studies/README.md`` shows them between its marks. Without folders that page alone is made
anew. What it says of a table is written by hand around it.

Every kept result comes from a commit, and the page says which: all of them together take hours, and a study is run
again where what it measures has changed.
"""

from __future__ import annotations

import argparse
import html
import json
import re
import shutil
from collections.abc import Sequence
from pathlib import Path

from studies.catalogue import STUDIES, Study
from studies.kit.captions import caption
from studies.kit.records import code_state, origin, read_metadata

RESULTS = Path(__file__).parents[1] / "results"
PAGE = Path(__file__).parents[1] / "README.md"
KEPT = (".md", ".json", ".csv", ".png")
"""Endings of the files of a study that are kept."""
LARGEST_BYTES = 700_000
"""What is larger, other than a study's rows, is left out: the repository is read by people."""
ATTACKS = "attacks"
"""Folder of what attacks came to, which are no studies: `python -m tests.fuzz -o OUT` and its like write them."""
_MARKED = re.compile(r"<!-- (?P<study>\w+)/(?P<file>[\w.]+) -->\n.*?<!-- end -->", re.DOTALL)
# Lines of cells, the second of them rules; and a cell that begins with a number, or holds none.
_TABLE = re.compile(r"^\|.*\n\|[-:|\s]+\|\n(?:\|.*(?:\n|\Z))+", re.MULTILINE)
_NUMBER = re.compile(r"[-+<>=~]*\s*\d|-?$|nan")
_STATE = re.compile(r"<!-- code state -->\n.*?<!-- end -->", re.DOTALL)

_STYLE = """
:root { color-scheme: light dark; }
body { font: 16px/1.5 system-ui, sans-serif; max-width: 75rem; margin: 2rem auto; padding: 0 1rem; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-size: 0.85rem; font-variant-numeric: tabular-nums; margin: 1.5rem 0; }
th, td { border-bottom: 1px solid #8886; padding: 0.25rem 0.6rem; text-align: left; }
figure { margin: 1.5rem 0; }
img { max-width: 100%; background: white; }
a { color: #0a58ca; }
a:visited { color: #6f2dbd; }
@media (prefers-color-scheme: dark) { a { color: #7db8ff; } a:visited { color: #c9a6ff; } }
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


def _with_numbers_at_right(text: str) -> str:
    """Markdown whose tables have columns of numbers at the right, but for the first, and of words at the left."""

    def aligned(table: re.Match[str]) -> str:
        head, _, *body = table[0].splitlines()
        cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in body]
        rules = [
            "---:" if i and all(_NUMBER.match(line[i]) for line in cells if i < len(line)) else "---"
            for i in range(head.strip("|").count("|") + 1)
        ]
        return "\n".join([head, f"|{'|'.join(rules)}|", *body, ""])

    return _TABLE.sub(aligned, text)


def _section(study: Study, out: Path) -> str:
    from markdown_it import MarkdownIt

    folder = out / study.name
    markdown = MarkdownIt("commonmark").enable("table")
    # A table's own headings stand below the study's.
    tables = [
        markdown.render(
            _with_numbers_at_right(re.sub(r"^#", "###", file.read_text(encoding="utf-8"), flags=re.MULTILINE))
        )
        for file in sorted(folder.glob("*.md"))
    ]
    document = folder / f"{study.name}.json"
    command = (
        markdown.renderInline(origin(read_metadata(document))) if document.is_file() else "It has not come to its end."
    )
    pictures = [file for file in sorted(folder.iterdir()) if _shown(file)]
    figures = "".join(
        f'<figure><img src="{study.name}/{file.name}" alt="{html.escape(caption(file.stem))}">'
        f"<figcaption>{html.escape(caption(file.stem))}</figcaption></figure>"
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
        f'<iframe src="{study.name}/{file.name}" title="{html.escape(caption(file.stem))}" loading="lazy"></iframe>'
        for file in sorted(folder.glob("*.html"))
    )


def _shown(file: Path) -> bool:
    """A figure; of those that come as PNG and SVG, the SVG."""
    return file.suffix == ".svg" or (file.suffix == ".png" and not file.with_suffix(".svg").exists())


def keep(outs: Sequence[Path], results: Path = RESULTS) -> list[str]:
    """Replace the kept results of every study that folders hold; what is too large for a repository is left out.

    The rows are kept in any case: the page tells from them what was run.

    Parameters
    ----------
    outs : sequence of Path
        As ``polaropt study`` wrote them; of a study in several of them the last counts.
    results : Path

    Returns
    -------
    list of str
        The studies' names.

    Raises
    ------
    SystemExit
        A folder is `results` itself, a run has not come to its end, or it comes from code that is no commit; nothing
        is changed.
    """
    if any(out.resolve() == results.resolve() for out in outs):
        raise SystemExit(f"nothing was kept: {results.name} holds what is kept; name folders of runs, or none")
    runs = {study.name: out for study in STUDIES for out in outs if _document(out, study.name).is_file()}
    if changed := [name for name, out in runs.items() if read_metadata(_document(out, name))["modified"]]:
        raise SystemExit(f"nothing was kept: the code was changed without a commit ({', '.join(changed)})")
    if unfinished := [name for name, out in runs.items() if not any((out / name).glob("*.md"))]:
        raise SystemExit(
            f"nothing was kept: without its tables, a run has not come to its end ({', '.join(unfinished)})"
        )
    for name, out in runs.items():
        target = results / name
        shutil.rmtree(target, ignore_errors=True)
        target.mkdir(parents=True)
        for file in sorted((out / name).iterdir()):
            if file.name == f"{name}.json":
                _keep_rows(file, target / file.name)
            elif file.suffix in KEPT and file.stat().st_size <= LARGEST_BYTES:
                shutil.copy(file, target / file.name)
    return list(runs)


def code_states(documents: Sequence[Path]) -> dict[str, list[str]]:
    """The code states that documents come from, each with the names of the studies.

    Two commits with the same sources are one state, named by the first of them; changed code is none of its commit.
    """
    names: dict[tuple[str, bool], str] = {}
    states: dict[str, list[str]] = {}
    for document in documents:
        metadata = read_metadata(document)
        state = names.setdefault((metadata["sources"], metadata["modified"]), code_state(metadata))
        states.setdefault(state, []).append(document.stem)
    return states


def kept_states(results: Path = RESULTS) -> dict[str, list[str]]:
    """The code states that the kept results come from, each with the names of the studies and attacks."""
    documents = [_document(results, study.name) for study in STUDIES]
    return code_states([*filter(Path.is_file, documents), *sorted((results / ATTACKS).glob("*.json"))])


def _document(folder: Path, name: str) -> Path:
    return folder / name / f"{name}.json"


def _keep_rows(file: Path, target: Path) -> None:
    """Copy a document without blanks, which are half of it."""
    document = json.loads(file.read_text(encoding="utf-8"))
    target.write_text(json.dumps(document, separators=(",", ":"), allow_nan=False) + "\n", encoding="utf-8")


def page(text: str, results: Path = RESULTS) -> str:
    """The page with what its marks name: ``<!-- STUDY/FILE -->`` or ``<!-- code state -->`` to ``<!-- end -->``.

    Parameters
    ----------
    text : str
        Of studies/README.md.
    results : Path
    """
    states = kept_states(results)
    text = _STATE.sub(lambda mark: f"<!-- code state -->\n{_state_sentence(states)}\n<!-- end -->", text)
    return _MARKED.sub(lambda mark: _filled(mark["study"], mark["file"], results), text)


def _state_sentence(states: dict[str, list[str]]) -> str:
    if len(states) == 1:
        return f"All results on this page come from {next(iter(states))}."
    several = "; ".join(f"{state} ({', '.join(names)})" for state, names in states.items())
    return f"The results on this page come from several commits: {several}. Each names its own above its table."


def _filled(study: str, name: str, results: Path) -> str:
    file = results / study / name
    begin, end = f"<!-- {study}/{name} -->\n", "<!-- end -->"
    if file.suffix == ".png":
        return f"{begin}![{caption(file.stem)}]({results.name}/{study}/{name})\n{end}"
    # The study's own headings stand below the page's.
    table = re.sub(r"^#", "###", file.read_text(encoding="utf-8").strip(), flags=re.MULTILINE)
    # A study of several parts has a document for each, named like its table.
    own = file.with_suffix(".json")
    document = own if own.is_file() else _document(results, study)
    return f"{begin}{origin(read_metadata(document))}\n\n{table}\n\n{end}"


def main(arguments: Sequence[str] | None = None) -> None:
    """Keep runs' results if folders are given, then refresh the page."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("out", type=Path, nargs="*", help="folders that polaropt study wrote")
    outs = parser.parse_args(arguments).out
    if outs:
        names = keep(outs)
        print(f"kept {', '.join(names) or 'nothing: no study has results there'}")
    PAGE.write_text(page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    main()
