"""``python -m tests.mutants --number N``: lines broken one by one, and which of them the tests of their module catch.

cosmic-ray breaks them (``pip install 'polaropt[mutants]'``): an operator, a comparison or a truth becomes its opposite,
a loop is left out. Numbers are left alone: those that are set by hand change figures, which studies hold. What is
broken stands in a copy.
"""

from __future__ import annotations

import argparse
import ast
import os
import random
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from tests.attacks import add, begun

ROOT = Path(__file__).parents[1]
COPIED = ("polaropt", "priors", "solvers", "studies", "tests", "pyproject.toml")
SECONDS = 900
"""What the tests of a module may take: a line whose loss makes them hang is caught."""

_VALUES = "tests/test_values.py"
_IN_PLACE = "tests/optics/test_in_place.py"
_PLATE = (_IN_PLACE, "tests/optics/test_fresnel.py", "tests/optics/test_plate.py", "tests/optics/test_stack.py")
_ENGINE = ("tests/optics/test_forward.py", "tests/optics/test_stack.py", "tests/optics/test_varying.py")
_SCENE = ("tests/optics/test_scene.py", "tests/optics/test_stack.py")
_WARNED = ("tests/judging/test_limits_of_warnings.py", "tests/judging/test_diagnostics.py")
_ERRORS = ("tests/judging/test_uncertainty.py", "tests/judging/test_scene_uncertainty.py")
_WRITTEN = (
    "tests/capture/test_output.py",
    "tests/capture/test_large_png.py",
    "tests/capture/test_image_io.py",
    "tests/capture/test_camera_facts.py",
    "tests/capture/test_color_profiles.py",
    "tests/test_crashes.py",
)
_CHOICES = (
    "tests/estimation/test_safeguard.py",
    "tests/estimation/test_pane.py",
    "tests/estimation/test_polarized.py",
    "tests/judging/test_diagnostics.py",
)
TESTS: dict[str, tuple[str, ...]] = {
    "polaropt/optics/analyzer.py": ("tests/optics/test_analyzer.py",),
    "polaropt/optics/engine.py": _ENGINE,
    "polaropt/optics/fresnel.py": _PLATE,
    "polaropt/optics/geometry.py": ("tests/optics/test_geometry.py", "tests/optics/test_varying.py"),
    "polaropt/optics/plate.py": _PLATE,
    "polaropt/optics/sampling.py": ("tests/optics/test_sampling.py",),
    "polaropt/optics/scene.py": _SCENE,
    "polaropt/optics/shift.py": (_IN_PLACE, "tests/optics/test_shift.py", "tests/optics/test_forward.py"),
    "polaropt/optics/stack.py": ("tests/optics/test_stack.py",),
    "polaropt/optics/stokes.py": ("tests/optics/test_stokes.py",),
    "polaropt/judging/loss.py": _ERRORS[1:],
    "polaropt/judging/precision.py": _ERRORS,
    "polaropt/judging/uncertainty.py": _ERRORS,
    "polaropt/judging/warnings.py": _WARNED,
    "polaropt/estimation/ladder.py": ("tests/estimation/test_ladder.py", *_CHOICES),
    "polaropt/estimation/rungs.py": ("tests/estimation/test_ladder.py", *_CHOICES),
    "polaropt/estimation/safeguard.py": _CHOICES,
    "polaropt/capture/files/results.py": _WRITTEN,
    "polaropt/capture/files/write.py": _WRITTEN,
    "polaropt/reporting/files.py": (
        "tests/cli/test_cli.py",
        "tests/reporting/test_files.py",
        "tests/reporting/test_html_report.py",
        "tests/reporting/test_motion_report.py",
    ),
    "polaropt/reporting/report.py": ("tests/reporting/test_report.py", "tests/cli/test_cli.py"),
}
"""Modules of the physics, of what is judged, chosen and written, and the tests that are to catch what breaks there."""
OPERATORS = (
    *(f"ReplaceBinaryOperator_{pair}" for pair in ("Add_Sub", "Sub_Add", "Mul_Div", "Div_Mul")),
    *(
        f"ReplaceComparisonOperator_{pair}"
        for pair in ("Eq_NotEq", "NotEq_Eq", "Lt_GtE", "LtE_Gt", "Gt_LtE", "GtE_Lt", "Is_IsNot", "IsNot_Is")
    ),
    *(f"ReplaceUnaryOperator_Delete_{sign}" for sign in ("USub", "Not")),
    *("ReplaceTrueWithFalse", "ReplaceFalseWithTrue", "ReplaceAndWithOr", "ReplaceOrWithAnd", "ZeroIterationForLoop"),
)


