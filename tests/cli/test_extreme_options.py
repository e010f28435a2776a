"""Extreme but legal options and photographs work; numbers outside their range are refused in one line.

The one table of extremes: what a person may give, and what photographs may be, at the ends of what is allowed.
"""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from polaropt import Capture, InputError, SceneParameters, Weights, read_capture
from polaropt.capture.files.write import write_capture
from polaropt.cli.app import main
from polaropt.estimation import estimate_scene
from polaropt.optics import DARKEST_TINT, FARTHEST_SHIFT_PX
from polaropt.separation import separate
from polaropt.simulation import simulate
from solvers.base import Status, StoppingRule
from tests.captured import photographed, scene_intensities
from tests.command_line import QUICK

pytestmark = pytest.mark.filterwarnings("error")


@pytest.fixture(scope="module")
def shelf(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Photographs of several sizes, one of them of a pane with ghosts."""
    folder = tmp_path_factory.mktemp("shelf")
    for height, width in ((48, 48), (80, 100), (32, 32), (16, 16)):
        write_capture(photographed((height, width), bits=12), folder / f"glass{width}.png")
    layers = scene_intensities((2, 48, 48), (0.0,))[0]
    ghosts = simulate(layers[0], layers[1], SceneParameters(60.0, 25.0, 4.0), bits=12, seed=1)
    write_capture(ghosts, folder / "ghosts48.png")
    return folder


def read_float(path: Path) -> np.ndarray:
    """A layer as it was written."""
    import tifffile

    return tifffile.imread(path)


def files(folder: Path, name: str) -> list[str]:
    return [str(folder / f"{name}_{angle:03d}.png") for angle in (0, 45, 90, 135)]


# Those in which all rungs are climbed; the others are told to be a pane with its ghosts where they name no other.
CLIMBED = {"ghosts half out of sight", "nearly frontal", "grazing", "hardly a pane", "thin", "an eye that sees all"}


def told(name: str, options: list[str]) -> list[str]:
    """What else is told: how panes and rungs are chosen is tested elsewhere."""
    others = {"--model", "--focal-px", "--field-of-view-deg"}
    rung = [] if name in CLIMBED or others & {*options} else ["--model", "ghosts"]
    return [*rung, *([] if "--panes" in options else ["--panes", "1"])]


ESTIMATES = {
    "ghosts out of sight": ("glass100", "--shift", "1000"),
    "ghosts half out of sight": ("glass48", "--shift", "135"),
    "ghosts out of a small frame": ("glass16", "--shift", "15"),
    "few parts at a coarse scale": ("ghosts48", "--shift", "20"),
    "the farthest ghosts": ("glass48", "--shift", f"{FARTHEST_SHIFT_PX:g}"),
    "another side": ("glass48", "--shift=-200", "--azimuth=-1000"),
    "frontal": ("glass48", "--incidence", "0"),
    "nearly frontal": ("glass48", "--incidence", "1e-9"),
    "grazing": ("glass48", "--incidence", "89.9999999"),
    "grazing diamond": ("ghosts48", "--incidence", "89.99", "--index", "4"),
    "grazing mirror": ("ghosts48", "--incidence", "89.99", "--index", "10", "--model", "ghosts"),
    "hardly a pane": ("glass32", "--index", "1.0001"),
    "thick": ("glass48", "--thickness-px", "100000", "--azimuth", "20"),
    "thin": ("glass48", "--thickness-px", "0", "--azimuth", "20"),
    "an eye that sees all": ("glass48", "--focal-px", "0.01"),
    "a telescope": ("glass48", "--field-of-view-deg", "0.001", "--model", "perspective"),
    "far turned": ("glass48", "--azimuth", "1e300"),
    "as wide a lens as can be": ("glass48", "--field-of-view-deg", "170", "--model", "perspective"),
    "four panes": ("glass48", "--panes", "4"),
}


@pytest.mark.parametrize("name", ESTIMATES)
def test_extreme_panes_are_estimated(shelf, name, capsys):
    photographs, *options = ESTIMATES[name]
    options += told(name, options)
    assert main(["estimate", *files(shelf, photographs), *options, "--json"]) == 0
    said = capsys.readouterr()
    assert said.err == ""
    assert np.isfinite(json.loads(said.out)["scene"]["incidence_deg"])


_KNOWN = ("ghosts48", "--incidence", "60", "--azimuth", "25", "--shift", "4")
SEPARATED = {
    "frontal": ("ghosts48", "--incidence", "0", "--azimuth", "0", "--shift", "0"),
    "nearly frontal": ("ghosts48", "--incidence", "1", "--azimuth", "45", "--shift", "0.5"),
    "nearly frontal before a lens": ("glass16", "--incidence", "1", "--shift", "0.01", "--focal-px", "1e9"),
    "nearly frontal, another incidence found": ("ghosts48", "--incidence", "5", "--shift", "180"),
    "grazing": ("glass16", "--incidence", "89.9999999", "--azimuth", "0", "--shift", "3"),
    "a pane that mirrors nothing": ("ghosts48", "--index", "1", "--incidence", "60", "--azimuth", "25", "--shift", "4"),
    "ghosts out of sight": ("ghosts48", "--incidence", "60", "--shift", "1000"),
    "the farthest transmission": ("glass16", "--transmission-shift", f"{FARTHEST_SHIFT_PX:g}", "--index", "2"),
    "shifted by more than the picture": ("ghosts48", "--incidence", "50", "--azimuth", "0", "--shift", "49"),
    "hardly frontal": ("ghosts48", "--incidence", "0.001", "--azimuth", "0", "--shift", "0"),
    "nearly grazing": ("ghosts48", "--incidence", "89.9", "--azimuth", "25", "--shift", "4"),
    "hardly a pane": ("ghosts48", "--incidence", "60", "--index", "1.0001", "--azimuth", "25", "--shift", "4"),
    "diamond": ("ghosts48", "--incidence", "60", "--index", "4", "--azimuth", "25", "--shift", "4"),
    "a lens that sees nearly all": (
        "glass48",
        "--incidence",
        "50",
        "--azimuth",
        "0",
        "--shift",
        "0",
        "--field-of-view-deg",
        "170",
    ),
    "four dark panes": (
        "ghosts48",
        "--incidence",
        "60",
        "--azimuth",
        "25",
        "--shift",
        "4",
        "--panes",
        "4",
        "--gap-shift",
        "9",
        "--tint",
        f"{DARKEST_TINT:g}",
    ),
    "heavy": (*_KNOWN, "--weights", "gradient_sparsity=1e6,misfit=1e-300"),
    "light": (*_KNOWN, "--weights", "misfit=0,natural_image=0"),
}


@pytest.mark.parametrize("name", SEPARATED)
def test_extreme_panes_are_separated(shelf, tmp_path, name, capsys):
    photographs, *options = SEPARATED[name]
    options += told(name, options)
    assert main(["separate", *files(shelf, photographs), *options, "-o", str(tmp_path), *QUICK, "--json"]) == 0
    said = capsys.readouterr()
    assert said.err == ""
    assert json.loads(said.out)["solver"]["status"] != "NOT_FINITE"


BENT = SceneParameters(45.0, 20.0, 0.0, focal_px=60.0, bend_deg_per_px=(0.3, -0.2, 0.3))
PANES = {
    "strongly bent": BENT,
    "bent to beyond grazing": BENT.replace(incidence_deg=80.0),
    "a pane across a lens that sees nearly all": SceneParameters(80.0, 90.0, 3.0, focal_px=3.0),
    "four panes that let hardly any light pass": SceneParameters(
        60.0, 20.0, 3.0, n_panes=4, gap_shift=20.0, absorption=-math.log(DARKEST_TINT) / 4
    ),
}


@pytest.mark.parametrize("name", PANES)
def test_extreme_panes_are_simulated_and_separated(name):
    capture = simulate(*scene_intensities((2, 48, 48), (0.0,))[0], PANES[name], noise=0.0)
    result = separate(capture, PANES[name], stopping=StoppingRule(max_evaluations=2))
    assert np.isfinite(result.layers).all()
    assert np.isfinite(result.uncertainty).all()


def grey(values: float) -> np.ndarray:
    """The usual photographs with so many grey levels."""
    return np.round(photographed((40, 40)).intensities * (values - 1)) / (values - 1)


def one_black() -> np.ndarray:
    """The usual photographs, of which the second was taken with the lens cap on."""
    images = photographed((40, 40)).intensities.copy()
    images[1] = 0
    return images


PHOTOGRAPHS = {
    "no noise": lambda: scene_intensities((40, 40)),
    "much noise": lambda: photographed((28, 28), noise=0.4).intensities,
    "two grey levels": lambda: grey(2) * 0.9,
    "one black": one_black,
    "all but one black": lambda: one_black() * np.array([1, 0, 0, 0])[:, None, None],
    "one bright pixel in the dark": lambda: np.where(np.arange(1600).reshape(40, 40) == 820, 0.9, np.zeros((4, 1, 1))),
    "hardly any light": lambda: 1e-6 * photographed((40, 40)).intensities,
    "all the same": lambda: np.broadcast_to(scene_intensities((40, 40))[:1], (4, 40, 40)),
    "nearly all clipped": lambda: np.minimum(4 * scene_intensities((40, 40)), 1),
    "the least size": lambda: scene_intensities((16, 16)),
    "one row more": lambda: scene_intensities((17, 16)),
    "narrow": lambda: scene_intensities((16, 300)),
}


# Those in which several panes, tint and all rungs are looked for; the others are told to show one clear pane's ghosts.
OPEN = {"no noise", "one black", "nearly all clipped", "one row more", "narrow"}


@pytest.mark.parametrize("name", PHOTOGRAPHS)
def test_extreme_photographs_are_separated_or_refused_in_a_line(name, tmp_path, capsys):
    files = [str(path) for path in write_capture(Capture.of_planes(PHOTOGRAPHS[name]()), tmp_path / "a.png")]
    pane = [] if name in OPEN else told(name, [])
    code = main(["separate", *files, *pane, "-o", str(tmp_path / "out"), *QUICK, "--json"])
    said = capsys.readouterr()
    assert (code, said.err) == (0, "") or (code == 2 and said.err.count("\n") == 1), said.err
    if code == 0:
        layers = [read_float(tmp_path / "out" / f"{layer}.tiff") for layer in ("transmission", "reflection")]
        assert all(np.isfinite(layer).all() for layer in layers)
    else:
        assert not (tmp_path / "out").exists()


def patterned() -> np.ndarray:
    """Samples that change with the pattern and nothing else."""
    return np.tile(np.random.default_rng(0).uniform(0.1, 0.9, (4, 4)), (16, 16))


# Of floating point and without noise: what is told is 1e11 times what is expected, or the other way round.
MOSAICS = {
    "next to one grey": lambda: 0.4 + 1e-5 * np.random.default_rng(0).standard_normal((64, 64)),
    "stripes": lambda: 0.4 + 0.2 * (np.arange(4096).reshape(64, 64) % 2),
    "patterns alike": patterned,
    "noise alone": lambda: np.random.default_rng(0).uniform(0, 1, (64, 64)),
    "smooth": lambda: 0.4 + 0.2 * np.sin(np.arange(64) / 9)[:, None] * np.cos(np.arange(64) / 7),
    "next to nothing": lambda: 1e-36 * (1 + patterned()),
}


@pytest.mark.filterwarnings("ignore::polaropt.ResultWarning")
@pytest.mark.parametrize("resolution", ["sensor", "cell"])
@pytest.mark.parametrize("sensor", ["mono", "color"])
@pytest.mark.parametrize("name", MOSAICS)
def test_mosaics_without_noise_have_layers(name, sensor, resolution, tmp_path):
    np.save(tmp_path / "raw.npy", MOSAICS[name]().astype(np.float32))
    capture = read_capture(tmp_path / "raw.npy", sensor=sensor, resolution=resolution)
    result = separate(capture, SceneParameters(60.0, 20.0, 3.0), stopping=StoppingRule(max_evaluations=4))
    assert result.solver.status is not Status.NOT_FINITE
    assert np.isfinite(result.layers).all()
    assert np.isfinite(result.uncertainty).all()


REFUSED = {
    "index of air": (["estimate", "--index", "1"], "mirrors nothing"),
    "index": (["estimate", "--index", "11"], "10 at most"),
    "shift": (["separate", "-o", "out", "--shift", "1e9"], "ghost_shift"),
    "transmission shift": (["separate", "-o", "out", "--transmission-shift", "1e9"], "transmission_ghost_shift"),
    "thickness": (["estimate", "--thickness-px", "1e9"], "--thickness-px"),
    "focal length": (["estimate", "--focal-px", "1e-5"], "focal length"),
    "focal length of a star": (["estimate", "--focal-px", "1e20"], "focal length"),
    "field of view": (["estimate", "--field-of-view-deg", "179.9"], "field of view"),
    "weights": (["separate", "-o", "out", "--weights", "misfit=1e300"], "weight misfit"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_numbers_outside_their_range_are_refused(shelf, tmp_path, name, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (command, *options), wanted = REFUSED[name]
    assert main([command, *files(shelf, "glass48"), *options]) == 2
    said = capsys.readouterr()
    assert wanted in said.err
    assert said.err.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_ranges_are_those_of_python_too():
    capture = photographed((64, 64))
    with pytest.raises(InputError, match="mirrors nothing"):
        estimate_scene(capture, SceneParameters(None, None, None, 1.0))
    with pytest.raises(InputError, match="thickness"):
        estimate_scene(capture, SceneParameters(None, None, None), thickness_px=-1)
    with pytest.raises(InputError, match="weight"):
        Weights(misfit=1e7)


def test_a_shift_that_was_given_has_no_error():
    capture = photographed((64, 64))
    errors = estimate_scene(capture, SceneParameters(60.0, 20.0, None, transmission_ghost_shift=3.0)).errors
    assert errors.transmission_ghost_shift is None


def test_at_grazing_incidence_the_solve_ends_at_layers_that_can_be_shown(tmp_path, capsys):
    write_capture(photographed((16, 16), bits=12), tmp_path / "glass.tif")
    pane = ["--incidence", "89.9", "--azimuth", "25", "--shift", "4", "--panes", "1"]
    assert main(["separate", str(tmp_path / "glass.tif"), *pane, "-o", str(tmp_path / "out")]) == 0
    assert "infinite" not in capsys.readouterr().out
    assert (tmp_path / "out" / "report.html").exists()
