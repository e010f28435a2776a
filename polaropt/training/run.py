"""One training from start to end: data, networks, losses, and the record of it."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import polaropt
from polaropt.capture import SMALLEST_SIDE, result_folder
from polaropt.errors import InputError
from polaropt.solving import check_device
from polaropt.training.pictures import Pictures
from polaropt.training.samples import PATTERN_PX, TrainingData
from polaropt.training.store import SampleStore

if TYPE_CHECKING:
    from priors.networks.fusionnet import Architecture, SeparationNetwork
    from priors.training.trainer import Choice, SampleSource, TrainingOptions


Progress = Callable[[str, float], None]
# Of a digest that is told, enough to tell files apart.
_DIGITS = 8


@dataclass(frozen=True)
class TrainingJob:
    """What is trained, on what, and where it goes.

    Attributes
    ----------
    folder : Path
        For weights, log, state and record.
    architecture : Architecture
        Of the networks.
    options : TrainingOptions
        Of the loop.
    side_px : int
        Of a sample.
    data : Path, optional
        Folder of more photographs, beside those that ship with libraries.
    leaves : int
        Generated images.
    leaves_share : float
        How often a generated image is taken, 0..1.
    workers : int
        Processes that make samples; 0 makes them between the steps.
    vgg19 : Path, optional
        VGG-19's weights as torchvision saves them.
    begin_with : Path, optional
        Weights to train further.
    features : {"auto", "pixels"}
        What the perceptual loss compares.
    resume : bool
        Go on from the folder's last state.
    store : SampleStore, optional
        Train on these and make none; what is said of data, leaves and workers then says nothing.
    makes_there : bool
        Make samples where they are trained on, see `SamplePool`: of the conditioned form alone.
    """

    folder: Path
    architecture: Architecture
    options: TrainingOptions
    side_px: int
    data: Path | None = None
    leaves: int = 192
    leaves_share: float = 0.5
    workers: int = 0
    vgg19: Path | None = None
    begin_with: Path | None = None
    features: str = "auto"
    resume: bool = False
    store: SampleStore | None = None
    makes_there: bool = False


def train(job: TrainingJob, progress: Progress | None = None) -> dict[str, Any]:
    """Train, and write weights, log, state and record.

    Returns
    -------
    dict
        The record.

    Raises
    ------
    InputError
        Options that cannot be had, a folder without photographs or that cannot be written, no state to resume from, or
        a loss that is no number.
    """
    import torch

    from priors.networks.checkpoint import NotWritten, save_network
    from priors.networks.critics import WrongWeights
    from priors.training.trainer import STATE, NotFinite, Training, WrongState

    options = job.options
    try:
        check_device(options.device)
    except InputError as error:
        raise InputError(f"--{error}") from None
    source, data, added = _source(job)
    features, compared = _features(job)
    torch.manual_seed(options.seed)
    try:
        training = Training(_network(job), source, options, features, _course(job, added, compared))
        if job.resume:
            training.resume(job.folder / STATE)
    except (WrongWeights, WrongState) as error:
        raise InputError(str(error)) from error
    try:
        job.folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise InputError(f"{job.folder}: cannot be written ({reason}); choose another output folder") from error
    try:
        log = training.run(job.folder, progress)
    except (NotFinite, NotWritten, WrongState) as error:
        raise InputError(str(error)) from error
    except torch.cuda.OutOfMemoryError as error:
        raise InputError(f"{options.device} has too little memory; take a smaller --batch or --size") from error
    record = {
        "polaropt": polaropt.__version__,
        "architecture": asdict(training.network.architecture),
        "begun_with": _digest(job.begin_with),
        "data": data,
        "size_px": job.side_px,
        "options": asdict(options),
        "perceptual_features": compared,
        "steps": training.step,
        "seconds": log[-1]["seconds"] if log else 0.0,
        "figures": log[-1] if log else {},
    }
    # Together: a record tells the digest of its weights.
    with result_folder(job.folder) as work:
        try:
            record["sha256"] = save_network(work / "weights.safetensors", training.averaged)
            (work / "record.json").write_text(json.dumps(record, indent=2) + "\n", encoding="utf-8")
        except OSError as error:
            reason = error.strerror or type(error).__name__
            raise InputError(
                f"{job.folder}: cannot be written ({reason}); make room and go on with --resume"
            ) from error
    return record


def _course(job: TrainingJob, added: str | None, compared: str | None) -> dict[str, Choice]:
    """What the course depends on, by the options that say it. Steps and time may be given anew, and where it runs."""
    from priors.networks.fusionnet import FUSION_SIZES

    options, networks = job.options, job.architecture
    begun = _digest(job.begin_with)
    fusion = (size for size, widths in FUSION_SIZES.items() if all(getattr(networks, w) == widths[w] for w in widths))
    return {
        "--form": networks.form,
        "--polarnet": networks.polarnet,
        "--fusionnet": next(fusion, "another"),
        "--head": networks.head,
        "--begin-with": begun and f"weights of digest {begun[:_DIGITS]}",
        "--size": job.side_px,
        "--batch": options.batch_size,
        "--rate": options.learning_rate,
        "--without": " and ".join(name for name, factor in asdict(options.weights).items() if not factor),
        "--features": compared,
        "--window": options.window,
        "--fresh": options.fresh,
        "averaging": options.averaging,
        "--half": None if options.half_precision is None else "on" if options.half_precision else "off",
        "--device-samples": "on" if job.makes_there else None,
        "--leaves": job.leaves if job.leaves_share else 0,
        "--leaves-share": job.leaves_share,
        "--data": added,
    }


def _source(job: TrainingJob) -> tuple[SampleSource, str, str | None]:
    """Samples, what they are made of, and what of that was added to what ships with libraries."""
    if job.store is not None:
        return job.store.on(job.options.device), job.store.data, job.store.data
    pictures = Pictures(job.data, job.leaves, job.leaves_share)
    if job.workers and job.leaves_share:
        pictures.draw(job.workers)
    source = TrainingData(pictures, job.architecture.form, job.side_px, job.options.seed, workers=job.workers)
    if not job.makes_there:
        return source, pictures.source, pictures.added
    if not source.takes_mosaics:
        raise InputError(
            f"--device-samples needs the conditioned form and frames of {SMALLEST_SIDE * PATTERN_PX} px or more, "
            f"a multiple of {PATTERN_PX}; give --form conditioned and --size 128, or leave it out"
        )
    if job.options.weights.pse:
        raise InputError("--device-samples simulates no photographs for the loss pse; leave one of both out")
    from polaropt.training.pool import SamplePool

    return SamplePool(source, job.options.device), pictures.source, pictures.added


def _network(job: TrainingJob) -> SeparationNetwork:
    """New networks, or those of a file to train further."""
    from priors.networks.checkpoint import load_network
    from priors.networks.fusionnet import SeparationNetwork

    network = SeparationNetwork(job.architecture, job.vgg19)
    if job.begin_with is None:
        return network
    begun = load_network(job.begin_with, vgg19=job.vgg19)
    if begun.architecture != job.architecture:
        held = begun.architecture
        raise InputError(
            f"{job.begin_with}: holds the {held.form} form with PolarNet {held.polarnet}, or other sizes; "
            f"give --form {held.form} --polarnet {held.polarnet}"
            f"{f' --head {held.head}' if held.form == 'paper' else ''} and --fusionnet of that size, or other weights"
        )
    network.load_state_dict(begun.state_dict())
    return network


def _digest(path: Path | None) -> str | None:
    return None if path is None else hashlib.sha256(path.read_bytes()).hexdigest()


def _features(job: TrainingJob) -> tuple[Any, str | None]:
    """Features of the perceptual loss and their name for the record; (None, "pixels") compares raw pixels."""
    if job.features not in ("auto", "pixels"):
        raise InputError(f"--features {job.features!r} does not exist; choose auto or pixels")
    if not job.options.weights.perceptual > 0:
        return None, None
    if job.features == "pixels":
        return None, "pixels"
    from priors.learned import WEIGHTS, shipped_initializer
    from priors.networks.critics import Vgg19Encoder, WrongWeights, vgg19_weights

    try:
        if job.vgg19 is not None:
            return Vgg19Encoder(vgg19_weights(job.vgg19)).to(job.options.device), "vgg19"
        encoder: Any = shipped_initializer().network.polarnet.encoder
    except WrongWeights as error:
        raise InputError(str(error)) from None
    digest = json.loads((WEIGHTS / "conditioned.json").read_text(encoding="utf-8"))["sha256"]
    return encoder.to(job.options.device), f"compact encoder of the shipped conditioned form {digest[:_DIGITS]}"
