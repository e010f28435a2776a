"""Which files of folders belong together: a mosaic or a stack is a capture, photographs go by their angles."""

from __future__ import annotations

import glob
import os
import re
import unicodedata
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from polaropt.capture import CAMERA_RAW, HEIF
from polaropt.errors import InputError
from polaropt.reporting import COMPARISON, RESULT_FILES, THUMBNAIL, TRUE_LAYERS

_STACKS = (".npz", ".npy", ".tif", ".tiff", ".png")
"""Names that mosaics and stacks end in. A JPEG or HEIC holds neither."""
_JPEG = (".jpg", ".jpeg")
_PHOTOGRAPHS = (*_STACKS, *_JPEG, *HEIF, *CAMERA_RAW)
_DEGREES = r"(?P<angle>\d{1,3}(?:\.\d+)?)(?:deg|°)?"
_ANGLE = (
    rf"(?:(?:(?<=[^0-9A-Za-z])|^)(?:i|pol|deg|p)?|(?-i:(?<=[0-9a-z])I)){_DEGREES}$",
    rf"^(?:i|pol|deg|p)?{_DEGREES}(?=[ _-])",
)
"""An angle at the end of a name: ``_045``, ``-45``, ``I45``, ``vaseI45``, ``_45deg``, ``_45.0`` or nothing else; or at
its beginning: ``45_vase``."""
_MARKS = " ._-"
_OF_RESULTS = ("batch.jsonl", "sequence.json")
"""Files by which folders of results are known, in which nothing is looked for."""
OF_BATCH = ("batch.jsonl", "scenes.jsonl", "scene.json", "summary.csv", "summary.parquet", "index.html")
"""Files of a batch as a whole: no capture's folder may have their names."""
_WRITTEN_BESIDE = {
    "report.json": frozenset((*RESULT_FILES, THUMBNAIL, COMPARISON, *TRUE_LAYERS)),
    "scene.json": frozenset(TRUE_LAYERS),
    "batch.jsonl": frozenset(OF_BATCH),
}
"""Files by which folders of results, of a simulation and of a batch are known, and what is left out of such a
folder: photographs may lie there, too."""
EACH, FOLDER = "each", "folder"
"""Of --group: each file is a capture; all files of a folder are one, in the order of their names."""


@dataclass(frozen=True)
class Group:
    """Files of one capture.

    Attributes
    ----------
    name : str
        Of the capture, and of its folder; parts are set apart by "/".
    files : tuple of Path
        In the order of the angles.
    problem : str
        Why they are no capture, a sentence without a full stop; empty where they are one.
    """

    name: str
    files: tuple[Path, ...]
    problem: str = ""


@dataclass(frozen=True)
class Leftover:
    """A file that belongs to no capture, and why."""

    file: Path
    reason: str


@dataclass(frozen=True)
class Grouping:
    """Captures of some folders, and what belongs to none."""

    groups: tuple[Group, ...]
    leftovers: tuple[Leftover, ...]


@dataclass(frozen=True)
class _Source:
    """Files that were found under one root, by which captures are named."""

    root: Path
    files: tuple[Path, ...]


