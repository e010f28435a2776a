"""The order of the house: who may import whom, through which doors, and how large rooms may grow."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

import polaropt

ROOT = Path(__file__).parent.parent
PACKAGES = ("polaropt", "solvers", "priors", "studies")
MODULES = sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))
FOLDERS = sorted({path.parent for path in MODULES})
FORBIDDEN = {
    "polaropt": {"studies", "tests"},
    "solvers": {"polaropt", "priors", "studies", "tests"},
    "priors": {"polaropt", "solvers", "studies", "tests"},
    "studies": {"tests"},
}
# What each wing of polaropt/ may import; `cli` may import all, `__main__` only that.
_CAPTURES = {"errors", "numerics", "optics", "progress"}
_INVERSION = _CAPTURES | {"capture"}
_SOLVING = _INVERSION | {"inversion", "progress"}
_JUDGING = _SOLVING | {"estimation", "solving"}
_SEPARATION = _JUDGING | {"judging", "kernels"}
BELOW = {
    "errors": set(),
    "interruption": set(),
    "progress": set(),
    "kernels": set(),
    "numerics": {"errors"},
    "optics": {"errors", "numerics"},
    "capture": _CAPTURES,
    "inversion": _INVERSION,
    "simulation": _INVERSION,
    "estimation": _INVERSION | {"inversion"},
    "solving": _SOLVING,
    "judging": _JUDGING,
    "separation": _SEPARATION,
    "reporting": _SEPARATION | {"separation"},
    "batch": _SEPARATION | {"separation", "reporting"},
    "sequence": _SEPARATION | {"separation", "reporting", "batch"},
    "web": _SEPARATION | {"separation", "reporting", "batch"},
    "training": _SOLVING | {"simulation", "solving"},
    "api": _SEPARATION | {"separation", "reporting", "batch", "sequence"},
    "napari": _SEPARATION | {"reporting", "api"},
}
INSIDE_ESTIMATION = ("flat", "wide", "polarized")
HEAVY = ("torch", "casadi", "nlopt", "kornia", "matplotlib", "scipy", "skimage", "cv2", "sklearn", "pandas", "zarr")
HEAVY += ("dask", "distributed", "starlette", "uvicorn", "napari", "magicgui")
MOST_LINES, MOST_LINES_OF_A_FUNCTION, MOST_MODULES = 800, 100, 12


def short(path: Path) -> str:
    return str(path.relative_to(ROOT))


@cache
def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def imported(path: Path) -> tuple[str, ...]:
    """Dotted modules that a module imports anywhere: in functions, for types, and by `import_module`."""
    return tuple(_imported(path))


def _imported(path: Path) -> Iterator[str]:
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"an import of {short(path)} is not absolute"
            assert node.module
            # `from package import module` imports the module.
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Call) and node.args and _last_name(node.func) == "import_module":
            named = node.args[0]
            if isinstance(named, ast.Constant):
                yield str(named.value)


def _last_name(called: ast.expr) -> str:
    """Of what is called, behind its last dot."""
    return called.id if isinstance(called, ast.Name) else called.attr if isinstance(called, ast.Attribute) else ""


def dotted(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


NAMES = {dotted(path) for path in MODULES}


def module_of(name: str) -> str:
    """The project's module that an imported name is or lives in; empty for what is not the project's."""
    while name and name not in NAMES:
        name = name.rpartition(".")[0]
    return name


def wing(module: str) -> str:
    return module.split(".")[1] if module.startswith("polaropt.") else ""


def test_there_are_modules_to_look_at() -> None:
    assert {path.relative_to(ROOT).parts[0] for path in MODULES} == set(PACKAGES)
    assert set(BELOW) | {"cli", "__main__"} == {wing(name) for name in NAMES} - {""}


def test_imports_go_downstairs_only() -> None:
    upstairs = {
        short(path): {name.split(".")[0] for name in imported(path)} & FORBIDDEN[path.relative_to(ROOT).parts[0]]
        for path in MODULES
    }
    assert {path: names for path, names in upstairs.items() if names} == {}


def test_wings_import_those_below_through_their_faces() -> None:
    wrong = []
    for path in MODULES:
        here = wing(dotted(path))
        for name in imported(path):
            module = module_of(name)
            if not wing(module) or wing(module) == here:
                continue
            if here in BELOW and wing(module) not in BELOW[here]:
                wrong.append(f"{short(path)} imports {module}, which is not below {here}")
            if here and module.count(".") > 1:
                wrong.append(f"{short(path)} imports {module}, which is behind the face of its wing")
    assert wrong == []


@pytest.mark.parametrize("package", [package for package in PACKAGES if package != "studies"])
def test_no_imports_run_in_a_circle(package: str) -> None:
    own = [path for path in MODULES if path.relative_to(ROOT).parts[0] == package]
    graph = {dotted(path): {module_of(name) for name in imported(path)} - {"", dotted(path)} for path in own}
    list(TopologicalSorter(graph).static_order())


def test_inside_estimation_the_simple_knows_nothing_of_the_involved() -> None:
    for path in (ROOT / "polaropt" / "estimation").rglob("*.py"):
        own = path.parent.name
        for name in imported(path):
            there = module_of(name).split(".")
            if own in INSIDE_ESTIMATION and there[:2] == ["polaropt", "estimation"]:
                assert there[2] in INSIDE_ESTIMATION[: INSIDE_ESTIMATION.index(own) + 1]


def test_modules_and_functions_are_no_larger_than_one_can_read() -> None:
    larger = []
    for path in MODULES:
        if (length := len(path.read_text(encoding="utf-8").splitlines())) > MOST_LINES:
            larger.append(f"{short(path)}: {length} lines")
        for node in ast.walk(tree_of(path)):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                length = (node.end_lineno or node.lineno) - node.lineno + 1 - docstring_lines(node)
                if length > MOST_LINES_OF_A_FUNCTION:
                    larger.append(f"{short(path)}: {node.name} has {length} lines")
    assert larger == []


def docstring_lines(node: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    first = node.body[0]
    if ast.get_docstring(node) is None:
        return 0
    return (first.end_lineno or first.lineno) - first.lineno + 1


def test_a_folder_holds_a_dozen_rooms() -> None:
    rooms = {folder: [path for path in folder.glob("*.py") if not path.name.startswith("__")] for folder in FOLDERS}
    crowded = [short(folder) for folder, found in rooms.items() if len(found) > MOST_MODULES]
    assert set(crowded) <= {"studies"}


def test_every_module_says_what_it_is() -> None:
    written = [path for path in MODULES if path.read_text(encoding="utf-8").strip()]
    assert [short(path) for path in written if not ast.get_docstring(tree_of(path))] == []


@pytest.mark.parametrize("module", ["polaropt", "solvers", "priors"])
def test_importing_is_cheap(module: str) -> None:
    code = f"import sys, {module}; print(*(name for name in {HEAVY!r} if name in sys.modules))"
    ran = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert ran.stdout.split() == []


def test_every_public_name_is_there() -> None:
    assert [name for name in polaropt.__all__ if not getattr(polaropt, name).__doc__] == []


@pytest.mark.parametrize(
    "wing", [folder.name for folder in (ROOT / "polaropt").iterdir() if (folder / "__init__.pyi").exists()]
)
def test_a_face_shows_what_it_names_and_no_module(wing: str) -> None:
    face = __import__(f"polaropt.{wing}", fromlist=["*"])
    rooms = {path.stem for path in (ROOT / "polaropt" / wing).iterdir()}
    for name in face.__all__:
        assert name not in rooms, "the import of a module would hide it"
        assert hasattr(face, name)


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="nonsense"):
        _ = polaropt.nonsense
