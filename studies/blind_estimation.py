"""Errors of blind scene estimation on the paper's kind of scenes, per incidence.

Run ``python -m studies.blind_estimation --photos DIR``; without ``--photos`` it uses photographs inside scikit-image.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from polaropt.estimation import estimate_scene
from polaropt.optics import SceneParameters
from studies.camera import take
from studies.photographs import Pair, folder_pairs, shipped_pairs
from studies.scenes import Formula, protocol

INCIDENCES_DEG = (10, 20, 30, 40, 50, 60, 70, 80, 85)
HEADER = "theta   incidence med/p90   azimuth med/max  wrong axis   Delta    shift med/p90   seconds"


@dataclass(frozen=True)
class Errors:
    """Absolute errors of one estimate: degrees, degrees modulo 180, pixels; and the seconds it took."""

    incidence_deg: float
    azimuth_deg: float
    ghost_shift: float
    seconds: float


def scene_errors(found: SceneParameters, true: SceneParameters, seconds: float = math.nan) -> Errors:
    """Errors, an azimuth turned by 180 degrees together with a shift of opposite sign being the same scene."""
    incidence, azimuth, shift = found.values()
    true_incidence, true_azimuth, true_shift = true.values()
    turn = (azimuth - true_azimuth + 90) % 180 - 90
    sense = 1 if math.cos(math.radians(azimuth - true_azimuth)) >= 0 else -1
    return Errors(abs(incidence - true_incidence), abs(turn), abs(sense * shift - true_shift), seconds)


def estimation_errors(pair: Pair, incidence_deg: float, kind: Formula, noise: float) -> Errors:
    """Errors of one blind estimate."""
    sample = take(protocol(incidence_deg, kind, noise), pair)
    start = time.perf_counter()
    found = estimate_scene(sample.capture).scene
    return scene_errors(found, sample.scene, time.perf_counter() - start)


def table_row(incidence_deg: float, shift: float, errors: Sequence[Errors]) -> str:
    """One line of the table."""
    incidence, azimuth, ghost, seconds = np.array(
        [(e.incidence_deg, e.azimuth_deg, e.ghost_shift, e.seconds) for e in errors]
    ).T
    right = azimuth[azimuth < 45] if (azimuth < 45).any() else np.array([math.nan])
    return (
        f"{incidence_deg:5g}   {np.median(incidence):9.2f} /{np.percentile(incidence, 90):6.2f}"
        f"   {np.median(right):9.2f} /{right.max():5.2f}  {(azimuth >= 45).sum():4d} of {len(errors):2d}"
        f"  {shift:6.2f}   {np.median(ghost):8.2f} /{np.percentile(ghost, 90):6.2f}   {np.mean(seconds):7.2f}"
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table of both protocols."""
    parser = argparse.ArgumentParser(description="Errors of blind scene estimation, per incidence.")
    parser.add_argument("--photos", type=Path, help="folder of photographs (default: those inside scikit-image)")
    parser.add_argument("--noise", type=float, default=0.005, help="standard deviation per photograph (white = 1)")
    parser.add_argument("--kind", choices=("paper", "plate"), action="append", help="formula of the ghost step")
    options = parser.parse_args(arguments)
    pairs = folder_pairs(options.photos) if options.photos else shipped_pairs()
    for kind in options.kind or ("paper", "plate"):
        print(f"protocol {kind}: {len(pairs)} pairs, noise {options.noise:g}\n{HEADER}")
        for incidence in INCIDENCES_DEG:
            errors = [estimation_errors(pair, incidence, kind, options.noise) for pair in pairs]
            shift = protocol(incidence, kind).pane.ghost_shift
            print(table_row(incidence, shift, errors), flush=True)


if __name__ == "__main__":
    main()