@dataclass(frozen=True)
class Mutant:
    """One line broken in one way: the operator's so many-th place in the module."""

    module: str
    operator: str
    occurrence: int
    line: int


def mutants_of(module: str) -> Iterator[Mutant]:
    """All of a module, but for what `_idle` finds, and stars that multiply nothing."""
    from cosmic_ray.ast import ast_nodes, get_ast
    from cosmic_ray.plugins import get_operator

    source = (ROOT / module).read_text(encoding="utf-8")
    idle, lines = list(_idle(ast.parse(source))), source.splitlines()
    for name in OPERATORS:
        operator = get_operator(f"core/{name}")()
        places = (place for node in ast_nodes(get_ast(source)) for place in operator.mutation_positions(node))
        for occurrence, (start, _) in enumerate(places):
            star = lines[start[0] - 1].startswith("*,", start[1])
            if not star and not any(first <= start < last for first, last in idle):
                yield Mutant(module, name, occurrence, start[0])


def _idle(tree: ast.Module) -> Iterator[tuple[tuple[int, int], tuple[int, int]]]:
    """Where annotations, and values of ``strict`` of `zip`, begin and end, as (line, column)."""
    for node in ast.walk(tree):
        strict = isinstance(node, ast.keyword) and node.arg == "strict"
        for name in ("value",) if strict else ("annotation", "returns"):
            part = getattr(node, name, None)
            if isinstance(part, ast.expr):
                yield (part.lineno, part.col_offset), (part.end_lineno or 0, part.end_col_offset or 0)


def survives(mutant: Mutant, place: Path) -> bool:
    """Whether the tests of its module pass in a copy of the repository with a broken line."""
    from cosmic_ray.mutating import mutate_code
    from cosmic_ray.plugins import get_operator

    file = place / mutant.module
    source, stamps = file.read_text(encoding="utf-8"), file.stat()
    broken = mutate_code(source, get_operator(f"core/{mutant.operator}")(), mutant.occurrence)
    file.write_text(broken, encoding="utf-8")
    try:
        done = subprocess.run(
            [
                sys.executable,
                "-m",
                "pytest",
                "-x",
                "-q",
                "-p",
                "no:cacheprovider",
                "-p",
                "no:xdist",
                _VALUES,
                *TESTS[mutant.module],
            ],
            cwd=place,
            env={**os.environ, "PYTHONPATH": str(place)},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            timeout=SECONDS,
        )
    except subprocess.TimeoutExpired:
        return False
    finally:
        file.write_text(source, encoding="utf-8")
        # As it was, so that kernels need not be compiled again.
        os.utime(file, ns=(stamps.st_atime_ns, stamps.st_mtime_ns))
    return done.returncode == 0


def main() -> int:
    """Break lines, tell which nothing caught, and which share was."""
    parser = argparse.ArgumentParser(prog="python -m tests.mutants", description=__doc__)
    parser.add_argument("--number", type=int, default=60, help="How many lines are broken, drawn from all.")
    parser.add_argument("--seed", type=int, default=0, help="Of the draw.")
    parser.add_argument("--only", default="", help="Modules whose path contains this.")
    parser.add_argument("-o", "--out", type=Path, help="Folder of results, which get the counts and what survived.")
    options = parser.parse_args()
    told = begun({"only": options.only}) if options.out is not None else {}
    every = [mutant for module in TESTS if options.only in module for mutant in mutants_of(module)]
    drawn = random.Random(options.seed).sample(every, min(options.number, len(every)))
    survivors: list[Mutant] = []
    broken = 0
    try:
        with tempfile.TemporaryDirectory(prefix="polaropt-mutants-") as folder:
            place = Path(folder)
            for name in COPIED:
                (shutil.copytree if (ROOT / name).is_dir() else shutil.copy2)(ROOT / name, place / name)
            for mutant in drawn:
                survived = survives(mutant, place)
                broken += 1
                survivors += [mutant] * survived
                how = "SURVIVED" if survived else "caught"
                print(f"{broken}: {how} {mutant.module}:{mutant.line} {mutant.operator}", flush=True)
    finally:
        # What was done counts, however it ends: they come in random order.
        caught = broken - len(survivors)
        share = round(100 * caught / max(1, broken))
        print(f"{caught} of {broken} caught ({share} %), of {len(every)} that there are")
        if options.out is not None and broken:
            row = {"what": options.only or "lines", "seed": options.seed, "broken": broken, "caught": caught}
            left = [f"{mutant.module}:{mutant.line} {mutant.operator} {mutant.occurrence}" for mutant in survivors]
            add(options.out, "mutants", told, {**row, "survivors": left})
    return 0


if __name__ == "__main__":
    sys.exit(main())
