"""Small whole files of every format that is read, which are then damaged."""

from __future__ import annotations

import io
import json
import math
from importlib.util import find_spec
from pathlib import Path

import imagecodecs
import numpy as np
import tifffile
from PIL import Image, ImageCms

from polaropt import SceneParameters
from polaropt.simulation import simulate

SIDE = 32
PANE = SceneParameters(60.0, 20.0, 3.0)
ANALYZER = {
    "angles_deg": [0.0, 45.0, 90.0, 135.0],
    "gains": [1.0, 0.99, 1.01, 1.0],
    "contrasts": [0.99, 0.98, 0.99, 0.99],
    "true_angles_deg": [0.0, 45.2, 90.1, 134.9],
}
TABLE = "name,files,incidence,noise,angles\nfirst,glass.tiff,60,,\nsecond,mosaic.png,,,\n"


def photographs(color: bool = False) -> np.ndarray:
    """Four photographs behind a pane, 16 bits, (k, h, w[, 3])."""
    random = np.random.default_rng(7)
    coarse = random.uniform(0.1, 0.6, (2, SIDE // 4, SIDE // 4, 3))
    layers = np.repeat(np.repeat(coarse, 4, axis=1), 4, axis=2).astype(np.float32)
    layers = layers if color else layers[..., 0]
    images = simulate(layers[0], layers[1], PANE, noise=0.004, seed=1).intensities
    images = np.moveaxis(images, 1, -1) if color else images
    return np.ascontiguousarray(np.round(np.clip(images, 0, 1) * 65000).astype(np.uint16))


def mosaic() -> np.ndarray:
    """A raw mosaic of a polarization camera, (2h, 2w)."""
    grey = photographs()
    raw = np.empty((2 * SIDE, 2 * SIDE), np.uint16)
    for place, k in (((0, 0), 2), ((0, 1), 1), ((1, 0), 3), ((1, 1), 0)):
        raw[place[0] :: 2, place[1] :: 2] = grey[k]
    return raw


def _saved(image: Image.Image, kind: str, **options: object) -> bytes:
    file = io.BytesIO()
    image.save(file, kind, **options)
    return file.getvalue()


def _tiff(pixels: np.ndarray, **options: object) -> bytes:
    file = io.BytesIO()
    tifffile.imwrite(file, pixels, **{"photometric": "minisblack", **options})
    return file.getvalue()


def _numpy(**arrays: np.ndarray) -> dict[str, bytes]:
    stored, compressed, plain = io.BytesIO(), io.BytesIO(), io.BytesIO()
    np.savez(stored, **arrays)
    np.savez_compressed(compressed, **arrays)
    np.save(plain, arrays["intensities"])
    return {
        "stored.npz": stored.getvalue(),
        "misnamed.npy": stored.getvalue(),
        "glass.npz": compressed.getvalue(),
        "glass.npy": plain.getvalue(),
    }


def _heif(photograph: np.ndarray) -> bytes:
    """Of 10 bits."""
    import pillow_heif

    deep = pillow_heif.from_bytes(mode="RGB;16", size=photograph.shape[1::-1], data=photograph.tobytes())
    stream = io.BytesIO()
    deep.save(stream, quality=90, bit_depth=10)
    return stream.getvalue()


def seeds() -> dict[str, bytes]:
    """Files by their names."""
    grey, colors, raw = photographs(), photographs(color=True), mosaic()
    small = Image.fromarray((colors[0] >> 8).astype(np.uint8))
    exif = Image.Exif()
    exif.update({0x0110: "Camera", 0x0112: 6, 0x829A: 0.01})
    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("LAB")).tobytes()
    tags = [(0x0110, "s", 0, "Camera", True), (0x0112, "H", 1, 3, True)]
    found = {
        "mosaic.png": bytes(imagecodecs.png_encode(raw)),
        "color.png": bytes(imagecodecs.png_encode(colors[0])),
        "profile.png": _saved(small, "png", icc_profile=profile, exif=exif),
        "palette.png": _saved(small.quantize(16), "png", transparency=3),
        "photograph.jpg": _saved(small, "jpeg", exif=exif, icc_profile=profile),
        "progressive.jpg": _saved(small, "jpeg", progressive=True),
        "grey.jpg": _saved(small.convert("L"), "jpeg"),
        "glass.tiff": _tiff(grey, metadata={"angles_deg": [0, 45, 90, 135]}),
        "float.tiff": _tiff(grey.astype(np.float32) / 65535, compression="zlib", predictor=3),
        "lzw.tiff": _tiff(grey, compression="lzw", predictor=2, metadata=None),
        "color.tiff": _tiff(colors, photometric="rgb", compression="packbits", extratags=tags),
        "tiles.tiff": _tiff(raw, tile=(16, 16), compression="zlib", metadata=None),
        "planes.tiff": _tiff(np.moveaxis(colors[0], -1, 0), photometric="rgb", planarconfig="separate"),
        "big.tiff": _tiff(grey, bigtiff=True, byteorder=">"),
        "ome.tiff": _tiff(grey, ome=True, metadata={"axes": "ZYX"}),
        "imagej.tiff": _tiff(grey, imagej=True),
        "jpeg.tiff": _tiff((raw >> 8).astype(np.uint8), compression="jpeg"),
        "mosaic.raw": raw.tobytes(),
        "analyzer.json": json.dumps(ANALYZER).encode(),
        "report.json": json.dumps(_report()).encode(),
        "table.csv": TABLE.encode(),
    }
    if find_spec("pillow_heif") is not None:
        found["photograph.heic"] = _heif(colors[0])
    return {**found, **_numpy(intensities=grey, valid=np.ones(grey.shape, bool), angles_deg=np.arange(0, 180, 45.0))}


def _report() -> dict[str, object]:
    scene = {"incidence_deg": 60.0, "azimuth_deg": 20.0, "ghost_shift": 3.0, "refractive_index": 1.5, "rung": "ghosts"}
    return {"input": {"height": SIDE, "width": SIDE}, "scene": scene}


def write_seeds(folder: Path) -> None:
    """All of them, and photographs of one angle each."""
    for name, data in seeds().items():
        (folder / name).write_bytes(data)
    for angle, photograph in zip((0, 45, 90, 135), photographs(), strict=True):
        (folder / f"glass_{angle:03d}.png").write_bytes(bytes(imagecodecs.png_encode(photograph)))
    for angle, photograph in zip((0, 45, 90, 135), photographs(color=True), strict=True):
        (folder / f"color_{angle:03d}.png").write_bytes(bytes(imagecodecs.png_encode(photograph)))
    (folder / "deep.json").write_bytes(b"[" * 9999)
    (folder / "infinite.json").write_text(json.dumps({**_report(), "input": {"height": math.inf, "width": 0}}))
    (folder / "black.tiff").write_bytes(_tiff(photographs() * np.array([1, 1, 0, 1], np.uint16)[:, None, None]))
    (folder / "levels.tiff").write_bytes(_tiff((photographs() > 20000).astype(np.uint16) * 1000))
