"""The scenes that peers are compared on: the paper's protocol, its special cases, and measured layers."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture
from polaropt.errors import InputError
from polaropt.optics import SceneParameters
from studies.command import pairs_of
from studies.protocol import Pair, middle, protocol_capture, protocol_scene, truth
from studies.stability_capture import take
from studies.stability_scenes import SPECIAL, Case, cases

Images = NDArray[np.float32]

PROTOCOL, SPECIAL_CASES, MEASURED = "paper protocol", "special cases", "measured layers"
_GAMMA, _WHITE_SHARE = 2.2, 0.999


@dataclass(frozen=True)
class Sample:
    """A capture, both true layers (2, channel, h, w) and the true scene."""

    capture: Capture
    layers: Images
    scene: SceneParameters


@dataclass(frozen=True)
class Job:
    """One scene.

    Attributes
    ----------
    group : str
        The set: `PROTOCOL`, `SPECIAL_CASES` or `MEASURED`.
    scene : str
        The special case, or the incidence in degrees.
    pair : int
    source : str or None
        Folder of photographs or of measured layers; None: photographs inside scikit-image.
    size, margin : int
        Of the frame in pixels, and of what there is around it.
    """

    group: str
    scene: str
    pair: int
    source: str | None
    size: int = 256
    margin: int = 128


def sample(job: Job) -> Sample:
    """Take the photographs of a job."""
    if job.group == MEASURED:
        return _of_protocol(measured_pairs(Path(job.source or "."), job.size, job.margin)[job.pair], float(job.scene))
    pair = pairs_of(job.source, job.size, job.margin)[job.pair]
    if job.group == PROTOCOL:
        return _of_protocol(pair, float(job.scene))
    taken = take(special_cases()[job.scene], pair)
    return Sample(taken.capture, taken.layers, taken.scene)


def special_cases() -> dict[str, Case]:
    """The paper's four special cases by name, as the stability study makes them."""
    return {case.label: case for case in cases() if case.family == SPECIAL and not case.easy}


@lru_cache(maxsize=2)
def measured_pairs(folder: Path, size: int = 256, margin: int = 128) -> tuple[Pair, ...]:
    """Layers measured behind and off a pane, NAME_T.png and NAME_R.png, in linear light.

    What that pane did to their brightness is not known: each has white at its 99.9 % quantile, and clips there.

    Raises
    ------
    InputError
        A folder without layers.
    """
    from skimage.io import imread

    files = sorted(folder.glob("*_R.png"))
    if not files:
        raise InputError(f"{folder}: no layers NAME_T.png, NAME_R.png; name the folder that holds them")
    pairs = []
    for number, mirrored in enumerate(files):
        behind = mirrored.with_name(mirrored.name.replace("_R.png", "_T.png"))
        frames = [middle(_linear(imread(file)), size + 2 * margin) for file in (behind, mirrored)]
        pairs.append(Pair(number, frames[0], frames[1], margin))
    return tuple(pairs)


def _linear(photograph: NDArray[np.uint8]) -> Images:
    image = (photograph[..., :3].astype(np.float32) / 255) ** np.float32(_GAMMA)
    return np.asarray(np.minimum(image / np.float32(np.quantile(image, _WHITE_SHARE)), 1), dtype=np.float32)


def _of_protocol(pair: Pair, incidence_deg: float) -> Sample:
    layers = np.stack([np.moveaxis(layer, -1, 0) for layer in truth(pair)])
    return Sample(protocol_capture(pair, incidence_deg), layers, protocol_scene(pair, incidence_deg))
