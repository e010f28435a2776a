"""Real captures and measured layers, separated blind: scene, seconds, warnings, and shared edges of the layers.

Run ``python -m studies.real_captures --data DIR -o OUT``; DIR holds ``real_polar`` and ``layer_pairs``.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture, planes_last, read_capture, write_png_view
from polaropt.optics import SceneParameters
from polaropt.separation import Separation, separate
from polaropt.simulation import psnr_db, simulate

Image = NDArray[np.float32]

MEASURED_INCIDENCES_DEG = (20.0, 45.0, 65.0)
MEASURED_NOISE = 0.005


@dataclass(frozen=True)
class Example:
    """A real capture: its files and what is told about the pane."""

    name: str
    files: tuple[str, ...]
    refractive_index: float = 1.5
    single_surface: bool = False


EXAMPLES = (
    Example("IMG_0287", ("lei2020_IMG_0287_mosaic16.png",)),
    Example("carps", ("maeda_carps_mosaic8.png",), 1.33, True),
    Example("glass", tuple(f"lapray_glass_nir_{angle}.png" for angle in ("000", "045", "090", "135"))),
)


def edge_correlation(first: Image, second: Image) -> float:
    """Correlation of the root gradient magnitudes of two images (h, w), smoothed by one pixel against shared noise."""
    from scipy.ndimage import gaussian_gradient_magnitude

    sizes = [np.sqrt(gaussian_gradient_magnitude(image, 1.0)).ravel() for image in (first, second)]
    return float(np.corrcoef(sizes[0], sizes[1])[0, 1])


def separate_example(example: Example, folder: Path) -> tuple[Capture, Separation, float]:
    """Read and separate; the seconds include reading."""
    begun = time.perf_counter()
    capture = read_capture([folder / file for file in example.files])
    result = separate(capture, refractive_index=example.refractive_index, single_surface=example.single_surface)
    return capture, result, time.perf_counter() - begun


def describe(name: str, capture: Capture, result: Separation, seconds: float) -> str:
    """A table row."""
    incidence, azimuth, shift = result.scene.values()
    warnings = ", ".join(warning.name for warning in result.diagnostics.warnings) or "none"
    correlations = [edge_correlation(image, result.layers[1]) for image in (capture.stokes[0], result.layers[0])]
    return (
        f"| {name} | {incidence:.1f} | {azimuth:.1f} | {shift:.2f} | {result.diagnostics.misfit_ratio:.1f} "
        f"| {correlations[0]:.3f} | {correlations[1]:.3f} | {seconds:.1f} | {warnings} |"
    )


def write_side_by_side(path: Path, images: list[Image]) -> None:
    """Images next to each other, each at its own exposure (99 % quantile to white)."""
    shown = [np.clip(image / np.quantile(image, 0.99), 0, 1) for image in images]
    write_png_view(path, np.concatenate(shown, axis=1).astype(np.float32))


def against_peer(result: Separation, peer_file: Path) -> str:
    """Edges of the reflection that are left in the transmission of IMG_0287, here and in the peer network's output."""
    from skimage.io import imread

    peer = imread(peer_file).astype(np.float32)
    rows, columns = int(0.4 * peer.shape[0]), int(0.7 * peer.shape[1])
    reflection = result.layers[1][:rows, :columns]
    ours, theirs = (
        edge_correlation(np.asarray(image[:rows, :columns], np.float32), reflection)
        for image in (result.layers[0], peer)
    )
    return f"IMG_0287, upper left: edge correlation with the reflection {ours:.3f} (peer network: {theirs:.3f})"


def measured_layers(folder: Path, out: Path | None) -> list[str]:
    """Layers measured behind real glass, polarized by the engine and separated again."""
    from skimage.io import imread

    lines = ["| layers | theta | s0 | T blind | R blind | theta found |", "|" + "---|" * 6]
    for name in ("mtr1", "mtr2"):
        layers = [(imread(folder / f"{name}_{part}.png")[..., :3] / 255.0) ** 2.2 for part in "TR"]
        for incidence in MEASURED_INCIDENCES_DEG:
            scene = SceneParameters(incidence, 30.0, 4.2)
            capture = simulate(layers[0], layers[1], scene, noise=MEASURED_NOISE, bits=12, seed=1)
            result = separate(capture)
            truth = [np.moveaxis(layer, -1, 0) for layer in layers]
            values = [psnr_db(capture.stokes[0], truth[0], 16)]
            values += [psnr_db(result.layers[i], truth[i], 16) for i in (0, 1)]
            found = result.scene.incidence_deg
            lines.append(f"| {name} | {incidence:g} | " + " | ".join(f"{v:.2f}" for v in values) + f" | {found:.1f} |")
            if out:
                images = [planes_last(capture.stokes[0]), result.transmission, result.reflection]
                write_side_by_side(out / f"{name}_{incidence:g}.png", images)
    return lines


def main() -> None:
    """Print the tables and write the pictures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, required=True, help="folder with real_polar and layer_pairs")
    parser.add_argument("-o", "--out", type=Path, help="folder for the pictures: intensity, transmission, reflection")
    options = parser.parse_args()
    if options.out:
        options.out.mkdir(parents=True, exist_ok=True)
    print("| capture | theta | azimuth | shift | misfit | edges s0-R | edges T-R | s | warnings |\n|" + "---|" * 9)
    peer = ""
    for example in EXAMPLES:
        capture, result, seconds = separate_example(example, options.data / "real_polar")
        print(describe(example.name, capture, result, seconds), flush=True)
        if example.name == "IMG_0287":
            peer = against_peer(result, options.data / "real_polar" / "lei2020_IMG_0287_peerT16.png")
        if options.out:
            images = [capture.stokes[0], result.transmission, result.reflection]
            write_side_by_side(options.out / f"{example.name}.png", images)
    print("\n" + peer + "\n")
    print("\n".join(measured_layers(options.data / "layer_pairs", options.out)))


if __name__ == "__main__":
    main()
