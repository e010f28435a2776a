"""The plugin for napari: what it opens, what it shows, what its widget does. Without a screen."""

from __future__ import annotations

import importlib
import os
import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from polaropt import Capture, InputError, SceneParameters, separate
from polaropt.capture import write_capture, write_png
from polaropt.napari import capture_of, layers_of_capture, reader_of, separated_layers
from polaropt.optics import dolp_aolp
from polaropt.simulation import Camera, photograph_pair
from studies.photographs import pairs_of
from tests.captured import mono_mosaic

ROOT = Path(__file__).parents[2]
PANE = SceneParameters(60.0, 25.0, 3.0)


@pytest.fixture(scope="module")
def taken() -> Capture:
    photographs = pairs_of(None, 64)[0]
    pair = photographs.transmission, photographs.reflection
    return photograph_pair(*pair, PANE, Camera(noise=0.005), margin=photographs.margin)


@pytest.fixture(scope="module")
def napari() -> Any:
    """The package with what is used of it; imported here, as it takes seconds."""
    with warnings.catch_warnings():
        # Of its own use of pydantic.
        warnings.simplefilter("ignore", DeprecationWarning)
        package = pytest.importorskip("napari", reason="napari is not installed")
        for part in ("components", "layers"):
            importlib.import_module(f"napari.{part}")
    return package


@pytest.fixture
def viewer(napari: Any, monkeypatch: pytest.MonkeyPatch) -> Any:
    """A viewer without a window that knows this plugin and no other."""
    import npe2

    manager = npe2.PluginManager()
    monkeypatch.setattr(npe2.PluginManager, "instance", classmethod(lambda _: manager))
    manager.register(npe2.PluginManifest.from_file(ROOT / "polaropt" / "napari" / "napari.yaml"))
    return napari.components.ViewerModel()


def test_the_manifest_names_what_is_there() -> None:
    npe2 = pytest.importorskip("npe2", reason="napari is not installed")
    manifest = npe2.PluginManifest.from_distribution("polaropt")
    manifest.validate_imports()
    assert [reader.command for reader in manifest.contributions.readers] == ["polaropt.read"]
    assert [widget.command for widget in manifest.contributions.widgets] == ["polaropt.separate"]


def test_four_photographs_are_opened_as_one_capture(taken: Capture, viewer: Any, tmp_path: Path) -> None:
    files = write_capture(taken, tmp_path / "glass.png")
    viewer.open([str(path) for path in files], stack=True, plugin="polaropt")
    angle, degree, light = viewer.layers
    assert [layer.name for layer in viewer.layers] == [
        "glass angle of polarization (deg)", "glass degree of polarization", "glass light",
    ]  # fmt: skip
    assert (angle.visible, degree.visible, light.visible, light.rgb) == (False, False, True, True)
    np.testing.assert_allclose(capture_of(light).intensities, np.clip(taken.intensities, 0, 1), atol=1 / 65535)
    true = dolp_aolp(capture_of(light).stokes.mean(axis=1))
    np.testing.assert_allclose(degree.data, true[0], atol=1e-6)
    np.testing.assert_allclose(angle.data, true[1], atol=1e-3)


def test_a_raw_mosaic_is_opened_at_the_sensors_resolution(taken: Capture, viewer: Any, tmp_path: Path) -> None:
    write_png(tmp_path / "raw.png", np.round(65535 * mono_mosaic(taken.intensities[:, 1])).astype(np.uint16))
    viewer.open(str(tmp_path / "raw.png"), plugin="polaropt")
    assert viewer.layers["raw light"].data.shape == taken.shape[-2:]
    assert capture_of(viewer.layers["raw light"]).samples is not None


def test_what_a_separation_wrote_is_opened_as_a_folder(taken: Capture, viewer: Any, tmp_path: Path) -> None:
    result = separate(taken, PANE)
    result.save(tmp_path / "out")
    viewer.open(str(tmp_path / "out"), plugin="polaropt")
    assert [layer.name for layer in viewer.layers] == [
        "out reflection known", "out reflection error", "out transmission error", "out reflection", "out transmission",
    ]  # fmt: skip
    np.testing.assert_array_equal(viewer.layers["out transmission"].metadata["linear"], result.transmission)
    of_colors = np.sqrt(np.mean(np.square(result.uncertainty[1]), axis=0))
    np.testing.assert_allclose(viewer.layers["out reflection error"].data, of_colors, rtol=0.02)


