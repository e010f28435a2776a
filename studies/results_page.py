"""``python -m studies.results_page [OUT]``: keep the results of a run, and show their tables in studies/README.md.

``OUT`` is a folder that ``polaropt study`` wrote; tables, figures and small data of each study in it replace those in
studies/results. Without it the page alone is made anew. What the page says of a table is written by hand around it.
"""

from __future__ import annotations

import argparse
import json
import re
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path

from studies.catalogue import STUDIES
from studies.record import origin

RESULTS = Path(__file__).parent / "results"
PAGE = Path(__file__).parent / "README.md"
_KEPT = (".md", ".json", ".csv", ".png")
_LARGEST_BYTES = 700_000
_MARKED = re.compile(r"<!-- (?P<study>\w+)/(?P<file>[\w.]+) -->\n.*?<!-- end -->", re.DOTALL)


def keep(out: Path, results: Path = RESULTS) -> list[str]:
    """Replace the kept results of every study that a folder holds; what is too large for a repository is left out.

    The rows are kept in any case: the page tells from them what was run.

    Returns
    -------
    list of str
        The studies' names.
    """
    there = [study.name for study in STUDIES if (out / study.name / f"{study.name}.json").is_file()]
    for name in there:
        target = results / name
        shutil.rmtree(target, ignore_errors=True)
        target.mkdir(parents=True)
        for file in sorted((out / name).iterdir()):
            if file.name == f"{name}.json":
                _keep_rows(file, target / file.name)
            elif file.suffix in _KEPT and file.stat().st_size <= _LARGEST_BYTES:
                shutil.copy(file, target / file.name)
    return there


def _keep_rows(file: Path, target: Path) -> None:
    """Copy a document without blanks, which are half of it."""
    document = json.loads(file.read_text(encoding="utf-8"))
    target.write_text(json.dumps(document, separators=(",", ":"), allow_nan=False) + "\n", encoding="utf-8")


def page(text: str, results: Path = RESULTS) -> str:
    """The page with what its marks name: ``<!-- STUDY/FILE -->`` ... ``<!-- end -->``.

    Parameters
    ----------
    text : str
        Of studies/README.md.
    results : Path
    """
    return _MARKED.sub(lambda mark: _filled(mark["study"], mark["file"], results), text)


def _filled(study: str, name: str, results: Path) -> str:
    file = results / study / name
    begin, end = f"<!-- {study}/{name} -->\n", "<!-- end -->"
    if file.suffix == ".png":
        return f"{begin}![{file.stem.replace('_', ' ')}]({results.name}/{study}/{name})\n{end}"
    # The study's own headings stand below the page's.
    table = re.sub(r"^#", "###", file.read_text(encoding="utf-8").strip(), flags=re.MULTILINE)
    return f"{begin}{origin(results / study / f'{study}.json')}\n\n{table}\n\n{end}"


def main(arguments: Sequence[str] | None = None) -> int:
    """Keep a run's results if a folder is given, then refresh the page."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("out", type=Path, nargs="?", help="folder that polaropt study wrote")
    out = parser.parse_args(arguments).out
    if out is not None:
        names = keep(out)
        print(f"kept {', '.join(names) or 'nothing: no study has results there'}")
    PAGE.write_text(page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
