"""What each term of the learned networks' loss is worth: the source paper's Table 3 and Fig. 7, on its six incidences.

Run ``polaropt study ablation_losses --records FOLDER -o OUT``, where FOLDER holds the folders of trainings; without
``--records`` it says how to make them and looks at the shipped weights alone. Networks stand for themselves: no solve.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pandas import DataFrame
from threadpoolctl import threadpool_limits

from polaropt.capture import Capture, noise_level, planes_last
from polaropt.errors import InputError
from polaropt.estimation import find_scene
from polaropt.solving import Problem, Weights, conditioned_observation, plain_observation
from studies.camera import SceneJob
from studies.kit.charts import BLUE, ORANGE, Fill, crops, legend_below, new_figure
from studies.kit.frames import across, joined, markdown, mean, summary, values_of, where
from studies.kit.run import effort_of, publish, run_study, study_parser
from studies.photographs import N_PAIRS, n_pairs_of
from studies.scenes import BLIND, INCIDENCES_DEG, protocol
from studies.scores import psnr_and_ssim
from studies.ways import seen_in_training

if TYPE_CHECKING:
    from priors.learned import LearnedInitializer
    from priors.observation import Observation

Images = np.ndarray

NAME = "ablation_losses"
SHOWN_DEG = 60.0
"""Incidence of the crops."""
QUICK_INCIDENCES_DEG, QUICK_SIZE, SIZE = (10, 60), 128, 256
ALL = "all terms"
PIXELS, PLAIN = "raw pixels for features", "plain CNN"
TERMS = ("pixelwise", "perceptual", "pse", "edge_independence", "adversarial")
RECORD, WEIGHTS = "record.json", "weights.safetensors"
_ORDER = (ALL, *(f"without {term}" for term in TERMS[1:]), f"without {TERMS[0]}", PIXELS, PLAIN)

TABLE_3 = {
    ALL: (28.3, 0.889),
    "without perceptual": (24.1, 0.797),
    "without pse": (26.4, 0.842),
    "without edge_independence": (26.6, 0.809),
    "without adversarial": (28.1, 0.878),
}
"""The source paper's: PSNR in dB and SSIM of the transmission.

