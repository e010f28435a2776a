"""Data sets of blended pairs: random photographs behind random panes, with the truth."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

import polaropt
from polaropt.capture import SMALLEST_SIDE, write_capture, write_tiff
from polaropt.errors import InputError
from polaropt.numerics import in_color
from polaropt.optics import SceneParameters, ghost_step
from polaropt.simulation.pictures import SHIPPED, cut, photographs_in, read_photograph, shipped_photograph
from polaropt.simulation.simulator import MARGIN, Camera, Image, photograph_pair, without_margin

INCIDENCES_DEG = (10.0, 85.0)
"""Incidences of random panes: below, they hardly polarize; above, they pass hardly any light."""
THICKNESSES_PX = (0.0, 12.0)
"""Thicknesses of random panes: up to a little more than the 10 px of the paper's protocol; set by hand."""
_MOST_PAIRS = 1_000_000
"""Pairs in a folder; set by hand."""
_LARGEST_SIDE = 8192
"""Side of a frame in pixels: four photographs in colour take 3 GB; set by hand."""

Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class Panes:
    """Random panes; what is not None is the same in all of them."""

    incidence_deg: float | None = None
    azimuth_deg: float | None = None
    ghost_shift: float | None = None
    thickness_px: float | None = None
    thickness_kind: Literal["paper", "plate"] = "paper"
    refractive_index: float = 1.5
    single_surface: bool = False

    def draw(self, random: np.random.Generator) -> SceneParameters:
        """A pane: incidence, azimuth, thickness and the ghosts' sense are uniformly distributed."""
        # All are drawn, so that fixing one of them leaves the others as they were.
        incidence, azimuth = random.uniform(*INCIDENCES_DEG), random.uniform(0, 180)
        thickness, sense = random.uniform(*THICKNESSES_PX), random.choice([-1, 1])
        incidence = incidence if self.incidence_deg is None else self.incidence_deg
        thickness = thickness if self.thickness_px is None else self.thickness_px
        shift = sense * ghost_step(incidence, self.refractive_index, thickness, self.thickness_kind)
        shift = shift if self.ghost_shift is None else self.ghost_shift
        return SceneParameters(
            incidence,
            azimuth if self.azimuth_deg is None else self.azimuth_deg,
            0.0 if self.single_surface else shift,
            self.refractive_index,
            single_surface=self.single_surface,
        )


class Photographs:
    """Photographs by number, read when asked for.

    Parameters
    ----------
    folder : Path, optional
        Default: those that ship inside scikit-image.
    gamma : None, "srgb" or float
        Encoding to undo.
    """

    def __init__(self, folder: Path | None, gamma: float | str | None) -> None:
        self._files = None if folder is None else photographs_in(folder)
        self._gamma = gamma
        self.names: Sequence[str] = SHIPPED if self._files is None else [path.name for path in self._files]

    def read(self, number: int) -> Image:
        """Photograph (h, w, 3)."""
        if self._files is None:
            return shipped_photograph(SHIPPED[number], self._gamma)
        return in_color(read_photograph(self._files[number], self._gamma))


def write_dataset(
    folder: Path,
    photographs: Photographs,
    panes: Panes,
    camera: Camera,
    *,
    n_pairs: int,
    size: int = 256,
    progress: Progress | None = None,
) -> None:
    """Write `n_pairs` captures (npz), their layers (TIFF) and ``manifest.json`` into a folder.

    Parameters
    ----------
    folder : Path
    photographs : Photographs
    panes : Panes
    camera : Camera
        Its seed decides everything: pair i is the same in a data set of any number of pairs.
    n_pairs, size : int
        Number of pairs; side of the square frames in pixels.
    progress : callable, optional
        Told a sentence and the fraction done.

    Raises
    ------
    InputError
        No pairs, or frames that are too small or too large.
    """
    if n_pairs < 1:
        raise InputError(f"{n_pairs} pairs; give 1 or more")
    if n_pairs > _MOST_PAIRS:
        raise InputError(f"{n_pairs} pairs; give {_MOST_PAIRS} at most, in several folders if more are wanted")
    if not SMALLEST_SIDE <= size <= _LARGEST_SIDE:
        raise InputError(f"frames of {size} px; give a size from {SMALLEST_SIDE} to {_LARGEST_SIDE}")
    pairs = []
    for number in range(n_pairs):
        if progress is not None:
            progress(f"Blending pair {number + 1} of {n_pairs}", number / n_pairs)
        pairs.append(_write_pair(folder, number, photographs, panes.draw, camera, size))
    manifest = {"polaropt": polaropt.__version__, "seed": camera.seed, "noise": camera.noise, "bits": camera.bits}
    text = json.dumps({**manifest, "size": size, "pairs": pairs}, indent=1)
    (folder / "manifest.json").write_text(text + "\n", encoding="utf-8")


def _write_pair(
    folder: Path,
    number: int,
    photographs: Photographs,
    draw: Callable[[np.random.Generator], SceneParameters],
    camera: Camera,
    size: int,
) -> dict[str, Any]:
    random = np.random.default_rng([camera.seed, number])
    scene = draw(random)
    chosen = [int(k) for k in random.choice(len(photographs.names), 2, replace=False)]
    frames = [_random_frame(photographs.read(k), size + 2 * MARGIN, random) for k in chosen]
    capture = photograph_pair(frames[0], frames[1], scene, replace(camera, seed=int(random.integers(2**31))))
    names = {"capture": f"pair_{number:04d}.npz"}
    write_capture(capture, folder / names["capture"])
    for layer, frame in zip(("transmission", "reflection"), frames, strict=True):
        names[layer] = f"pair_{number:04d}_{layer}.tiff"
        write_tiff(folder / names[layer], without_margin(frame))
    incidence, azimuth, shift = scene.values()
    return {
        **names,
        "photographs": [photographs.names[k] for k in chosen],
        "incidence_deg": incidence,
        "azimuth_deg": azimuth,
        "ghost_shift": shift,
        "refractive_index": scene.refractive_index,
        "single_surface": scene.single_surface,
    }


def _random_frame(photograph: Image, size: int, random: np.random.Generator) -> Image:
    """Cut anywhere, mirrored or not."""
    top, left = random.uniform(size=2)
    frame = cut(photograph, (size, size), (top, left))
    return np.ascontiguousarray(frame[:, ::-1]) if random.random() < 0.5 else frame
