"""What each term of the learned networks' loss is worth: the source paper's Table 3 and Fig. 7, on its six incidences.

Run ``polaropt study ablation_losses --records FOLDER -o OUT``, where FOLDER holds the folders of trainings; without
``--records`` it says how to make them and looks at the shipped weights alone. Networks stand for themselves: no solve.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from threadpoolctl import threadpool_limits

from polaropt.capture import Capture, noise_level
from polaropt.errors import InputError
from polaropt.estimation import find_scene
from polaropt.optics import SceneParameters
from polaropt.solving import Problem, Weights, conditioned_observation, plain_observation
from studies.ablation_losses_figures import draw
from studies.ablation_losses_tables import Row, page
from studies.ablation_records import Training, shipped_trainings, trainings_in
from studies.camera import take
from studies.kit.records import row_of, write_tables
from studies.kit.run import effort_of, run_jobs, study_parser, workers_of
from studies.photographs import N_PAIRS, Pair, n_pairs_of, pairs_of
from studies.scenes import INCIDENCES_DEG, protocol
from studies.scores import psnr_and_ssim

if TYPE_CHECKING:
    from priors.learned import LearnedInitializer
    from priors.observation import Observation

SHOWN_DEG = 60.0
QUICK_INCIDENCES_DEG, QUICK_SIZE, SIZE = (10, 60), 128, 256
Images = np.ndarray


@dataclass(frozen=True)
class Job:
    """One scene, shown to several networks."""

    photos: str | None
    pair: int
    incidence_deg: float
    size: int
    trainings: tuple[Training, ...]
    vgg19: str | None


def run(job: Job) -> list[Row]:
    """Show one scene to every network; what the conditioned form needs of the scene is found blind, once."""
    pair = pairs_of(job.photos, job.size, job.size // 2)[job.pair]
    capture = take(protocol(job.incidence_deg), pair).capture
    layers = pair.layers
    with threadpool_limits(1, "blas"):
        seen = {form: observed(capture, form) for form in {training.form for training in job.trainings}}
        return [_row(job, training, seen[training.form], layers) for training in job.trainings]


def observed(capture: Capture, form: str) -> Observation:
    """What a network of a form is shown of a capture."""
    noise = noise_level(capture)
    if form == "paper":
        return plain_observation(capture, noise)
    scene = find_scene(capture, SceneParameters(None, None, None), noise).scene
    problem = Problem(capture, scene, noise, Weights())
    return conditioned_observation(problem, np.ascontiguousarray(problem.canvas.crop(problem.known.layers)))


def _row(job: Job, training: Training, seen: Observation, layers: Images) -> Row:
    network = _network(training, job.vgg19)
    began = time.perf_counter()
    found = network.layers(seen, layers.shape[1])
    seconds = time.perf_counter() - began
    return Row(training.name, training.variant, job.pair, job.incidence_deg, *psnr_and_ssim(found, layers), seconds)


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


def layers_of(training: Training, pair: Pair, incidence_deg: float, vgg19: str | None) -> Images:
    """Layers (2, 3, h, w) that a network makes of one scene of the protocol."""
    capture = take(protocol(incidence_deg), pair).capture
    return _network(training, vgg19).layers(observed(capture, training.form), 3)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the tables and write them with all rows and figures."""
    parser = study_parser(__doc__)
    parser.add_argument("--records", type=Path, metavar="DIR", help="folder of folders that polaropt train has written")
    parser.add_argument("--vgg19", metavar="FILE", help="VGG-19's weights, for networks with that encoder")
    options = parser.parse_args(arguments)
    quick = effort_of(options) == "quick"
    size = QUICK_SIZE if quick else SIZE
    try:
        trainings = (*(trainings_in(options.records) if options.records else ()), *shipped_trainings())
    except InputError as error:
        parser.error(str(error))
    n_pairs = n_pairs_of(options, 1 if quick else N_PAIRS, size, size // 2)
    incidences = QUICK_INCIDENCES_DEG if quick else INCIDENCES_DEG
    jobs = [
        Job(options.photos, pair, float(theta), size, trainings, options.vgg19)
        for pair in range(n_pairs)
        for theta in incidences
    ]
    made = run_jobs(run, jobs, options.out / "ablation_losses.json", {}, workers_of(options))
    rows = [row_of(Row, row) for row in made]
    text = page(rows, trainings)
    print(text)
    write_tables(options.out, "ablation_losses", made, text)
    pair = pairs_of(options.photos, size, size // 2)[0]
    crops = {training.name: layers_of(training, pair, SHOWN_DEG, options.vgg19) for training in trainings}
    draw(rows, trainings, (pair, crops), options.out)


if __name__ == "__main__":
    main()