They belong to that paper's own photographs, which are not published: only differences between its columns can be set
beside ours, and those with care.
"""
FIGURE_7 = {
    "without pse": "k: significant artifacts in the reflection",
    "without edge_independence": "l: overlapping gradients in the transmission",
    "without adversarial": "m: a noticeable black spot",
    PIXELS: "n: over-smoothed",
    PLAIN: "o: poor, lack of local details",
}
"""What the paper says of its pictures; no figures belong to them."""


# Trainings, as `polaropt train` leaves them.


@dataclass(frozen=True)
class Training:
    """One training.

    Attributes
    ----------
    name : str
        Of its folder, or of the shipped form.
    weights : Path
    digest : str
        That the weights must have.
    form : str
    variant : str
        What it leaves out or replaces, see `variant_of`.
    budget : str
        Steps, samples and size: what must be equal for a comparison.
    features : str
        What the perceptual loss compares; empty without it.
    seconds : float
    data : str
        What it was trained on.
    """

    name: str
    weights: Path
    digest: str
    form: str
    variant: str
    budget: str
    features: str
    seconds: float
    data: str = ""

    @property
    def shipped(self) -> bool:
        """Whether its weights are inside the package."""
        return self.name.startswith("shipped")


def variant_of(record: dict[str, Any]) -> str:
    """What a training leaves out of the published losses or replaces; `ALL` where that is nothing."""
    factors = record["options"]["weights"]
    if factors.get("decibel"):
        return " and ".join(("decibels", *(term for term in TERMS if factors[term])))
    said = [f"without {term}" for term in TERMS if not factors[term]]
    if factors["perceptual"] and record["perceptual_features"] == "pixels":
        said.append(PIXELS)
    if record["architecture"]["polarnet"] == "plain":
        said.append(PLAIN)
    return ", ".join(said) or ALL


def training_of(name: str, record_file: Path, weights: Path) -> Training:
    """A training from its record.

    Raises
    ------
    InputError
        The record is none of `polaropt train`.
    """
    try:
        record = json.loads(record_file.read_text(encoding="utf-8"))
        return Training(
            name,
            weights,
            record["sha256"],
            record["architecture"]["form"],
            variant_of(record),
            f"{record['steps']} steps of {record['options']['batch_size']} samples of {record['size_px']} px",
            record["perceptual_features"] or "",
            float(record["seconds"]),
            str(record["data"]),
        )
    except (KeyError, TypeError, ValueError):
        raise InputError(f"{record_file}: is no record of a training; give what polaropt train has written") from None


def trainings_in(folder: Path) -> list[Training]:
    """All trainings below a folder, by form, then as the paper has them."""
    trainings = [
        training_of(file.parent.relative_to(folder).as_posix(), file, file.parent / WEIGHTS)
        for file in sorted(folder.rglob(RECORD))
        if (file.parent / WEIGHTS).is_file()
    ]
    if not trainings:
        raise InputError(f"{folder}: no folder with {RECORD} and {WEIGHTS} in it; train with polaropt train -o FOLDER")
    place = {variant: i for i, variant in enumerate(_ORDER)}
    return sorted(trainings, key=lambda each: (each.form, place.get(each.variant, len(_ORDER)), each.name))


def shipped_trainings() -> list[Training]:
    """Those whose weights are inside the package."""
    from priors import learned

    records = sorted(learned.WEIGHTS.glob("*.json"))
    return [training_of(f"shipped, {file.stem}", file, file.with_suffix(".safetensors")) for file in records]


_OPTIONS = {
    "all": "",
    "without-perceptual": "--without perceptual",
    "without-pse": "--without pse",
    "without-edges": "--without edge_independence",
    "without-adversarial": "--without adversarial",
    "without-pixelwise": "--without pixelwise",
    "raw-pixels": "--features pixels",
    "plain-cnn": "--polarnet plain",
}


def commands(folder: str = "RECORDS", steps: int = 1000) -> list[str]:
    """How to make the records of all variants, a line each."""
    begin = f"polaropt train --form paper --steps {steps}"
    return [f"{begin} {extra}{' ' if extra else ''}-o {folder}/{name}" for name, extra in _OPTIONS.items()]


# Networks alone on scenes.


@dataclass(frozen=True)
class Job(SceneJob):
    """One scene, shown to several networks."""

    trainings: tuple[Training, ...] = ()
    vgg19: str | None = None


@dataclass(frozen=True)
class Row:
    """One network on one scene: PSNR in dB and SSIM of both layers, 16 px at the border left out; its seconds."""

    training: str
    variant: str
    pair: int
    incidence_deg: float
    transmission: float
    reflection: float
    transmission_ssim: float
    reflection_ssim: float
    seconds: float


def run(job: Job) -> list[Row]:
    """Show one scene to every network; what the conditioned form needs of the scene is estimated blind, once."""
    sample = job.sample()
    return [
        Row(each.name, each.variant, job.pair, job.scene.value, *psnr_and_ssim(layers, sample.layers), seconds)
        for each, (layers, seconds) in zip(job.trainings, shown(job, sample.capture), strict=True)
    ]


def shown(job: Job, capture: Capture) -> list[tuple[Images, float]]:
    """Layers (2, 3, h, w) that every network makes of a capture, and its seconds."""
    results = []
    with threadpool_limits(1, "blas"):
        seen = {form: observed(capture, form) for form in {each.form for each in job.trainings}}
        for each in job.trainings:
            network = _network(each, job.vgg19)
            began = time.perf_counter()
            layers = network.layers(seen[each.form], 3)
            results.append((layers, time.perf_counter() - began))
    return results


def observed(capture: Capture, form: str) -> Observation:
    """What a network of a form is shown of a capture."""
    noise = noise_level(capture)
    if form == "paper":
        return plain_observation(capture, noise)
    problem = Problem(capture, find_scene(capture, BLIND, noise).scene, noise, Weights())
    return conditioned_observation(problem)


@lru_cache(maxsize=16)
def _network(training: Training, vgg19: str | None) -> LearnedInitializer:
    from priors.learned import LearnedInitializer
    from priors.networks.checkpoint import load_network
    from priors.networks.critics import WrongWeights

    try:
        network = load_network(training.weights, training.digest, None if vgg19 is None else Path(vgg19))
    except WrongWeights as error:
        raise InputError(str(error)) from None
    return LearnedInitializer(network)


# Tables.

_SIDES = "lllrrrrrrrlr"


def tables(frame: DataFrame, trainings: Sequence[Training]) -> str:
    """What every variant reaches alone, beside the paper's figures."""
    trained = [training for training in trainings if not training.shipped]
    incidences = sorted(values_of(frame, "incidence_deg"))
    levels = joined(mean("transmission"), mean("reflection"))
    by_incidence = across("incidence_deg", incidences, levels, "{:g} deg".format)
    return "\n\n".join([
        "# What each term of the loss is worth",
        f"Networks alone, without a solve, mean over {len(values_of(frame, 'pair', 'incidence_deg'))} scenes of the "
        "paper's protocol. The paper's own figures are of its photographs, which are not published: compare "
        "differences, not levels. Each training is one seed; another seed changes its figures as well.",
        _budget(trained) if trained else _how_to_train(),
        markdown(DataFrame([_line(frame, trainings, each) for each in trainings], dtype=object), _SIDES),
        "Transmission / reflection in dB per incidence:",
        markdown(summary(frame, {"training": "training"}, by_incidence), "lr"),
        "The paper's Table 3 and Fig. 7 (other photographs):",
        markdown(_published(trained), "lrl"),
    ])  # fmt: skip


