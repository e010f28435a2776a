"""``polaropt train``: train the networks that the learned start is made of."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from polaropt.cli.command import Interrupted, progress_bar, say, say_json
from polaropt.cli.options import AsJson
from polaropt.errors import InputError, check_installed

if TYPE_CHECKING:
    from priors.networks.fusionnet import Architecture
    from priors.training.trainer import TrainingOptions


Form = Literal["conditioned", "paper"]
PolarNetKind = Literal["compact", "vgg19", "plain"]
FusionKind = Literal["compact", "large"]
HeadKind = Literal["panes", "none"]
# Steps and side in pixels of a trial of about a minute.
_QUICK_STEPS, _QUICK_SIZE = 40, 64
# Steps between tests at least, tests at most, and samples that are tested on. Set by hand.
_TEST_EVERY, _MOST_TESTS, _TEST_SAMPLES = 250, 30, 16
# The least and the most of each count: pictures have no more pixels a side, and no computer more memory, set by hand;
# of the seed what torch's generators take.
_RANGES = {
    "steps": (1, 10**9),
    "batch": (1, 4096),
    "size": (32, 2048),
    "leaves": (1, 10**6),
    "window": (1, 10**6),
    "workers": (0, 1024),
    "seed": (0, 2**63 - 1),
}
_NETWORK = "The networks"
_TRAINING = "The training"


@dataclass(frozen=True)
class NetworkOptions:
    """What is trained."""

    output: Annotated[
        Path,
        typer.Option(
            "--output", "-o", metavar="FOLDER", help="Folder for weights, log and states.", show_default=False
        ),
    ]
    form: Annotated[
        Form,
        typer.Option(
            metavar="FORM",
            help="conditioned: improves the closed form at the estimated scene; paper: sees the photographs alone.",
            rich_help_panel=_NETWORK,
        ),
    ] = "conditioned"
    polarnet: Annotated[
        PolarNetKind,
        typer.Option(
            metavar="KIND",
            help="PolarNet's encoder: compact or vgg19; or plain, a multi-layer network without one.",
            rich_help_panel=_NETWORK,
        ),
    ] = "compact"
    vgg19: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="VGG-19's weights as torchvision saves them, for its encoder and the perceptual loss.",
            rich_help_panel=_NETWORK,
        ),
    ] = None
    fusionnet: Annotated[
        FusionKind | None,
        typer.Option(
            metavar="SIZE",
            help="FusionNet's size, large or compact. Default: large for the conditioned form, else compact.",
            rich_help_panel=_NETWORK,
        ),
    ] = None
    head: Annotated[
        HeadKind | None,
        typer.Option(
            metavar="KIND",
            help="Of the paper's form, where its first layers are from: panes, what candidate panes in closed form "
            "would undo, or none, PolarNet alone. Default: panes.",
            rich_help_panel=_NETWORK,
            show_default=False,
        ),
    ] = None
    begin_with: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Train the weights of this file further, which an earlier training wrote.",
            rich_help_panel=_NETWORK,
        ),
    ] = None
    json: AsJson = False

    def architecture(self) -> Architecture:
        """What the options describe."""
        from priors.networks.fusionnet import FUSION_SIZES, Architecture

        if self.polarnet == "vgg19" and self.vgg19 is None:
            raise InputError("--polarnet vgg19 needs its weights: name torchvision's file with --vgg19")
        if self.head is not None and self.form != "paper":
            raise InputError(f"--head {self.head} is for the paper's form alone: give --form paper, or leave it out")
        size = self.fusionnet or ("large" if self.form == "conditioned" else "compact")
        return Architecture(self.form, self.polarnet, **FUSION_SIZES[size], head=self.head or "panes")

    def check_vgg19(self, compares: bool) -> None:
        """InputError where VGG-19's weights are given and nothing takes them: neither PolarNet nor a loss that does."""
        if self.vgg19 is not None and self.polarnet != "vgg19" and not compares:
            raise InputError(
                "--vgg19 is for --polarnet vgg19, or for a perceptual loss of features, which --form paper has; "
                "give one of them, or leave it out"
            )


