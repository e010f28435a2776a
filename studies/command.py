"""What all studies take on the command line, and the pairs of photographs they then work on."""

from __future__ import annotations

import argparse
import os
from functools import lru_cache
from pathlib import Path
from typing import Literal

from studies.protocol import Pair, protocol_pairs, shipped_pairs
from studies.work import Hands

Effort = Literal["quick", "default", "full"]


def study_parser(docstring: str | None) -> argparse.ArgumentParser:
    """Parser with the options that every study has.

    Parameters
    ----------
    docstring : str or None
        Of the study's module; its first line is the description.
    """
    parser = argparse.ArgumentParser(description=(docstring or "").splitlines()[0])
    effort = parser.add_mutually_exclusive_group()
    effort.add_argument("--quick", action="store_true", help="less than 40 s on 2 cores: few and small scenes")
    effort.add_argument("--full", action="store_true", help="all scenes and sizes")
    parser.add_argument("--photos", help="folder of photographs (default: those inside scikit-image)")
    parser.add_argument("--pairs", type=int, help="pairs of photographs at most")
    parser.add_argument(
        "--workers", type=int, default=1, help="processes (0: one per core); times are only worth something with 1"
    )
    parser.add_argument("--scheduler", metavar="ADDRESS", help="Dask scheduler whose workers do the work instead")
    parser.add_argument("-o", "--out", type=Path, required=True, help="folder for rows, tables and figures")
    return parser


def effort_of(options: argparse.Namespace) -> Effort:
    """How much was asked for."""
    return "quick" if options.quick else "full" if options.full else "default"


def hands_of(options: argparse.Namespace) -> Hands:
    """Who works, as asked for."""
    return Hands(options.workers or len(os.sched_getaffinity(0)), options.scheduler)


@lru_cache(maxsize=8)
def pairs_of(photos: str | None, size: int = 256, margin: int = 128) -> tuple[Pair, ...]:
    """Pairs of photographs of a folder, or those inside scikit-image; read once per process."""
    found = shipped_pairs(size, margin) if photos is None else protocol_pairs(Path(photos), size, margin)
    return tuple(found)


def n_pairs_of(options: argparse.Namespace, most: int, size: int = 256, margin: int = 128) -> int:
    """Number of pairs to work on: as asked for, at most as many as there are."""
    return min(options.pairs or most, len(pairs_of(options.photos, size, margin)))
