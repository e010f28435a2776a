"""Trainings, as `polaropt train` leaves them, and those of one variant together."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from polaropt.errors import InputError

ALL = "all terms"
PIXELS, PLAIN, NO_HEAD = "raw pixels for features", "plain CNN", "without the head"
TERMS = ("pixelwise", "perceptual", "pse", "edge_independence", "adversarial")
RECORD, WEIGHTS = "record.json", "weights.safetensors"
_ORDER = (ALL, *(f"without {term}" for term in TERMS[1:]), f"without {TERMS[0]}", PIXELS, PLAIN, NO_HEAD)
_OF_SEED = re.compile(r"/seed-\d+$")


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
    seed : int
        Of its first weights, its samples and its batches.
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
    seed: int = 0
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
    # Records of before that choice have the head.
    if record["architecture"].get("head") == "none":
        said.append(NO_HEAD)
    return ", ".join(said) or ALL


def budget_of(record: dict[str, Any]) -> str:
    """What must be equal for a comparison."""
    return f"{record['steps']} steps of {record['options']['batch_size']} samples of {record['size_px']} px"


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
            budget_of(record),
            record["perceptual_features"] or "",
            float(record["seconds"]),
            int(record["options"]["seed"]),
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


@dataclass(frozen=True)
class Group:
    """Trainings of one variant and budget, each of another seed; one of the shipped ones alone."""

    name: str
    trainings: tuple[Training, ...]

    @property
    def first(self) -> Training:
        """The one of the least seed."""
        return self.trainings[0]

    @property
    def variant(self) -> str:
        """What they leave out or replace."""
        return self.first.variant

    def compares_with(self, other: Group) -> bool:
        """Whether what differs is the variant alone."""
        mine, theirs = self.first, other.first
        return not (mine.shipped or theirs.shipped) and (mine.form, mine.budget) == (theirs.form, theirs.budget)


def groups_of(trainings: Sequence[Training]) -> list[Group]:
    """Trainings whose folders are ``NAME/seed-K`` together, in order.

    The budget that most have comes first, then variants as the paper has them; the shipped ones come last.
    """
    together: dict[tuple[str, ...], list[Training]] = {}
    for each in sorted(trainings, key=lambda training: training.seed):
        together.setdefault((_OF_SEED.sub("", each.name), each.form, each.variant, each.budget), []).append(each)
    of_budget = Counter(each.budget for each in trainings if not each.shipped)
    place = {variant: i for i, variant in enumerate(_ORDER)}
    groups = [Group(name, tuple(each)) for (name, *_), each in together.items()]
    return sorted(groups, key=lambda group: (group.first.shipped, group.first.form, -of_budget[group.first.budget],
                                             place.get(group.variant, len(_ORDER)), group.name))  # fmt: skip