@dataclass(frozen=True)
class RunOptions:
    """How it is trained."""

    data: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="More photographs to train on, beside those inside scikit-image and scikit-learn.",
            rich_help_panel=_TRAINING,
        ),
    ] = None
    steps: Annotated[int, typer.Option(metavar="N", help="Batches.", rich_help_panel=_TRAINING)] = 5000
    seconds: Annotated[
        float | None,
        typer.Option(
            metavar="S",
            help="End in this time, however few batches it takes.",
            rich_help_panel=_TRAINING,
            show_default=False,
        ),
    ] = None
    batch: Annotated[int, typer.Option(metavar="N", help="Samples per batch.", rich_help_panel=_TRAINING)] = 4
    size: Annotated[int, typer.Option(metavar="PX", help="Side of a sample.", rich_help_panel=_TRAINING)] = 128
    rate: Annotated[
        float | None,
        typer.Option(
            metavar="RATE",
            help="Adam's learning rate. Default: 1.5e-3 for the conditioned form, 1e-4 (as published) for the paper's.",
            rich_help_panel=_TRAINING,
        ),
    ] = None
    without: Annotated[
        list[str] | None,
        typer.Option(
            metavar="TERM",
            help="Leave a term of the loss out; may be given several times. Terms: pixelwise, perceptual, pse, "
            "edge_independence, adversarial, decibel.",
            rich_help_panel=_TRAINING,
        ),
    ] = None
    features: Annotated[
        str,
        typer.Option(
            metavar="KIND",
            help="What the perceptual loss compares: auto (VGG-19 where --vgg19 names it, else the shipped compact "
            "encoder) or pixels.",
            rich_help_panel=_TRAINING,
        ),
    ] = "auto"
    seed: Annotated[int, typer.Option(metavar="N", help="Seed of everything.", rich_help_panel=_TRAINING)] = 0
    leaves: Annotated[int, typer.Option(metavar="N", help="Generated images.", rich_help_panel=_TRAINING)] = 192
    leaves_share: Annotated[
        float,
        typer.Option(metavar="SHARE", help="How often a generated image is taken.", rich_help_panel=_TRAINING),
    ] = 0.5
    workers: Annotated[
        int,
        typer.Option(
            metavar="N",
            help="Processes that make samples while the network trains; the samples stay the same.",
            rich_help_panel=_TRAINING,
        ),
    ] = 0
    device_samples: Annotated[
        bool,
        typer.Option(
            "--device-samples",
            metavar="",
            help="Make samples where the network trains, many at a time, for the conditioned form; the processes add "
            "those that cannot be made so, of clipped photographs and wide lenses. Not the same when run again.",
            rich_help_panel=_TRAINING,
        ),
    ] = False
    fresh: Annotated[float, typer.Option(metavar="N", help="New samples per batch.", rich_help_panel=_TRAINING)] = 0.8
    window: Annotated[
        int, typer.Option(metavar="N", help="Newest samples that batches are drawn from.", rich_help_panel=_TRAINING)
    ] = 256
    device: Annotated[str, typer.Option(metavar="NAME", help="cpu or cuda.", rich_help_panel=_TRAINING)] = "cpu"
    half: Annotated[
        bool,
        typer.Option(
            "--half",
            metavar="",
            help="Half precision on the CPU too: many times slower where it has no instructions for that.",
            rich_help_panel=_TRAINING,
        ),
    ] = False
    resume: Annotated[
        bool,
        typer.Option("--resume", metavar="", help="Go on from the folder's last state.", rich_help_panel=_TRAINING),
    ] = False
    quick: Annotated[
        bool,
        typer.Option(
            "--quick",
            metavar="",
            help=f"A trial of about a minute: {_QUICK_STEPS} steps on samples of {_QUICK_SIZE} px.",
            rich_help_panel=_TRAINING,
        ),
    ] = False

    @property
    def side_px(self) -> int:
        """Side of a sample in pixels."""
        return _QUICK_SIZE if self.quick else self.size

    def training(self, form: Form) -> TrainingOptions:
        """What the options describe."""
        from priors.training.trainer import TrainingOptions

        chosen: dict[str, Any] = {"steps": self.steps, "test_samples": _TEST_SAMPLES}
        chosen["test_every"] = max(_TEST_EVERY, self.steps // _MOST_TESTS)
        if self.quick:
            chosen |= {"steps": _QUICK_STEPS, "test_every": _QUICK_STEPS // 2, "test_samples": 4, "averaging": 0.9}
        self._check(chosen["steps"])
        rate = self.rate if self.rate is not None else (1.5e-3 if form == "conditioned" else 1e-4)
        if not 0 < rate < 1:
            raise InputError(f"--rate is {rate:g}; give a number between 0 and 1")
        return TrainingOptions(
            **{"averaging": 0.995, **chosen},
            window=self.window,
            fresh=self.fresh,
            batch_size=self.batch,
            learning_rate=rate,
            weights=_weights(form, self.without or []),
            seed=self.seed,
            device=self.device,
            half_precision=True if self.half else None,
            seconds=self.seconds,
        )

    def _check(self, steps: int) -> None:
        counts = {name: getattr(self, name) for name in _RANGES} | {"steps": steps, "size": self.side_px}
        for name, (least, most) in _RANGES.items():
            if counts[name] < least:
                raise InputError(f"--{name} is {counts[name]}; give {least} or more")
            if counts[name] > most:
                raise InputError(f"--{name} is {counts[name]}; give {most} at most")
        if self.seconds is not None and not self.seconds > 0:
            raise InputError(f"--seconds is {self.seconds:g}; give more than 0")
        if not 0 <= self.leaves_share <= 1:
            raise InputError(f"--leaves-share is {self.leaves_share:g}; give a number from 0 to 1")
        if not 0 < self.fresh <= self.batch:
            raise InputError(f"--fresh is {self.fresh:g}; give a number above 0, at most the batch ({self.batch})")


def train_command(network: NetworkOptions, run: RunOptions) -> None:
    """Train the networks of the learned start on samples that the engine makes as it goes.

    Writes into the folder: weights.safetensors, log.csv, state.pt (to go on from) and record.json (data, seed, losses,
    figures). A training that was interrupted goes on with --resume and the same options; its steps, seconds, device and
    workers may be others.
    """
    check_installed(("torch", "safetensors", "kornia"), "training", "'polaropt[torch]'")
    from polaropt.training import TrainingJob, train
    from priors.training.trainer import STATE

    options = run.training(network.form)
    network.check_vgg19(run.features == "auto" and options.weights.perceptual > 0)
    job = TrainingJob(
        network.output,
        network.architecture(),
        options,
        run.side_px,
        data=run.data,
        leaves=run.leaves,
        leaves_share=run.leaves_share,
        workers=run.workers,
        vgg19=network.vgg19,
        begin_with=network.begin_with,
        features=run.features,
        resume=run.resume,
        makes_there=run.device_samples,
    )
    state = network.output / STATE
    before = _written(state)
    try:
        with progress_bar(not network.json) as progress:
            record = train(job, progress)
    except KeyboardInterrupt:
        if _written(state) == before:
            raise
        raise Interrupted(f"{state} holds the last state: the same command with --resume goes on from it") from None
    if network.json:
        say_json({"output": str(network.output), **record})
    else:
        say(*_sentences(record, network.output))


def _written(path: Path) -> int | None:
    """When a file was written, in ns; None where there is none."""
    return path.stat().st_mtime_ns if os.path.isfile(path) else None


def _weights(form: Form, without: list[str]) -> Any:
    from dataclasses import fields, replace

    from priors.training.losses import DECIBEL, LossWeights

    weights = DECIBEL if form == "conditioned" else LossWeights()
    known = [field.name for field in fields(LossWeights)]
    for term in without:
        if term not in known:
            raise InputError(f"--without {term!r}: there is no such term; choose from {', '.join(known)}")
    left = replace(weights, **dict.fromkeys(without, 0.0))
    if not any(getattr(left, name) for name in known):
        raise InputError("--without leaves no term of the loss; keep one")
    return left


def _sentences(record: dict[str, Any], folder: Path) -> list[str]:
    last = record["figures"]
    lines = [f"{record['steps']} steps in {record['seconds']:.0f} s."]
    if "transmission_db" in last:
        lines.append(f"Unseen samples: transmission {last['transmission_db']:.2f} dB, "
                     f"reflection {last['reflection_db']:.2f} dB.")  # fmt: skip
    if "closed_form_transmission_db" in last:
        lines.append(f"Their closed form: transmission {last['closed_form_transmission_db']:.2f} dB, "
                     f"reflection {last['closed_form_reflection_db']:.2f} dB.")  # fmt: skip
    return [*lines, f"Written to {folder}: weights.safetensors, log.csv, state.pt, record.json"]