def group_sources(
    sources: Sequence[str],
    angles_deg: Sequence[float],
    rule: str | None = None,
    *,
    output: Path,
    headless: bool = False,
) -> Grouping:
    """Captures in folders (recursively), among the files of a pattern, or named one by one.

    Parameters
    ----------
    sources : sequence of str
        Folders, files, or patterns such as ``shots/*.png``.
    angles_deg : sequence of float
        Polarizer angles of photographs, in the order that a capture has them in.
    rule : str, optional
        How photographs are called, such as ``{name}_{angle}.tif``, matched with the end of a path; ``each``: every file
        is a capture; ``folder``: all photographs of a folder are one, in the order of their names. Default: angles at
        the end of names are found.
    output : Path
        Folder of the results, in which nothing is looked for.
    headless : bool
        Whether files without a header are mosaics, too.

    Raises
    ------
    InputError
        A source or a rule that does not exist, or nothing to separate.
    """
    split = _rule_of(rule, angles_deg, headless)
    groups: list[Group] = []
    leftovers: list[Leftover] = []
    seen: set[Path] = set()
    for found in _all_of(sources, output.absolute()):
        # A source may be named twice, in two ways.
        new = tuple(file for file in found.files if Path(os.path.abspath(file)) not in seen)
        seen.update(Path(os.path.abspath(file)) for file in new)
        own, left = split(found.root, new)
        groups += own
        leftovers += left
    if not groups and not leftovers:
        raise InputError(f"{', '.join(sources)}: holds no photographs; give a folder, a pattern or a table of captures")
    return Grouping(tuple(distinct(groups)), tuple(leftovers))


def distinct(groups: Iterable[Group]) -> Iterator[Group]:
    """The same groups, no two of one name, and none of a batch's own files: those that come later are numbered."""
    taken: set[str] = set()
    for group in groups:
        first, *below = group.name.split("/")
        own = "/".join([f"{first}-2" if first.lower() in OF_BATCH else first, *below])
        name, number = own, 2
        # Folders of some systems do not tell cases apart.
        while name.lower() in taken:
            name, number = f"{own}-{number}", number + 1
        taken.add(name.lower())
        yield Group(name, group.files, group.problem)


def _all_of(sources: Sequence[str], output: Path) -> Iterator[_Source]:
    """Files of each folder and pattern; those that are named one by one, as a shell does, belong together."""
    named = tuple(path for path in map(Path, sources) if os.path.exists(path) and not os.path.isdir(path))
    if named:
        yield _Source(Path(os.path.commonpath([path.parent for path in named])), named)
    for source in sources:
        if Path(source) not in named:
            yield _files_of(source, output)


def _files_of(source: str, output: Path) -> _Source:
    path = Path(source)
    if os.path.isdir(path):
        return _Source(path, tuple(_below(path, output)))
    if not glob.has_magic(source):
        raise InputError(f"{source}: no such file or folder; check the name")
    fixed = Path(*_fixed_parts(Path(source).parts))
    found = sorted(Path(name) for name in glob.glob(source, recursive=True))
    if not found:
        raise InputError(f"{source}: no file has such a name; check the pattern")
    files = [file for one in found for file in (_below(one, output) if one.is_dir() else [one])]
    return _Source(fixed, tuple(dict.fromkeys(file for file in files if output not in file.absolute().parents)))


def _fixed_parts(parts: tuple[str, ...]) -> Iterator[str]:
    for part in parts[:-1]:
        if glob.has_magic(part):
            return
        yield part


def _below(folder: Path, output: Path, above: tuple[Path, ...] = ()) -> Iterator[Path]:
    """Files in a folder and below it, in the order of their names; nothing hidden, and no results.

    A link that leads back to a folder `above` would lead round and round.
    """
    real = folder.resolve()
    if real in above:
        return
    above = (*above, real)
    written = {name for sign, names in _WRITTEN_BESIDE.items() if (folder / sign).exists() for name in names}
    for path in sorted(folder.iterdir()):
        if path.name.startswith(".") or path.absolute() == output or path.name in written:
            continue
        if path.is_dir():
            if not any((path / name).exists() for name in _OF_RESULTS):
                yield from _below(path, output, above)
        else:
            yield path


def _by_folder(files: Iterable[Path]) -> Iterator[tuple[Path, list[Path]]]:
    folders: dict[Path, list[Path]] = {}
    for file in files:
        folders.setdefault(file.parent, []).append(file)
    yield from folders.items()


def _named(group: Group, root: Path, folder: Path) -> Group:
    """With the folders between root and files before its name; all photographs of a folder have the folder's name."""
    between = folder.relative_to(root).parts if folder.is_relative_to(root) else ()
    parts = [*between, *([group.name] if group.name else [])] or [folder.absolute().name]
    return Group(str(PurePosixPath(*parts)), group.files, group.problem)