def test_layers_without_error_maps_are_opened_without_them(taken: Capture, tmp_path: Path) -> None:
    separate(taken, PANE).save(tmp_path / "out", layers_only=True)
    reader = reader_of(str(tmp_path / "out"))
    assert reader is not None
    assert [told["name"] for _, told, _ in reader(str(tmp_path / "out"))] == ["out reflection", "out transmission"]


def test_what_is_no_capture_is_left_to_other_readers(tmp_path: Path) -> None:
    write_png(tmp_path / "picture.png", np.zeros((32, 32, 3), np.uint8))
    assert reader_of(str(tmp_path / "picture.png")) is None
    assert reader_of(str(tmp_path)) is None


def test_several_files_that_are_no_capture_are_named_in_one_line(taken: Capture, tmp_path: Path) -> None:
    files = [str(path) for path in write_capture(taken, tmp_path / "glass.png")]
    Path(files[2]).write_bytes(b"no picture")
    with pytest.raises(InputError, match="glass_090") as told:
        reader_of(files)
    assert "\n" not in str(told.value)


def test_a_stack_of_four_is_taken_as_photographs_and_nothing_else(napari: Any) -> None:
    image = napari.layers.Image
    stack = np.random.default_rng(0).uniform(0.1, 0.9, (4, 32, 40)).astype(np.float32)
    np.testing.assert_array_equal(capture_of(image(stack)).intensities, stack)
    colors = np.stack([stack] * 3, axis=-1)
    assert capture_of(image(colors, rgb=True)).color
    for wrong in (stack[:3], stack[0]):
        with pytest.raises(InputError, match="through a polarizer"):
            capture_of(image(wrong, name="other"))


def test_the_widgets_work_gives_layers_that_napari_shows(taken: Capture, viewer: Any) -> None:
    for data, told, kind in separated_layers(taken, "glass", index=1.5):
        viewer._add_layer_from_data(data, told, kind)
    errors = [layer for layer in viewer.layers if not layer.visible]
    assert [layer.name for layer in errors] == [
        "glass reflection known", "glass reflection error", "glass transmission error",
    ]  # fmt: skip
    assert viewer.layers["glass transmission"].data.shape == (*taken.shape[-2:], 3)


WITH_THE_WIDGET = """
import sys, time
try:
    from qtpy.QtWidgets import QApplication
except Exception as error:
    print(error)
    sys.exit(3)
from napari.layers import Image
from polaropt import read_capture
from polaropt.napari import layers_of_capture, separation_widget

application = QApplication([])
data, told, _ = layers_of_capture(read_capture(sys.argv[1]), "glass")[-1]
worker = separation_widget()(Image(data, **told), "glass", 1.5, False)
shown = []
worker.returned.connect(lambda layers: shown.extend(told["name"] for _, told, _ in layers))
worker.errored.connect(lambda error: shown.append(repr(error)))
end = time.monotonic() + 120
while not shown and time.monotonic() < end:
    application.processEvents()
    time.sleep(0.01)
print(shown)
"""


def test_the_widget_separates_in_another_thread(napari: Any, taken: Capture, tmp_path: Path) -> None:
    (path,) = write_capture(taken.part(slice(48), slice(48)), tmp_path / "glass.npz")
    screenless = os.environ | {"QT_QPA_PLATFORM": "offscreen", "PYTHONWARNINGS": "ignore"}
    ran = subprocess.run(
        [sys.executable, "-c", WITH_THE_WIDGET, str(path)], cwd=ROOT, env=screenless, capture_output=True, text=True
    )
    if ran.returncode == 3:
        pytest.skip(f"Qt is not installed, or libraries of the system that it needs are not: {ran.stdout}")
    assert ran.stdout.splitlines()[-1:] == ["['glass reflection', 'glass transmission']"], ran.stderr


def test_grey_layers_stay_linear_under_limits(taken: Capture) -> None:
    grey = Capture(taken.intensities.mean(axis=1), taken.angles_deg)
    data, told, _ = layers_of_capture(grey, "grey")[-1]
    np.testing.assert_allclose(data, grey.stokes[0], rtol=1e-6)
    assert 0 < told["contrast_limits"][1] <= data.max()
