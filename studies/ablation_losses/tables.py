"""What the networks reach, variant by variant, with intervals over the seeds, beside the source paper's figures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pandas import DataFrame, Series

from studies.ablation_losses.records import ALL, PIXELS, PLAIN, Group, Training, groups_of
from studies.ablation_losses.trainings import COMMAND
from studies.kit.frames import across, joined, markdown, mean, summary, values_of, where

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
CONFIDENCE = 0.95
_SIDES = "llrrrrrrrrrrlr"
_HOW_TO_READ = (
    "How to read it: ± is half of the 95 % interval of the mean over the seeds, by Student's t with one degree of "
    "freedom less than there are seeds; it is about other seeds on these scenes, not other scenes. A seed decides "
    "first weights, samples and batches, the same for every variant: differences to all terms of its budget are taken "
    "seed by seed. Where an interval of a difference holds 0, no difference was seen. One seed has no interval."
)


@dataclass(frozen=True)
class Interval:
    """The mean of a figure over seeds, and half its 95 % interval: NaN of fewer than two."""

    mean: float
    half: float

    def __format__(self, form: str) -> str:
        return f"{self.mean:{form}}" + (f" ± {self.half:{form.lstrip('+')}}" if np.isfinite(self.half) else "")


def interval_of(values: Series) -> Interval:
    """Of a figure of each seed."""
    from scipy.special import stdtrit

    n = len(values)
    half = stdtrit(n - 1, (1 + CONFIDENCE) / 2) * float(values.std()) / n**0.5 if n > 1 else np.nan
    return Interval(float(values.mean()), float(half))


def over_seeds(frame: DataFrame, group: Group, column: str) -> Series:
    """A figure of each seed, the mean over the scenes."""
    return Series({each.seed: where(frame, training=each.name)[column].mean() for each in group.trainings})


def against(frame: DataFrame, group: Group, base: Group, column: str) -> Interval | None:
    """What a figure gains over another group's, seed by seed; None without a seed that both have."""
    gains = (over_seeds(frame, group, column) - over_seeds(frame, base, column)).dropna()
    return interval_of(gains) if len(gains) else None


def tables(frame: DataFrame, trainings: Sequence[Training]) -> str:
    """What every variant reaches alone, beside the paper's figures."""
    groups = groups_of(trainings)
    trained = [training for training in trainings if not training.shipped]
    incidences = sorted(values_of(frame, "incidence_deg"))
    levels = joined(mean("transmission"), mean("reflection"))
    by_incidence = across("incidence_deg", incidences, levels, "{:g} deg".format)
    names = {each.name: group.name for group in groups for each in group.trainings}
    named = frame.assign(group=frame.training.map(names))
    ordered = named.set_index("group").loc[[group.name for group in groups]].reset_index()
    return "\n\n".join([
        "# What each term of the loss is worth",
        f"Networks alone, without a solve, mean over {len(values_of(frame, 'pair', 'incidence_deg'))} scenes of the "
        "paper's protocol, and over the seeds. The paper's own figures are of its photographs, which are not "
        "published: compare differences, not levels.",
        _budgets(trained) if trained else _how_to_train(),
        _HOW_TO_READ,
        markdown(DataFrame([_line(frame, groups, group) for group in groups], dtype=object), _SIDES),
        "Transmission / reflection in dB per incidence:",
        markdown(summary(ordered, {"training": "group"}, by_incidence), "lr"),
        "The paper's Table 3 and Fig. 7 (other photographs):",
        markdown(_published(trained), "lrl"),
    ])  # fmt: skip


def _how_to_train() -> str:
    return "\n".join([
        "No records were given (`--records RECORDS`). This command makes them, the same budget for all, as large as "
        "there is time for; it says early how long they take, and started again it makes what is missing.",
        "",
        f"    {COMMAND}",
    ])  # fmt: skip


def _budgets(trained: Sequence[Training]) -> str:
    budgets = list(dict.fromkeys(training.budget for training in trained))
    hours = sum(training.seconds for training in trained) / 3600
    features = sorted({training.features for training in trained} - {"", "pixels"})
    said = (
        f"THE BUDGETS DIFFER: {'; '.join(budgets)}. Each line is compared with all terms of its own budget."
        if len(budgets) > 1
        else f"The same budget for all: {budgets[0]}."
    )
    compared = f" The perceptual loss compares: {'; '.join(features)}." if features else ""
    return f"{said} {len(trained)} trainings, {hours:.2f} hours together.{compared}"


def _line(frame: DataFrame, groups: Sequence[Group], group: Group) -> dict[str, str]:
    base = next((each for each in groups if each.variant == ALL and each.compares_with(group)), None)

    def level(column: str, form: str = ".2f") -> str:
        return f"{interval_of(over_seeds(frame, group, column)):{form}}"

    def gain(column: str, form: str = "+.2f") -> str:
        if base is None or base is group:
            return ""
        found = against(frame, group, base, column)
        return "" if found is None else f"{found:{form}}"

    paper = printed(group)
    return {
        "training": group.name,
        "variant": group.variant,
        "seeds": str(len(group.trainings)),
        "T": level("transmission"),
        "T SSIM": level("transmission_ssim", ".3f"),
        "R": level("reflection"),
        "R SSIM": level("reflection_ssim", ".3f"),
        "T against all terms": gain("transmission"),
        "T SSIM against": gain("transmission_ssim", "+.3f"),
        "R against": gain("reflection"),
        "the paper: T, SSIM": _in_print(paper, ""),
        "the paper: against all": "" if paper is None else f"{paper[0] - TABLE_3[ALL][0]:+.1f}",
        "budget": group.first.budget,
        "minutes each": f"{np.mean([each.seconds for each in group.trainings]) / 60:.1f}",
    }


def printed(group: Group) -> tuple[float, float] | None:
    """What the paper prints of a variant: PSNR in dB and SSIM of the transmission."""
    return None if group.first.shipped else TABLE_3.get(group.variant)


def _in_print(figures: tuple[float, float] | None, nothing: str) -> str:
    return nothing if figures is None else f"{figures[0]:.1f} / {figures[1]:.3f}"


def _published(trained: Sequence[Training]) -> DataFrame:
    """What the paper prints, variant by variant, and whether there is a training of it here."""
    there = {training.variant for training in trained}
    lines = [
        [variant, _in_print(TABLE_3.get(variant), "-"), FIGURE_7.get(variant, "-"), "yes" if variant in there else "no"]
        for variant in dict.fromkeys((*TABLE_3, *FIGURE_7))
    ]
    return DataFrame(lines, columns=["variant", "PSNR / SSIM", "Fig. 7", "here"])