def _how_to_train() -> str:
    return "\n".join([
        "No records were given (`--records RECORDS`). These commands make them; take as many steps as there is time "
        "for, the same for all. A training that was interrupted goes on with `--resume`.",
        "",
        *(f"    {command}" for command in commands()),
    ])  # fmt: skip


def _budget(trained: Sequence[Training]) -> str:
    budgets = list(dict.fromkeys(training.budget for training in trained))
    hours = sum(training.seconds for training in trained) / 3600
    features = sorted({training.features for training in trained} - {"", "pixels"})
    said = (
        f"THE BUDGETS DIFFER: {'; '.join(budgets)}. What follows compares them as well."
        if len(budgets) > 1
        else f"The same budget for all: {budgets[0]}."
    )
    compared = f" The perceptual loss compares: {'; '.join(features)}." if features else ""
    return f"{said} {len(trained)} trainings, {hours:.2f} hours together.{compared}"


def _line(frame: DataFrame, trainings: Sequence[Training], training: Training) -> dict[str, str]:
    rows = where(frame, training=training.name)
    # Against the training of the same form with all terms.
    base = next((each for each in trainings if each.variant == ALL and each.form == training.form), None)
    gain = None
    if base is not None and not training.shipped:
        gain = rows.transmission.mean() - where(frame, training=base.name).transmission.mean()
    printed = _printed(training)
    return {
        "training": training.name,
        "form": training.form,
        "variant": training.variant,
        "T": mean("transmission")(rows),
        "T SSIM": mean("transmission_ssim", ".3f")(rows),
        "R": mean("reflection")(rows),
        "R SSIM": mean("reflection_ssim", ".3f")(rows),
        "T against all terms": "" if gain is None else f"{gain:+.2f}",
        "the paper: T, SSIM": _in_print(printed, ""),
        "the paper: against all": "" if printed is None else f"{printed[0] - TABLE_3[ALL][0]:+.1f}",
        "budget": training.budget,
        "minutes": f"{training.seconds / 60:.0f}",
    }


def _printed(training: Training) -> tuple[float, float] | None:
    return None if training.shipped else TABLE_3.get(training.variant)


def _in_print(printed: tuple[float, float] | None, nothing: str) -> str:
    return nothing if printed is None else f"{printed[0]:.1f} / {printed[1]:.3f}"


def _published(trained: Sequence[Training]) -> DataFrame:
    """What the paper prints, variant by variant, and whether there is a training of it here."""
    there = {training.variant for training in trained}
    lines = [
        [variant, _in_print(TABLE_3.get(variant), "-"), FIGURE_7.get(variant, "-"), "yes" if variant in there else "no"]
        for variant in dict.fromkeys((*TABLE_3, *FIGURE_7))
    ]
    return DataFrame(lines, columns=["variant", "PSNR / SSIM", "Fig. 7", "here"])