_Split = Callable[[Path, Sequence[Path]], tuple[list[Group], list[Leftover]]]
_OfFolder = Callable[[list[Path]], tuple[list[Group], list[Leftover]]]


def _rule_of(rule: str | None, angles_deg: Sequence[float], headless: bool) -> _Split:
    stacks = (*_STACKS, ".raw", ".bin") if headless else _STACKS
    if rule is None:
        return _folder_by_folder(lambda files: _found(files, angles_deg, stacks))
    if rule == EACH:
        return _folder_by_folder(lambda files: ([Group(file.stem, (file,)) for file in files], []))
    if rule == FOLDER:
        return _folder_by_folder(lambda files: _whole_folder(files, angles_deg))
    pattern = _pattern_of(rule)
    return lambda root, files: _by_pattern(root, files, pattern, rule, angles_deg)


def _folder_by_folder(split: _OfFolder) -> _Split:
    """A rule for the files of each folder by themselves."""

    def of_all(root: Path, files: Sequence[Path]) -> tuple[list[Group], list[Leftover]]:
        groups: list[Group] = []
        leftovers: list[Leftover] = []
        for folder, inside in _by_folder(files):
            own, left = split(inside)
            groups += [_named(group, root, folder) for group in own]
            leftovers += left
        return groups, leftovers

    return of_all


def _pattern_of(rule: str) -> re.Pattern[str]:
    parts = re.split(r"(\{[^{}]*\})", rule)
    fields = [part for part in parts if part.startswith("{")]
    if sorted(fields) != ["{angle}", "{name}"]:
        raise InputError(
            f"--group is {rule!r}; give a pattern with {{name}} and {{angle}}, such as '{{name}}_{{angle}}.tif', "
            f"or {EACH} or {FOLDER}"
        )
    known = {"{name}": r"(?P<name>[^/]+?)", "{angle}": r"(?P<angle>\d{1,3}(?:\.\d+)?)"}
    return re.compile("(?P<before>(?:.*/)?)" + "".join(known.get(part, re.escape(part)) for part in parts) + "$")


def _by_pattern(
    root: Path, files: Sequence[Path], pattern: re.Pattern[str], rule: str, angles_deg: Sequence[float]
) -> tuple[list[Group], list[Leftover]]:
    photographs: dict[str, dict[float, Path]] = {}
    leftovers = []
    for file in files:
        match = pattern.match((file.relative_to(root) if file.is_relative_to(root) else file).as_posix())
        if match is None:
            leftovers.append(Leftover(file, f"its name is not of the form {rule}"))
        else:
            found = photographs.setdefault(match["before"] + match["name"], {})
            first = found.setdefault(float(match["angle"]) % 180, file)
            if first is not file:
                leftovers.append(_twice(file, first))
    return [_of_angles(name, found, angles_deg) for name, found in photographs.items()], leftovers


def _of_angles(name: str, found: dict[float, Path], angles_deg: Sequence[float]) -> Group:
    """Photographs in the order of the angles, or what is missing."""
    wanted = [angle % 180 for angle in angles_deg]
    missing = [f"{angle:g}" for angle in wanted if angle not in found]
    more = [f"{angle:g}" for angle in found if angle not in wanted]
    if missing:
        have = ", ".join(f"{angle:g}" for angle in sorted(found))
        return Group(name, tuple(found.values()), f"has angles {have}; {', '.join(missing)} missing")
    if more:
        return Group(name, tuple(found.values()), f"has angles {', '.join(more)}, too; name all of them by --angles")
    return Group(name, tuple(found[angle] for angle in wanted))


