"""Command lines: a command on a damaged file, and commands with random options."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, get_args

import numpy as np
import typer

from polaropt.cli.app import app
from tests.fuzz.mutations import damaged

Random = np.random.Generator
QUICK = ["--max-evaluations", "2"]
FOUR = [f"glass_{angle:03d}.png" for angle in (0, 45, 90, 135)]
COLOR = [f"color_{angle:03d}.png" for angle in (0, 45, 90, 135)]
# What reads a file of each kind; `separate` as well, less often, as it takes longer.
_OF_RAW = ["--shape", "64,64", "--pixel-format", "Mono16"]
SPECIAL: Mapping[str, tuple[Sequence[Sequence[str]], ...]] = {
    "mosaic.raw": ((["inspect", "{}", *_OF_RAW],)),
    "analyzer.json": ((["estimate", "mosaic.png", "--analyzer", "{}"],)),
    "report.json": ((["separate", *FOUR, "--scene", "{}", "-o", "out", *QUICK],)),
    "table.csv": ((["batch", "{}", "-o", "out", "--workers", "1", *QUICK],)),
}
_FILES = (["glass.tiff"], FOUR, COLOR, ["mosaic.png"], ["glass.npz"], ["black.tiff"], ["levels.tiff"], ["float.tiff"])
_NUMBERS = (
    "0", "1", "-1", "2", "3", "4", "0.5", "1e-9", "1e9", "1e300", "-1e300", "nan", "inf", "89.9", "90", "45", "60",
    "16", "1.0001", "1000", "100000", "0.999", "1.5", "180", "-0", "1e-320", "007", "99999999999999999999", "", "x",
    "٣",
)  # fmt: skip
_LISTS = (
    "0,45,90,135", "0,60,120", "0,45,90", "0,0,0,0", "135,90,45,0", "relative", "relative,0,45,90,135", "1,1,1,1",
    "1,2,4,8", "64,64", "0,0", "nan,1,2,3", "1e300,1,1,1", ",", "90,45,135,0", "-1,5", "1e9,1e9", "inf,inf",
    "10,55,100,145",
)  # fmt: skip
_WORDS = (
    "auto", "none", "pixelwise", "ghosts", "perspective", "polarized", "curved", "mono", "color", "cell", "sensor",
    "srgb", "2.2", "free", "scipy", "nlopt", "torch", "lbfgs", "cold", "per-pixel", "closed-form", "layers", "all",
    "cw", "plate", "misfit=0", "edge_independence=1e6", "misfit=1e-300,nonnegativity=0", "natural_image=nan", "png",
    "tiff", "npz", "zarr", "Mono8", "Mono12p", "each", "folder", "{name}", "cpu", "\x1b[31m", "a\nb", "x" * 3000,
    "\udcff", "..", "/", "glass.npy",
)  # fmt: skip
_NEVER = {"--help", "--install-completion", "--show-completion", "--version", "--video", "--dashboard", "--scheduler"}
_NEVER |= {
    "--scheduler-file",
    "--workers",
    "--output",
    "--device",
    "--parquet",
    "--layers-only",
    "--shared-scene",
    "--pairs",
}
_RARE = 0.01
"""Share of damaged files that are read as a sequence, which takes seconds where they are whole."""
_WITH_OUTPUT = ("separate", "batch", "simulate", "sequence")
_COMMANDS = ("inspect", "estimate", "separate", "separate", "estimate", "simulate", "batch", "calibrate")


def file_case(seeds: Mapping[str, bytes], random: Random, folder: Path) -> list[str]:
    """A command on a damaged file, which is written into a folder."""
    name = str(random.choice(sorted(seeds)))
    data = damaged(seeds[name], random)
    target = f"damaged{Path(name).suffix}"
    (folder / target).write_bytes(data)
    if name in SPECIAL:
        chosen: Sequence[str] = SPECIAL[name][0]
    else:
        kinds: list[list[str]] = [["inspect", "{}"]] * 6 + [["estimate", "{}"], ["separate", "{}", "-o", "out", *QUICK]]
        kinds += [["inspect", "{}", *FOUR[1:]], ["calibrate", "{}", "-o", "out.json"]]
        kinds += [["simulate", "{}", "color_000.png", "-o", "out"]]
        if random.random() < _RARE:
            kinds = [["sequence", "{}", "-o", "out", "--format", "tiff", *QUICK]]
        chosen = kinds[int(random.integers(len(kinds)))]
    return [target if part == "{}" else part for part in chosen]


def option_case(random: Random) -> list[str]:
    """A command with random options on whole files."""
    name = "sequence" if random.random() < _RARE else _COMMANDS[int(random.integers(len(_COMMANDS)))]
    line = [name, *_sources(name, random)]
    options = [one for one in _options(name) if not set(one.opts) & _NEVER]
    for which in random.permutation(len(options))[: int(random.integers(1, 6))]:
        option = options[int(which)]
        line.append(option.opts[0])
        if not option.is_flag:
            line[-1] += "=" + _value(option, random)
    if name in ("separate", "batch", "sequence"):
        line += QUICK
    if name == "batch":
        line += ["--workers", "1"]
    if name == "calibrate":
        return [*line, "-o", "out.json"]
    return [*line, "-o", "out"] if name in _WITH_OUTPUT else line


def _sources(name: str, random: Random) -> list[str]:
    if name == "simulate":
        return ["color_000.png", "color_090.png"] if random.random() < 0.6 else ["--pairs=1", "--size=32"]
    if name == "sequence":
        return ["lzw.tiff"] if random.random() < 0.5 else ["mosaic.png", "tiles.tiff"]
    if name == "calibrate":
        return ["mosaic.png", "tiles.tiff"]
    if name == "batch":
        return [["glass.tiff", "mosaic.png"], ["table.csv"], ["."]][int(random.integers(2))]
    return list(_FILES[int(random.integers(len(_FILES)))])


def _options(name: str) -> list[Any]:
    group: Any = typer.main.get_command(app)
    return [one for one in group.commands[name].params if one.opts and one.opts[0].startswith("-")]


def _value(option: Any, random: Random) -> str:
    """Numbers for options of numbers, mostly."""
    kind = option.type_descriptor.annotation
    metavar = str(option.metavar or "")
    chosen: tuple[str, ...] = _WORDS
    if "," in metavar:
        chosen = _LISTS
    elif kind in (float, int) or metavar in ("N", "DEG", "PX", "SHARE", "VALUE", "FACTOR"):
        chosen = _NUMBERS
    if get_args(kind) and random.random() < 0.8:
        return str(random.choice(get_args(kind)))
    if random.random() < 0.1:
        chosen = (*_NUMBERS, *_LISTS, *_WORDS)
    return chosen[int(random.integers(len(chosen)))]
