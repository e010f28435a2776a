"""Records of trainings, as `polaropt train` leaves them: what was left out, at what budget; and how to make them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from polaropt.errors import InputError

ALL = "all terms"
PIXELS, PLAIN = "raw pixels for features", "plain CNN"
TERMS = ("pixelwise", "perceptual", "pse", "edge_independence", "adversarial")
_ORDER = (ALL, *(f"without {term}" for term in TERMS[1:]), f"without {TERMS[0]}", PIXELS, PLAIN)
RECORD, WEIGHTS = "record.json", "weights.safetensors"


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
    polarnet : str
    variant : str
        What it leaves out or replaces, see `variant_of`.
    budget : str
        Steps, samples and size: what must be equal for a comparison.
    features : str
        What the perceptual loss compares; empty without it.
    seconds : float
    """

    name: str
    weights: Path
    digest: str
    form: str
    polarnet: str
    variant: str
    budget: str
    features: str
    seconds: float


def variant_of(record: dict[str, Any]) -> str:
    """What a training leaves out of the published losses or replaces; `ALL` where that is nothing."""
    options, architecture = record["options"], record["architecture"]
    factors = options["weights"]
    if factors.get("decibel"):
        return " and ".join(("decibels", *(term for term in TERMS if factors[term])))
    said = [f"without {term}" for term in TERMS if not factors[term]]
    if factors["perceptual"] and record["perceptual_features"] == "pixels":
        said.append(PIXELS)
    if architecture["polarnet"] == "plain":
        said.append(PLAIN)
    return ", ".join(said) or ALL


def training_of(name: str, record_file: Path, weights: Path) -> Training:
    """A training from its record.

    Raises
    ------
    InputError
        The record is none of `polaropt train`, or there are no weights beside it.
    """
    try:
        record = json.loads(record_file.read_text(encoding="utf-8"))
        options, architecture = record["options"], record["architecture"]
        return Training(
            name,
            weights,
            record["sha256"],
            architecture["form"],
            architecture["polarnet"],
            variant_of(record),
            f"{record['steps']} steps of {options['batch_size']} samples of {record['size_px']} px",
            record["perceptual_features"] or "",
            float(record["seconds"]),
        )
    except (KeyError, TypeError, ValueError):
        raise InputError(f"{record_file}: is no record of a training; give what polaropt train has written") from None


def trainings_in(folder: Path) -> list[Training]:
    """All trainings below a folder, ordered by what they leave out."""
    found = [
        training_of(file.parent.relative_to(folder).as_posix(), file, file.parent / WEIGHTS)
        for file in sorted(folder.rglob(RECORD))
        if (file.parent / WEIGHTS).is_file()
    ]
    if not found:
        raise InputError(f"{folder}: no folder with {RECORD} and {WEIGHTS} in it; train with polaropt train -o FOLDER")
    return sorted(found, key=_place)


def _place(training: Training) -> tuple[str, int, str]:
    """By form, then as the paper has them."""
    known = training.variant in _ORDER
    return training.form, _ORDER.index(training.variant) if known else len(_ORDER), training.name


def shipped_trainings() -> list[Training]:
    """Those whose weights are inside the package."""
    from priors import learned

    records = sorted(learned.WEIGHTS.glob("*.json"))
    return [training_of(f"shipped, {file.stem}", file, file.with_suffix(".safetensors")) for file in records]


_VARIANTS = {
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
    return [f"{begin} {extra}{' ' if extra else ''}-o {folder}/{name}" for name, extra in _VARIANTS.items()]


def differing_budgets(trainings: Sequence[Training]) -> list[str]:
    """Budgets of several trainings, where they are not all the same."""
    budgets = list(dict.fromkeys(training.budget for training in trainings))
    return budgets if len(budgets) > 1 else []