def _found(files: list[Path], angles_deg: Sequence[float], stacks: Sequence[str]) -> tuple[list[Group], list[Leftover]]:
    """Angles at the end of names make photographs; other files are mosaics and stacks."""
    groups: list[Group] = []
    leftovers: list[Leftover] = []
    turned: dict[tuple[str, str], dict[float, Path]] = {}
    again: dict[tuple[str, str], list[tuple[float, Path]]] = {}
    single: list[Path] = []
    wanted = {angle % 180 for angle in angles_deg}
    for file in files:
        told = angles_in_name(file)
        called = next((one for one in told if one[1] in wanted), told[0] if told else None)
        if called is not None and file.suffix.lower() in _PHOTOGRAPHS:
            alike = called[0], file.suffix.lower()
            if turned.setdefault(alike, {}).setdefault(called[1], file) is not file:
                again.setdefault(alike, []).append((called[1], file))
        else:
            single.append(file)
    for alike, found in turned.items():
        others = again.get(alike, ())
        # Of 000, 001, ... the numbers count files.
        if len(found) > 1 and set(found) <= wanted:
            groups.append(_of_angles(alike[0], found, angles_deg))
            leftovers += [_twice(file, found[angle]) for angle, file in others]
        else:
            single += [*found.values(), *(file for _, file in others)]
    raw = [file for file in single if file.suffix.lower() in CAMERA_RAW]
    if len(raw) == len(angles_deg):
        groups.append(Group("", tuple(sorted(raw))))
        single = [file for file in single if file not in raw]
    for file in sorted(single):
        if file.suffix.lower() in stacks:
            groups.append(Group(file.stem, (file,)))
        else:
            leftovers.append(Leftover(file, _no_capture(file, angles_deg)))
    return groups, leftovers


def _angle_of(file: Path, pattern: str) -> tuple[str, float] | None:
    """The rest of a photograph's name and its angle, where that stands as one of the patterns has it."""
    stem = unicodedata.normalize("NFC", file.stem)
    match = re.search(pattern, stem, re.IGNORECASE)
    if match is None:
        return None
    return (stem[: match.start()] + stem[match.end() :]).strip(_MARKS), float(match["angle"])


def angles_in_name(file: Path) -> list[tuple[str, float]]:
    """What a photograph's name is beside an angle that it ends or begins with, and the angle."""
    told = (_angle_of(file, pattern) for pattern in _ANGLE)
    return [one for one in told if one is not None]


def angles_in_names(files: Sequence[Path]) -> tuple[float, ...]:
    """The angles that names end in, or begin with, in the order of the files; empty unless each has one of its own."""
    for pattern in _ANGLE:
        angles = tuple(told[1] for file in files if (told := _angle_of(file, pattern)) is not None)
        if len(angles) == len(set(angles)) == len(files):
            return angles
    return ()


def _twice(file: Path, first: Path) -> Leftover:
    return Leftover(file, f"its name tells the capture and the angle that {first.name} tells, too; see --group")


def _no_capture(file: Path, angles_deg: Sequence[float]) -> str:
    suffix = file.suffix.lower()
    if suffix in (".raw", ".bin"):
        return "a mosaic without a header; give its --shape"
    if suffix in CAMERA_RAW:
        return f"raw files of a camera go together where a folder holds {len(angles_deg)}, or by --group"
    if suffix in (*_JPEG, *HEIF):
        kind = "JPEG" if suffix in _JPEG else "HEIC"
        return f"a {kind} is no mosaic, and its name tells no angle; see --group"
    return "no file of photographs"


def _whole_folder(files: list[Path], angles_deg: Sequence[float]) -> tuple[list[Group], list[Leftover]]:
    photographs = sorted(file for file in files if file.suffix.lower() in _PHOTOGRAPHS)
    others = [Leftover(file, "no file of photographs") for file in files if file not in photographs]
    if not photographs:
        return [], others
    problem = (
        "" if len(photographs) == len(angles_deg) else f"holds {len(photographs)} of {len(angles_deg)} photographs"
    )
    return [Group("", tuple(photographs), problem)], others
