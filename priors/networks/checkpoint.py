"""Weights of the networks in files: safetensors with the architecture inside, checked when read."""

from __future__ import annotations

import hashlib
import json
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from priors.networks.critics import WrongWeights
from priors.networks.fusionnet import Architecture, SeparationNetwork

_FORMAT = "polaropt separation network 1"
_FIXED = "polarnet.encoder."
_SIZES = ("polar_widths", "fusion_widths", "fusion_blocks")


class NotWritten(OSError):
    """A file cannot be written; the text is one line that says which, why and what to do, `strerror` why."""

    def __init__(self, path: Path, reason: str) -> None:
        super().__init__(f"{path}: cannot be written ({reason}); make room or choose another folder")
        self.strerror = reason


def write_whole(path: Path, content: bytes) -> None:
    """Write a file at once: what is broken off leaves the one that was there.

    Raises
    ------
    NotWritten
        No room, or no permission.
    """
    part = path.with_suffix(".part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        part.write_bytes(content)
        part.replace(path)
    except OSError as error:
        with suppress(OSError):
            part.unlink(missing_ok=True)
        raise NotWritten(path, error.strerror or type(error).__name__) from error


def save_network(path: Path, network: SeparationNetwork) -> str:
    """Write a network's weights in half precision and its architecture; those of a fixed VGG-19 are left out.

    Returns
    -------
    str
        The file's SHA-256 digest in hexadecimal.

    Raises
    ------
    NotWritten
    """
    from safetensors.torch import save

    weights = {
        name: tensor.detach().half().cpu().contiguous()
        for name, tensor in network.state_dict().items()
        if not _is_fixed(name, network.architecture)
    }
    content = save(weights, {"format": _FORMAT, "architecture": json.dumps(asdict(network.architecture))})
    write_whole(path, content)
    return hashlib.sha256(content).hexdigest()


def load_network(path: Path, digest: str | None = None, vgg19: Path | None = None) -> SeparationNetwork:
    """A network from a file, ready to be used.

    Parameters
    ----------
    path : Path
    digest : str, optional
        SHA-256 digest that the file must have.
    vgg19 : Path, optional
        File of VGG-19's weights, for a network with that encoder.

    Raises
    ------
    WrongWeights
        No file, another digest, no network of this program, other shapes, or values that are not finite.
    """
    if not path.is_file():
        raise WrongWeights(f"{path}: no such file; give weights that polaropt train has written")
    content = path.read_bytes()
    if digest is not None and hashlib.sha256(content).hexdigest() != digest:
        raise WrongWeights(f"{path}: is not the file that was shipped (its digest differs); install polaropt again")
    weights, architecture = _parsed(path, content)
    network = SeparationNetwork(architecture, vgg19)
    _check(path, weights, network)
    network.load_state_dict(weights, strict=architecture.polarnet != "vgg19")
    return network.eval().requires_grad_(False)


def _parsed(path: Path, content: bytes) -> tuple[dict[str, Tensor], Architecture]:
    from safetensors.torch import load

    try:
        length = int.from_bytes(content[:8], "little")
        header: dict[str, Any] = json.loads(content[8 : 8 + length])["__metadata__"]
        if header["format"] != _FORMAT:
            raise ValueError
        described = json.loads(header["architecture"])
        sizes = {name: tuple(described[name]) for name in _SIZES}
        return load(content), Architecture(**{**described, **sizes})
    except Exception:
        raise WrongWeights(f"{path}: holds no network; give weights that polaropt train has written") from None


def _check(path: Path, weights: dict[str, Tensor], network: SeparationNetwork) -> None:
    expected = {
        name: tensor.shape for name, tensor in network.state_dict().items() if not _is_fixed(name, network.architecture)
    }
    if {name: tensor.shape for name, tensor in weights.items()} != expected:
        raise WrongWeights(f"{path}: the weights do not fit their own architecture; train anew or install again")
    if not all(bool(torch.isfinite(tensor).all()) for tensor in weights.values()):
        raise WrongWeights(f"{path}: holds NaN or infinite weights; train anew or install again")


def _is_fixed(name: str, architecture: Architecture) -> bool:
    return architecture.polarnet == "vgg19" and name.startswith(_FIXED)
