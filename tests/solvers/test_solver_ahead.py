"""Kernels compiled ahead: by several processes, once, and no others than are needed."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
from skimage.data import astronaut, coffee

from polaropt import SceneParameters, read_capture, separate, simulate
from polaropt.capture.files.write import write_png
from polaropt.kernels import KERNELS, KERNELS_OF_MOSAICS, KERNELS_OF_POLARIZED_LIGHT
from polaropt.simulation import Camera, cut, photograph_mosaic, shipped_photograph
from tests.blends import blend

ROOT = Path(__file__).parents[2]
KERNEL = """
from solvers.kernels import compiled

@compiled
def {name}(x):
    return 2 * x

def first_calls():
    return [({name}, (3,))]
"""
RUN = """
import sys
from solvers.ahead import compile_ahead
from solvers.kernels import compilations_reported_to
told = []
with compilations_reported_to(told.append):
    compile_ahead(["one", "two"], lambda: print("begun"))
    import one, two
    assert (one.first(3), two.second(3)) == (6, 6)
print(*told)
"""


def run(folder: Path, threads: int) -> list[str]:
    """What a new process tells: that it has begun, and the kernels that it has compiled itself."""
    clean = {key: value for key, value in os.environ.items() if not key.startswith("NUMBA_")}
    clean |= {"PYTHONPATH": os.pathsep.join([str(ROOT), str(folder)]), "OMP_NUM_THREADS": str(threads)}
    ran = subprocess.run([sys.executable, "-c", RUN], env=clean, capture_output=True, text=True, check=True)
    return ran.stdout.split()


def test_another_process_compiles_a_part_which_is_then_loaded(tmp_path):
    (tmp_path / "one.py").write_text(KERNEL.format(name="first"))
    (tmp_path / "two.py").write_text(KERNEL.format(name="second"))
    several = len(os.sched_getaffinity(0)) > 1 if hasattr(os, "sched_getaffinity") else False
    assert run(tmp_path, 2) == (["begun", "second"] if several else ["first", "second"])
    assert run(tmp_path, 2) == []


def test_the_first_calls_are_those_of_a_separation(tmp_path):
    """Their types are its types: otherwise all would be compiled twice."""
    from importlib import import_module

    pane = SceneParameters(60.0, 20.0, 4.0)
    capture = simulate(coffee()[150:214, 200:264], astronaut()[30:94, 160:224], pane, noise=0.01)
    # Its panes are given: to look for more calls the same.
    assert separate(capture, SceneParameters(None, None, None)).uncertainty is not None
    layers = [cut(shipped_photograph(name), (96, 96), (0.5, 0.5)) for name in ("coffee", "astronaut")]
    raw = photograph_mosaic(*layers, pane, Camera(noise=0.01, bits=12), color=True)
    write_png(tmp_path / "raw.png", np.round(65535 * np.clip(raw, 0, 1)).astype(np.uint16))
    assert separate(read_capture(tmp_path / "raw.png", sensor="color"), pane).layers.shape[1] == 3
    lit = blend(60, 96, transmission_polarization=(0.5, 60.0))
    assert separate(lit.capture).scene.polarized
    every = (*KERNELS, *KERNELS_OF_MOSAICS, *KERNELS_OF_POLARIZED_LIGHT)
    calls = [call for name in every for call in import_module(name).first_calls()]
    types = {kernel: list(kernel.signatures) for kernel, _ in calls}
    assert all(types.values())
    for kernel, arguments in calls:
        kernel(*arguments)
        assert kernel.signatures == types[kernel]
