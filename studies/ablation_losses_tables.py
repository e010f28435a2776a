"""The ablation of the losses in words and tables: what every variant reaches alone, beside the paper's figures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from studies.ablation_published import FIGURE_7, TABLE_3
from studies.ablation_records import ALL, Training, commands, differing_budgets

_COLUMNS = ("transmission", "transmission_ssim", "reflection", "reflection_ssim")


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


def means(rows: Sequence[Row], training: str) -> tuple[float, float, float, float]:
    """PSNR and SSIM of the transmission, then of the reflection, mean over all scenes."""
    part = [row for row in rows if row.training == training]
    first, second, third, fourth = (float(np.mean([getattr(row, name) for row in part])) for name in _COLUMNS)
    return first, second, third, fourth


def reference(trainings: Sequence[Training], training: Training) -> Training | None:
    """The training with all terms that a variant is set against: of the same form, and trained, not shipped."""
    return next((t for t in trainings if t.variant == ALL and t.form == training.form), None)


def page(rows: Sequence[Row], trainings: Sequence[Training]) -> str:
    """The study in Markdown."""
    trained = [training for training in trainings if not _shipped(training)]
    n_scenes = len({(row.pair, row.incidence_deg) for row in rows})
    lines = [
        "# What each term of the loss is worth",
        "",
        f"Networks alone, without a solve, mean over {n_scenes} scenes of the paper's protocol. The paper's own "
        "figures are of its photographs, which are not published: compare differences, not levels. Each training is "
        "one seed; another seed changes its figures as well.",
        "",
        *(_how_to_train() if not trained else _budget(trained)),
        "",
        *_table(rows, trainings),
        "",
        *_incidences(rows, trainings),
        "",
        *_published(trained),
    ]
    return "\n".join(lines)


def _shipped(training: Training) -> bool:
    return training.name.startswith("shipped")


def _how_to_train() -> list[str]:
    return [
        "No records were given (`--records RECORDS`). These commands make them; take as many steps as there is time "
        "for, the same for all. A training that was interrupted goes on with `--resume`.",
        "",
        *(f"    {command}" for command in commands()),
    ]


def _budget(trained: Sequence[Training]) -> list[str]:
    budgets = differing_budgets(trained)
    hours = sum(training.seconds for training in trained) / 3600
    features = sorted({training.features for training in trained} - {"", "pixels"})
    told = (
        f"THE BUDGETS DIFFER: {'; '.join(budgets)}. What follows compares them as well."
        if budgets
        else f"The same budget for all: {trained[0].budget}."
    )
    compared = f" The perceptual loss compares: {'; '.join(features)}." if features else ""
    return [f"{told} {len(trained)} trainings, {hours:.2f} hours together.{compared}"]


def _table(rows: Sequence[Row], trainings: Sequence[Training]) -> list[str]:
    lines = [
        "| training | form | variant | T | T SSIM | R | R SSIM | T against all terms | the paper: T, SSIM "
        "| the paper: against all | budget | minutes |",
        "|---|---|---|" + "---:|" * 7 + "---|---:|",
    ]
    for training in trainings:
        found = means(rows, training.name)
        base = None if _shipped(training) else reference(trainings, training)
        gain = "" if base is None else f"{found[0] - means(rows, base.name)[0]:+.2f}"
        lines.append(
            f"| {training.name} | {training.form} | {training.variant} | {found[0]:.2f} | {found[1]:.3f} "
            f"| {found[2]:.2f} | {found[3]:.3f} | {gain} | {' | '.join(_of_the_paper(training))} | {training.budget} "
            f"| {training.seconds / 60:.0f} |"
        )
    return lines


def _of_the_paper(training: Training) -> tuple[str, str]:
    """PSNR / SSIM as printed for a variant, and the difference to all terms; empty where nothing is printed."""
    printed = None if _shipped(training) else TABLE_3.get(training.variant)
    if printed is None:
        return "", ""
    return f"{printed[0]:.1f} / {printed[1]:.3f}", f"{printed[0] - TABLE_3[ALL][0]:+.1f}"


def _incidences(rows: Sequence[Row], trainings: Sequence[Training]) -> list[str]:
    incidences = sorted({row.incidence_deg for row in rows})
    lines = [
        "Transmission / reflection in dB per incidence:",
        "",
        "| training | " + " | ".join(f"{theta:g} deg" for theta in incidences) + " |",
        "|---|" + "---:|" * len(incidences),
    ]
    for training in trainings:
        own = [[row for row in rows if (row.training, row.incidence_deg) == (training.name, t)] for t in incidences]
        cells = [" / ".join(f"{np.mean([getattr(row, layer) for row in part]):.2f}" for layer in _COLUMNS[::2])
                 for part in own]  # fmt: skip
        lines.append(f"| {training.name} | " + " | ".join(cells) + " |")
    return lines


def _published(trained: Sequence[Training]) -> list[str]:
    """What the paper prints, variant by variant, and whether there is a training of it here."""
    there = {training.variant for training in trained}
    lines = ["The paper's Table 3 and Fig. 7 (other photographs):", "", "| variant | PSNR / SSIM | Fig. 7 | here |",
             "|---|---:|---|---|"]  # fmt: skip
    for variant in dict.fromkeys((*TABLE_3, *FIGURE_7)):
        printed = TABLE_3.get(variant)
        figure = "-" if printed is None else f"{printed[0]:.1f} / {printed[1]:.3f}"
        said = FIGURE_7.get(variant, "-")
        lines.append(f"| {variant} | {figure} | {said} | {'yes' if variant in there else 'no'} |")
    return lines
