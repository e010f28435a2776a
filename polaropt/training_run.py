"""One training from start to end: data, networks, losses, and the record of it."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import polaropt
from polaropt.errors import InputError
from polaropt.training_data import TrainingData
from polaropt.training_pictures import Pictures

if TYPE_CHECKING:
    from polaropt.cli_train import NetworkOptions, RunOptions
    from priors.fusionnet import SeparationNetwork

Progress = Callable[[str, float], None]


def trained(network: NetworkOptions, run: RunOptions, progress: Progress | None = None) -> dict[str, Any]:
    """Train, and write weights, log, state and record.

    Returns
    -------
    dict
        The record.

    Raises
    ------
    InputError
        Options that cannot be had, a folder without photographs, no state to resume from, or a loss that is no number.
    """
    import torch

    from priors.checkpoint import save_network
    from priors.training import STATE, NotFinite, Training

    _check_device(run.device)
    options = run.training(network.form)
    pictures = Pictures(run.data, run.leaves, run.leaves_share)
    if run.workers and run.leaves_share:
        pictures.draw(run.workers)
    source = TrainingData(pictures, network.form, run.side, run.seed, workers=run.workers)
    features, compared = _features(network, run, options.weights.perceptual > 0)
    torch.manual_seed(run.seed)
    try:
        training = Training(_network(network), source, options, features)
        if run.resume:
            training.resume(network.output / STATE)
        network.output.mkdir(parents=True, exist_ok=True)
        log = training.run(network.output, progress)
    except (ValueError, NotFinite, RuntimeError) as error:
        raise InputError(str(error).splitlines()[0]) from None
    record = {
        "polaropt": polaropt.__version__,
        "architecture": asdict(training.network.architecture),
        "begun_with": _digest(network.begin_with),
        "data": pictures.source,
        "size_px": run.side,
        "options": asdict(options),
        "perceptual_features": compared,
        "steps": training.step,
        "seconds": log[-1]["seconds"] if log else 0.0,
        "figures": log[-1] if log else {},
        "sha256": save_network(network.output / "weights.safetensors", training.averaged),
    }
    (network.output / "record.json").write_text(json.dumps(record, indent=2) + "\n", encoding="utf-8")
    return record


def _network(chosen: NetworkOptions) -> SeparationNetwork:
    """New networks, or those of a file to train further."""
    from priors.checkpoint import load_network
    from priors.fusionnet import SeparationNetwork

    architecture = chosen.architecture()
    network = SeparationNetwork(architecture, chosen.vgg19)
    if chosen.begin_with is None:
        return network
    begun = load_network(chosen.begin_with, vgg19=chosen.vgg19)
    if begun.architecture != architecture:
        held = begun.architecture
        raise InputError(
            f"{chosen.begin_with}: holds the {held.form} form with PolarNet {held.polarnet}, or other sizes; "
            f"give --form {held.form} --polarnet {held.polarnet}, or other weights"
        )
    network.load_state_dict(begun.state_dict())
    return network


def _digest(path: Path | None) -> str | None:
    return None if path is None else hashlib.sha256(path.read_bytes()).hexdigest()


def _check_device(device: str) -> None:
    import torch

    try:
        torch.empty(1, device=device)
    except (RuntimeError, AssertionError) as error:
        raise InputError(f"--device {device!r} cannot be used: {str(error).splitlines()[0]}") from None


def _features(network: NetworkOptions, run: RunOptions, wanted: bool) -> tuple[Any, str | None]:
    """Features of the perceptual loss and their name for the record; (None, "pixels") compares raw pixels."""
    if run.features not in ("auto", "pixels"):
        raise InputError(f"--features {run.features!r} does not exist; choose auto or pixels")
    if not wanted:
        return None, None
    if run.features == "pixels":
        return None, "pixels"
    from priors.encoder import Vgg19Encoder, WrongWeights, vgg19_weights
    from priors.learned import WEIGHTS, shipped_initializer

    try:
        if network.vgg19 is not None:
            return Vgg19Encoder(vgg19_weights(network.vgg19)).to(run.device), "vgg19"
        encoder: Any = shipped_initializer().network.polarnet.encoder
    except WrongWeights as error:
        raise InputError(str(error)) from None
    digest = json.loads((WEIGHTS / "conditioned.json").read_text(encoding="utf-8"))["sha256"]
    return encoder.to(run.device), f"compact encoder of the shipped conditioned form {digest[:8]}"