# Figures.

_COLUMNS = 6
_BARS = (
    ("transmission", "transmission", Fill(BLUE, "")),
    ("reflection", "reflection", Fill(ORANGE, "///")),
    ("printed", "the paper's transmission, other photographs", Fill("white", "...")),
)


def figures(
    frame: DataFrame, trainings: Sequence[Training], of_crops: Job | None = None
) -> dict[str, Callable[[], Any]]:
    """PSNR and SSIM of every network, and crops of what each makes of one scene."""
    charts = {NAME: lambda: _levels(frame, trainings)}
    return charts if of_crops is None else charts | {f"{NAME}_crops": lambda: crops(_layers(of_crops), _COLUMNS)}


def _levels(frame: DataFrame, trainings: Sequence[Training]) -> Any:
    """PSNR and SSIM of both layers, and the paper's transmission beside them."""
    figure = new_figure(11, 0.62 * len(trainings) + 1.6)
    levels = frame.groupby("training").mean(numeric_only=True).loc[[training.name for training in trainings]]
    printed = np.array([_printed(training) or (math.nan, math.nan) for training in trainings])
    levels["printed"], levels["printed_ssim"] = printed.T
    bars = _BARS if np.isfinite(printed).any() else _BARS[:2]
    places = np.arange(len(trainings))
    for axis, ending, title in zip(
        figure.subplots(1, 2, sharey=True), ("", "_ssim"), ("PSNR (dB)", "SSIM"), strict=True
    ):
        for i, (column, label, fill) in enumerate(bars):
            axis.barh(places + 0.27 * (i - 1), levels[column + ending].fillna(0), 0.26, label=label, **fill.bar)
        axis.set_xlabel(title)
        axis.grid(visible=False, axis="y")
    axis.set_yticks(places, [f"{training.name}\n{training.variant}" for training in trainings])
    axis.invert_yaxis()
    legend_below(figure, *axis.get_legend_handles_labels(), 3)
    return figure


def _layers(job: Job) -> dict[str, Sequence[Images]]:
    """Both layers (h, w, 3) of one scene: the truth, and what every network makes of it."""
    made = zip(job.trainings, shown(job, job.sample().capture), strict=True)
    of_networks = {each.name: [*map(planes_last, layers)] for each, (layers, _) in made}
    return {"truth": job.photographs.frames, **of_networks}


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the study."""
    parser = study_parser(__doc__)
    parser.add_argument(
        "--records", type=Path, metavar="DIR", help="Folder of folders that polaropt train has written."
    )
    parser.add_argument("--vgg19", metavar="FILE", help="VGG-19's weights, for networks with that encoder.")
    options = parser.parse_args(arguments)
    quick = effort_of(options) == "quick"
    size = QUICK_SIZE if quick else SIZE
    try:
        trainings = (*(trainings_in(options.records) if options.records else ()), *shipped_trainings())
    except InputError as error:
        parser.error(str(error))
    seen = {each.name: reason for each in trainings if (reason := seen_in_training(options.photos, each.data))}
    trainings = tuple(each for each in trainings if each.name not in seen)
    if not trainings:
        parser.error(f"no networks are left to judge: {next(iter(seen.values()))}")
    jobs = [
        Job(protocol(incidence), pair, options.photos, size, trainings, options.vgg19)
        for pair in range(n_pairs_of(options, 1 if quick else N_PAIRS, size))
        for incidence in (QUICK_INCIDENCES_DEG if quick else INCIDENCES_DEG)
    ]
    frame = run_study(NAME, run, jobs, Row, options)
    of_crops = replace(jobs[0], scene=protocol(SHOWN_DEG))
    left_out = "".join(f"\n\nLeft out: {name}; {reason}." for name, reason in seen.items())
    publish(NAME, options, tables(frame, trainings) + left_out, figures(frame, trainings, of_crops))


if __name__ == "__main__":
    main()
