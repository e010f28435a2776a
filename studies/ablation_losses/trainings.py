"""All trainings of the ablation in one command: every variant with every seed, one budget, several at the same time.

Run ``python -m studies.ablation_losses.trainings -o RECORDS``. Samples are made once for each seed and shared by its
trainings; ``RECORDS/VARIANT/seed-K`` is what ``polaropt train`` writes. The same command again makes what is missing.
With ``--long-steps`` the paper's form is trained with and without its head on a second, larger budget, too.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Literal

from polaropt.errors import InputError
from polaropt.training import Pictures, SampleStore, TrainingJob, store_samples, train
from studies.ablation_losses.records import RECORD, budget_of

COMMAND = "python -m studies.ablation_losses.trainings --jobs 2 --workers 2 -o RECORDS"
LONG = "long"
LONG_VARIANTS = {"with-head": "all", "no-head": "no-head"}
"""Of the second budget: folders and their variants."""
# As the networks inside the package were trained; by the paper's 1e-4 few thousand batches hardly change a network.
_RATE, _AVERAGING = 1.5e-3, 0.995
_LOGS = 4
# Steps between which a training's pace is taken: those before them set a GPU up.
_FIRST_STEP, _LAST_STEP = 20, 60


@dataclass(frozen=True)
class Variant:
    """What a training leaves out or replaces."""

    without: str | None = None
    features: str = "auto"
    polarnet: Literal["compact", "plain"] = "compact"
    head: Literal["panes", "none"] = "panes"


VARIANTS = {
    "all": Variant(),
    "without-perceptual": Variant("perceptual"),
    "without-pse": Variant("pse"),
    "without-edges": Variant("edge_independence"),
    "without-adversarial": Variant("adversarial"),
    "without-pixelwise": Variant("pixelwise"),
    "raw-pixels": Variant(features="pixels"),
    "plain-cnn": Variant(polarnet="plain"),
    "no-head": Variant(head="none"),
}


@dataclass(frozen=True)
class Budget:
    """How long a training is: steps, samples of each, and how many different samples there are."""

    steps: int
    batch_size: int
    samples: int


@dataclass(frozen=True)
class Plan:
    """What is trained.

    Attributes
    ----------
    folder : Path
        For the records.
    store : Path
        For the samples, a folder for each seed.
    budget : Budget
        Of every variant and seed.
    long : Budget or None
        Of the paper's form with and without its head, with the first seed.
    seeds : tuple of int
    variants : tuple of str
        See `VARIANTS`.
    size_px : int
    rate : float
        Adam's largest learning rate.
    data : Path or None
        More photographs to train on.
    leaves : int
        Generated images.
    leaves_share : float
        How often a generated image is taken, 0..1.
    jobs : int
        Trainings at the same time, a process of one thread each.
    workers : int
        Processes that make samples; 0 makes them in this one.
    device : str
    """

    folder: Path
    store: Path
    budget: Budget
    long: Budget | None = None
    seeds: tuple[int, ...] = (0, 1, 2)
    variants: tuple[str, ...] = tuple(VARIANTS)
    size_px: int = 128
    rate: float = _RATE
    data: Path | None = None
    leaves: int = 64
    leaves_share: float = 0.5
    jobs: int = 1
    workers: int = 0
    device: str = "cpu"

    def all(self) -> list[TrainingJob]:
        """All trainings: seed by seed, the longest first."""
        budgets = [] if self.long is None else [(f"{LONG}/{name}", variant, self.seeds[0], self.long)
                                                for name, variant in LONG_VARIANTS.items()]  # fmt: skip
        budgets += [(f"{name}/seed-{seed}", name, seed, self.budget) for seed in self.seeds for name in self.variants]
        return [self._job(*each) for each in budgets]

    def _job(self, name: str, variant_name: str, seed: int, budget: Budget) -> TrainingJob:
        from priors.networks.fusionnet import FUSION_SIZES, Architecture
        from priors.training.losses import LossWeights
        from priors.training.trainer import TrainingOptions

        variant = VARIANTS[variant_name]
        options = TrainingOptions(
            steps=budget.steps,
            batch_size=budget.batch_size,
            learning_rate=self.rate,
            weights=LossWeights() if variant.without is None else replace(LossWeights(), **{variant.without: 0.0}),
            # All samples from early on, again and again.
            window=budget.samples,
            fresh=budget.batch_size,
            averaging=_AVERAGING,
            # Looked at by the study.
            test_samples=0,
            test_every=max(1, budget.steps // _LOGS),
            seed=seed,
            device=self.device,
        )
        architecture = Architecture("paper", variant.polarnet, **FUSION_SIZES["compact"], head=variant.head)
        store = SampleStore(self.store / f"seed-{seed}", budget.samples)
        return TrainingJob(
            self.folder / name, architecture, options, self.size_px, features=variant.features, store=store
        )


def train_all(plan: Plan, say: Callable[[str], None] = print) -> list[str]:
    """Make all trainings of a plan that are missing.

    Parameters
    ----------
    plan : Plan
    say : callable
        Told in a line each what is done, and which failed.

    Returns
    -------
    list of str
        Names of those that failed, which stop no other.

    Raises
    ------
    InputError
        A folder holds a training of another budget, or samples cannot be made.
    """
    jobs = plan.all()
    left = [job for job in jobs if not _is_done(job)]
    say(f"{len(jobs)} trainings, {len(jobs) - len(left)} of them there already")
    if not left:
        return []
    began = time.perf_counter()
    pictures = Pictures(plan.data, plan.leaves, plan.leaves_share)
    if plan.workers and plan.leaves_share:
        pictures.draw(plan.workers)
    work = {job.folder: _work(job) for job in left}
    with ProcessPoolExecutor(plan.jobs, mp_context=get_context("spawn")) as pool:
        futures: dict[Future[None], str] = {}
        for seed in dict.fromkeys(job.options.seed for job in left):
            # Those of one seed begin while the next one's samples are made.
            of_seed = [job for job in left if job.options.seed == seed]
            store = max((job.store for job in of_seed if job.store is not None), key=lambda each: each.count)
            store_samples(store.folder, pictures, plan.size_px, seed, store.count, workers=plan.workers)
            say(f"samples of seed {seed} are there after {time.perf_counter() - began:.0f} s")
            for job in of_seed:
                name, rest = job.folder.relative_to(plan.folder).as_posix(), sum(work.values()) / plan.jobs
                futures[pool.submit(_train, job, name, rest / work[job.folder])] = name
        return _awaited(futures, began, say)


def _awaited(futures: dict[Future[None], str], began: float, say: Callable[[str], None]) -> list[str]:
    """Names of those that failed, once all are over."""
    failed = []
    for number, future in enumerate(as_completed(futures), 1):
        name, error = futures[future], future.exception()
        so_far = f"{number} of {len(futures)} after {time.perf_counter() - began:.0f} s"
        if error is None:
            say(f"{name}: done, {so_far}")
            continue
        failed.append(name)
        ended = isinstance(error, BrokenProcessPool)
        say(f"{name}: FAILED ({'its process or one beside it was ended' if ended else error}), {so_far}")
        if not (ended or isinstance(error, InputError)):
            traceback.print_exception(error)
    return failed


def _work(job: TrainingJob) -> float:
    return float(job.options.steps * job.options.batch_size)


def _is_done(job: TrainingJob) -> bool:
    """Whether a training is there; another one in its place is an error."""
    path = job.folder / RECORD
    if not path.is_file():
        return False
    there = json.loads(path.read_text(encoding="utf-8"))
    asked: dict[str, Any] = {
        "steps": job.options.steps,
        "options": {"batch_size": job.options.batch_size},
        "size_px": job.side_px,
    }
    if budget_of(there) != budget_of(asked):
        raise InputError(f"{job.folder}: was trained for {budget_of(there)}, not {budget_of(asked)}; "
                         "name another folder with -o, or remove it")  # fmt: skip
    return True


def _train(job: TrainingJob, name: str, times_this: float) -> None:
    """One training in a process of its own.

    Parameters
    ----------
    job : TrainingJob
    name : str
    times_this : float
        How much longer all take than this one, at the same pace.
    """
    import torch

    from priors.training.trainer import STATE

    # As many processes as cores: and the same seed comes to the same weights wherever it runs.
    torch.set_num_threads(1)
    train(job, _Pace(job.options.steps, name, times_this))
    # Nothing goes on from a training that is over.
    (job.folder / STATE).unlink(missing_ok=True)


class _Pace:
    """Says once, after the first steps, how long a training and all of them will take."""

    def __init__(self, steps: int, name: str, times_this: float) -> None:
        self._steps, self._name, self._times_this = steps, name, times_this
        self._began = 0.0

    def __call__(self, _: str, done: float) -> None:
        step = round(done * self._steps)
        if step == _FIRST_STEP:
            self._began = time.perf_counter()
        elif step == _LAST_STEP:
            each = (time.perf_counter() - self._began) / (_LAST_STEP - _FIRST_STEP)
            whole = each * self._steps
            every = whole * self._times_this
            line = f"{self._name}: {each:.3f} s a step, about {whole:.0f} s, all trainings {every:.0f} s"
            print(line, file=sys.stderr, flush=True)


def main(arguments: Sequence[str] | None = None) -> int:
    """Make the trainings; 1 where one failed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("-o", "--out", type=Path, required=True, metavar="RECORDS", help="Folder for the trainings.")
    parser.add_argument("--store", type=Path, metavar="FOLDER", help="Folder for samples. Default: RECORDS/samples.")
    parser.add_argument("--steps", type=int, default=500, metavar="N", help="Batches of every training.")
    parser.add_argument("--batch", type=int, default=16, metavar="N", help="Samples per batch.")
    parser.add_argument("--samples", type=int, default=1500, metavar="N", help="Different samples of each seed.")
    parser.add_argument("--size", type=int, default=128, metavar="PX", help="Side of a sample.")
    parser.add_argument("--rate", type=float, default=_RATE, metavar="RATE", help="Adam's largest learning rate.")
    parser.add_argument("--seeds", type=int, default=3, metavar="N", help="Seeds: 0, 1, and so on.")
    parser.add_argument("--variants", nargs="+", choices=[*VARIANTS], default=[*VARIANTS], help="Default: all.")
    parser.add_argument(
        "--long-steps", type=int, default=0, metavar="N", help="Batches of the long trainings; 0: none are made."
    )
    parser.add_argument("--long-batch", type=int, default=32, metavar="N", help="Their samples per batch.")
    parser.add_argument("--long-samples", type=int, default=6000, metavar="N", help="Their different samples.")
    parser.add_argument("--data", type=Path, metavar="FOLDER", help="More photographs to train on.")
    parser.add_argument("--leaves", type=int, default=64, metavar="N", help="Generated images to train on.")
    parser.add_argument(
        "--leaves-share", type=float, default=0.5, metavar="SHARE", help="How often a generated image is taken."
    )
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="Trainings at the same time.")
    parser.add_argument("--workers", type=int, default=0, metavar="N", help="Processes that make samples.")
    parser.add_argument("--device", default="cpu", metavar="NAME", help="cpu or cuda.")
    given = parser.parse_args(arguments)
    long = Budget(given.long_steps, given.long_batch, given.long_samples) if given.long_steps else None
    plan = Plan(
        given.out,
        given.store or given.out / "samples",
        Budget(given.steps, given.batch, given.samples),
        long,
        tuple(range(given.seeds)),
        tuple(given.variants),
        given.size,
        given.rate,
        given.data,
        given.leaves,
        given.leaves_share,
        given.jobs,
        given.workers,
        given.device,
    )
    try:
        failed = train_all(plan, lambda line: print(line, file=sys.stderr, flush=True))
    except InputError as error:
        parser.error(str(error))
    if failed:
        print(f"failed: {', '.join(failed)}; the same command makes them again", file=sys.stderr)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
