"""``polaropt simulate``: photographs of known layers behind a simulated pane, one pair or a data set."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

import polaropt
from polaropt.cli.command import progress_bar, say, say_json, watched
from polaropt.cli.options import AsJson, PaneOptions, numbers
from polaropt.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from polaropt.optics import SceneParameters
    from polaropt.simulation import Camera


_MOST_BLUR_PX = 100.0
"""Widest blur of a lens that can be asked for, in pixels; set by hand."""
_SET = "A data set instead of one pair"
Format = Literal["png", "tiff", "npz"]
Sensor = Literal["mono", "color"]
MOSAIC = "mosaic.png"
"""The file of a simulated mosaic."""


@dataclass(frozen=True)
class LayerOptions:
    """The layers, where the photographs go, and how they are taken."""

    output: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            metavar="FOLDER",
            help="Folder for the files; made if it does not exist.",
            show_default=False,
        ),
    ]
    layers: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="TRANSMISSION REFLECTION",
            help="Two photographs: what is behind the pane and what it mirrors. Cropped to their common middle.",
            show_default=False,
        ),
    ] = None
    gamma: Annotated[
        str | None,
        typer.Option(
            metavar="CODE",
            help="Undo this encoding of the photographs: srgb or an exponent such as 2.2. Default: values as they are.",
        ),
    ] = None
    angles: Annotated[str, typer.Option(metavar="DEG,DEG,...", help="Polarizer angles in degrees.")] = "0,45,90,135"
    noise: Annotated[
        float, typer.Option(metavar="SIGMA", help="Standard deviation of the noise of a photograph, white = 1.")
    ] = 0.005
    bits: Annotated[int | None, typer.Option(metavar="N", help="Depth of the camera. Default: not quantized.")] = None
    seed: Annotated[int, typer.Option(metavar="N", help="Seed of everything random.")] = 0
    sensor: Annotated[
        Sensor | None,
        typer.Option(
            metavar="KIND",
            help="Write the raw mosaic of a polarization camera instead (mosaic.png, 16 bits): mono or color. The "
            "truth is what its lens images.",
        ),
    ] = None
    lens_blur: Annotated[
        float,
        typer.Option(metavar="PX", help="Standard deviation of the lens's blur, in pixels."),
    ] = 0.0
    format: Annotated[
        Format,
        typer.Option(metavar="FORMAT", help="png: a file per angle, 16 bits; tiff: a float stack; npz: exact."),
    ] = "png"
    json: AsJson = False

    def camera(self) -> Camera:
        """The camera that the options describe."""
        from polaropt.simulation import Camera

        if self.seed < 0:
            raise InputError(f"--seed is {self.seed}; give a whole number from 0 on")
        if not 0 <= self.lens_blur <= _MOST_BLUR_PX:
            raise InputError(f"--lens-blur is {self.lens_blur:g}; give 0 to {_MOST_BLUR_PX:g} px")
        return Camera(numbers(self.angles, "--angles"), self.noise, self.bits, self.seed, self.lens_blur)


@dataclass(frozen=True)
class SetOptions:
    """A data set of random pairs."""

    pairs: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help="Write N pairs of random photographs behind random panes, with manifest.json.",
            rich_help_panel=_SET,
        ),
    ] = None
    photos: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="Take the photographs from here. Default: those that ship inside scikit-image.",
            rich_help_panel=_SET,
        ),
    ] = None
    size: Annotated[int, typer.Option(metavar="PX", help="Width and height of a pair.", rich_help_panel=_SET)] = 256


def simulate_command(layers: LayerOptions, pane: PaneOptions, many: SetOptions) -> None:
    """Blend two photographs as a pane of glass does and photograph them behind a polarizer, with the truth.

    One pair: the photographs (capture...), true_transmission.tiff and true_reflection.tiff (linear) and scene.json,
    which --scene takes. The pane is at 60 degrees, azimuth 0, ghost shift 6.3 px unless given. With --sensor:
    mosaic.png instead of the photographs.

    With --pairs: a data set of random pairs; what is given of the pane is the same in all of them.
    """
    pane.check()
    written = _simulate_one(layers, pane, many) if many.pairs is None else _simulate_many(layers, pane, many)
    if layers.json:
        say_json({"output": str(layers.output), **written})
    else:
        say(f"Written to {layers.output}: {written['summary']}")


def _simulate_one(layers: LayerOptions, pane: PaneOptions, many: SetOptions) -> dict[str, Any]:
    import numpy as np

    from polaropt.capture import WHITE_16, result_folder, write_capture, write_png, write_tiff
    from polaropt.reporting import TRUE_LAYERS, json_values
    from polaropt.simulation import (
        common_middle,
        photograph_mosaic,
        photograph_pair,
        read_photograph,
        sensor_image,
        whole_patterns,
    )

    if many.photos is not None:
        raise InputError("--photos is for a data set; give --pairs too, or two photographs instead")
    if layers.layers is None or len(layers.layers) != 2:
        given = len(layers.layers or ())
        raise InputError(f"{given} photographs to blend; give two, TRANSMISSION REFLECTION, or --pairs N")
    camera, scene = layers.camera(), _one_scene(pane)
    with watched(not layers.json) as stages, result_folder(layers.output, _written_before(layers.output)) as work:
        stages.begin("Reading", 0.0)
        images = common_middle([read_photograph(path, layers.gamma) for path in layers.layers])
        color = None if layers.sensor is None else layers.sensor == "color"
        if color is not None:
            _check_mosaic(layers, images[0])
            images = [whole_patterns(image, color) for image in images]
        stages.begin("Writing the truth", 0.2)
        height, width = images[0].shape[:2]
        for name, image, share in zip(TRUE_LAYERS, images, (scene.tint, 1.0), strict=True):
            seen = camera.through_lens(image if color is None else sensor_image(image, color))
            write_tiff(work / name, seen if share == 1 else seen * np.float32(share))
        stages.begin("Simulating", 0.4)
        if color is None:
            capture = photograph_pair(images[0], images[1], scene, camera, margin=0)
            # Large ones need the memory.
            del image, images, seen
            stages.begin("Writing the photographs", 0.8)
            files = [path.name for path in write_capture(capture, work / f"capture.{layers.format}")]
        else:
            raw = photograph_mosaic(images[0], images[1], scene, camera, color)
            write_png(work / MOSAIC, np.round(np.clip(raw, 0, 1) * WHITE_16).astype(np.uint16))
            files = [MOSAIC]
        document = {"polaropt": polaropt.__version__, "scene": json_values(scene), "camera": json_values(camera)}
        # With it the document is one that --scene takes.
        document |= {"input": {"width": width, "height": height}}
        document |= {"photographs": [str(path) for path in layers.layers], "files": files, "truth": list(TRUE_LAYERS)}
        (work / "scene.json").write_text(json.dumps(document, indent=2) + "\n", encoding="utf-8")
    return {**document, "summary": ", ".join([*files, *TRUE_LAYERS, "scene.json"])}


def _written_before(folder: Path) -> list[str]:
    """The photographs of an earlier simulation into the same folder, as its own document names them."""
    from polaropt.capture import read_json

    try:
        files = read_json(folder / "scene.json")["files"]
        return [name for name in files if name == Path(name).name]
    except (ValueError, KeyError, TypeError):
        return []


def _check_mosaic(layers: LayerOptions, image: NDArray[Any]) -> None:
    """InputError where what is asked for makes no mosaic that could be read again."""
    from polaropt.capture import SMALLEST_SIDE

    if layers.format != "png":
        raise InputError("--format is for four photographs; a mosaic is always one png, leave it out")
    if layers.angles != "0,45,90,135":
        raise InputError("--angles is for a filter that is turned; a sensor has 0,45,90,135, leave it out")
    least = SMALLEST_SIDE * (4 if layers.sensor == "color" else 2)
    if min(image.shape[:2]) < least:
        size = f"{image.shape[1]}x{image.shape[0]}"
        raise InputError(f"the photographs are {size} px; a mosaic needs at least {least}x{least} px")


def _one_scene(pane: PaneOptions) -> SceneParameters:
    from polaropt.optics import SceneParameters, ghost_step

    if pane.earlier is not None:
        return pane.scene()
    index = pane.known_index
    # The pane that is simulated where nothing is said.
    incidence, azimuth, shift = SceneParameters().values()
    incidence = incidence if pane.incidence is None else pane.incidence
    azimuth = azimuth if pane.azimuth is None else pane.azimuth
    shift = shift if pane.shift is None else pane.shift
    if pane.thickness_px is not None:
        shift = ghost_step(incidence, index, pane.thickness_px, pane.thickness_kind)
    shift = 0.0 if pane.single_surface or (pane.focal_px is not None and pane.shift is None) else shift
    return pane.scene().replace(incidence_deg=incidence, azimuth_deg=azimuth, ghost_shift=shift).plainest


def _simulate_many(layers: LayerOptions, pane: PaneOptions, many: SetOptions) -> dict[str, Any]:
    from polaropt.capture import result_folder
    from polaropt.simulation import Panes, Photographs, write_dataset

    if layers.layers:
        raise InputError("--pairs takes its photographs from --photos; leave the two photographs out")
    if layers.sensor is not None:
        raise InputError("--sensor is for one pair; leave it or --pairs out")
    if layers.format != "png":
        raise InputError("--format is for one pair; a data set is always npz, leave it out")
    assert many.pairs is not None
    for name, value in (
        ("--focal-px", pane.focal_px),
        ("--transmission-shift", pane.transmission_shift),
        ("--panes", pane.panes),
        ("--tint", pane.tint),
        ("--scene", pane.earlier),
    ):
        if value is not None:
            raise InputError(f"{name} is for one pair; leave it or --pairs out")
    pane.scene()  # its checks, before anything is written
    panes = Panes(
        pane.incidence,
        pane.azimuth,
        pane.shift,
        pane.thickness_px,
        pane.thickness_kind,
        pane.known_index,
        pane.single_surface,
    )
    photographs, camera = Photographs(many.photos, layers.gamma), layers.camera()
    with result_folder(layers.output) as work, progress_bar(not layers.json) as progress:
        write_dataset(work, photographs, panes, camera, n_pairs=many.pairs, size=many.size, progress=progress)
    return {"pairs": many.pairs, "summary": f"{many.pairs} pairs, manifest.json"}
