"""What each term of the learned networks' loss is worth: the source paper's Table 3 and Fig. 7, on its six incidences.

Run ``polaropt study ablation_losses --records FOLDER -o OUT``, where FOLDER holds the folders of trainings, as
``python -m studies.ablation_losses.trainings`` makes them; without ``--records`` it says so and looks at the shipped
weights alone. Networks stand for themselves: no solve.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from threadpoolctl import threadpool_limits

from polaropt.capture import Capture, noise_level, planes_last
from polaropt.errors import InputError
from polaropt.estimation import find_scene
from polaropt.solving import Problem, Weights, conditioned_observation, plain_observation
from studies.ablation_losses.figures import levels
from studies.ablation_losses.records import Training, groups_of, shipped_trainings, trainings_in
from studies.ablation_losses.tables import tables
from studies.camera import SceneJob
from studies.kit.charts import crops
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
_COLUMNS = 6
"""Of the crops."""
# Networks that are kept read: all of three seeds of every variant, and more.
_MOST_NETWORKS = 64


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


@lru_cache(maxsize=_MOST_NETWORKS)
def _network(training: Training, vgg19: str | None) -> LearnedInitializer:
    from priors.learned import LearnedInitializer
    from priors.networks.checkpoint import load_network
    from priors.networks.critics import WrongWeights

    try:
        network = load_network(training.weights, training.digest, None if vgg19 is None else Path(vgg19))
    except WrongWeights as error:
        raise InputError(str(error)) from None
    return LearnedInitializer(network)


def _layers(job: Job) -> dict[str, Sequence[Images]]:
    """Both layers (h, w, 3) of one scene: the truth, and what every network makes of it."""
    made = zip(job.trainings, shown(job, job.sample().capture), strict=True)
    of_networks = {each.name: [*map(planes_last, layers)] for each, (layers, _) in made}
    return {"truth": job.photographs.frames, **of_networks}


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the study."""
    parser = study_parser(__doc__)
    parser.add_argument(
        "--records", type=Path, metavar="DIR", help="Folder of folders of trainings, NAME/seed-K for several seeds."
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
    first = tuple(group.first for group in groups_of(trainings))
    of_crops = replace(jobs[0], scene=protocol(SHOWN_DEG), trainings=first)
    left_out = "".join(f"\n\nLeft out: {name}; {reason}." for name, reason in seen.items())
    charts = {NAME: lambda: levels(frame, trainings), f"{NAME}_crops": lambda: crops(_layers(of_crops), _COLUMNS)}
    publish(NAME, options, tables(frame, trainings) + left_out, charts)


if __name__ == "__main__":
    main()
