"""What each part of the separation is worth: the whole, and without each part, on the paper's six incidences.

Run ``polaropt study ablation -o OUT``. Differences are to the whole on the same scenes; their intervals come from
resampling the pairs of photographs. The learned start is no part of the whole: there it is put in. A second table has
every term of the objective at several times its weight, beside the other terms and without the one nearest to it.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from pandas import DataFrame
from threadpoolctl import threadpool_limits

from polaropt.capture import noise_level, planes_last
from polaropt.errors import InputError
from polaropt.optics import SceneParameters
from polaropt.solving import Weights, check_start
from studies.camera import Sample, SceneJob
from studies.kit.charts import BLUE, ORANGE, Fill, crops, new_figure
from studies.kit.frames import across, joined, markdown, mean, median, summary, values_of, where
from studies.kit.run import effort_of, publish, run_study, study_parser
from studies.photographs import N_PAIRS, n_pairs_of
from studies.scenes import INCIDENCES_DEG, protocol
from studies.scores import LAYERS, psnr_and_ssim
from studies.ways import LEARNED, PARTS, WHOLE, Part, seen_in_training, weights_digest

NAME = "ablation"
QUICK_INCIDENCES_DEG, QUICK_SIZE, SIZE = (10, 60), 128, 256
SHOWN_DEG = 60.0
"""Incidence of the crops."""
WORTH_DB = 0.05
"""A part earns its place if the mean of either layer is better by this with it than without."""
FACTORS = (0.0, 1.0, 10.0, 100.0)
"""On a term's weight."""
NEIGHBOURS = {
    "misfit": "natural_image",
    "edge_independence": "gradient_sparsity",
    "gradient_sparsity": "edge_independence",
    "nonnegativity": "natural_image",
    "natural_image": "gradient_sparsity",
}
"""Of each term of the objective the one that does most nearly the same: edges, or what is expected of a layer."""
FEWEST_PAIRS = 4
"""An interval over fewer says nothing."""
_SEED = 0


@dataclass(frozen=True)
class Row:
    """One solve: PSNR in dB and SSIM of both layers, 16 px at the border left out; seconds without the estimate.

    `not_run` says why it was not; empty if it was.
    """

    variant: str
    pair: int
    incidence_deg: float
    transmission: float = math.nan
    reflection: float = math.nan
    transmission_ssim: float = math.nan
    reflection_ssim: float = math.nan
    evaluations: int = 0
    seconds: float = math.nan
    not_run: str = ""


@dataclass(frozen=True)
class Weighting:
    """A term of the objective at so many times its weight, with its neighbour or without."""

    term: str
    factor: float
    alone: bool

    @property
    def weights(self) -> Weights:
        """Of the objective."""
        neighbour = {NEIGHBOURS[self.term]: 0.0} if self.alone else {}
        return Weights(**{self.term: self.factor, **neighbour})

    @property
    def part(self) -> Part:
        """As a variant of the whole, of a name of its own."""
        without = f" without {_words(NEIGHBOURS[self.term])}" if self.alone else ""
        return Part(f"{_words(self.term)} x{self.factor:g}{without}", "", self.weights)


WEIGHTINGS = tuple(
    Weighting(term, factor, alone) for term in NEIGHBOURS for alone in (False, True) for factor in FACTORS
)


def _words(term: str) -> str:
    return {"natural_image": "natural-image prior"}.get(term, term.replace("_", " "))


def run(job: SceneJob) -> list[Row]:
    """Solve one scene without each part and with each weighting."""
    return [*rows_of_parts(job), *rows_of_weightings(job)]


def rows_of_parts(job: SceneJob) -> list[Row]:
    """Solve one scene without each part; those that ask the same of the estimate share it."""
    sample = job.sample()
    noise = noise_level(sample.capture)
    estimates: dict[SceneParameters, SceneParameters] = {}
    rows = []
    with threadpool_limits(1, "blas"):
        for part in PARTS:
            if part.hint not in estimates:
                estimates[part.hint] = part.estimate(sample.capture, noise)
            rows.append(_row(job, part, sample, estimates[part.hint]))
    return rows


def rows_of_weightings(job: SceneJob) -> list[Row]:
    """Solve one scene with each weighting; several are the same objective, as all that leave every factor at 1."""
    sample = job.sample()
    rows: list[Row] = []
    made: dict[Weights, Row] = {}
    with threadpool_limits(1, "blas"):
        estimate = PARTS[0].estimate(sample.capture, noise_level(sample.capture))
        for weighting in WEIGHTINGS:
            weights, part = _plain(weighting.weights), weighting.part
            if weights not in made:
                made[weights] = _row(job, part, sample, estimate)
            rows.append(replace(made[weights], variant=part.name))
    return rows


def _plain(weights: Weights) -> Weights:
    """The same weights, a factor of 1 as the default."""
    return Weights(**{term: None if weights.factor(term) == 1 else weights.factor(term) for term in NEIGHBOURS})


def _row(job: SceneJob, part: Part, sample: Sample, estimate: SceneParameters) -> Row:
    began = time.perf_counter()
    try:
        check_start(part.init)
        if part.init == LEARNED and (reason := seen_in_training(job.photos)):
            return Row(part.name, job.pair, job.scene.value, not_run=reason)
        solved = part.solved(sample.capture, estimate, sample.scene)
    except InputError as error:
        return Row(part.name, job.pair, job.scene.value, not_run=str(error))
    seconds = time.perf_counter() - began
    quality = psnr_and_ssim(solved.layers, sample.layers)
    return Row(part.name, job.pair, job.scene.value, *quality, solved.solver.n_evaluations, seconds)


Gain = tuple[float, float, float]
"""Mean and ends of its interval, in dB."""


def difference(frame: DataFrame, part: Part, layer: str) -> Gain:
    """Mean PSNR with the part less that without it, in dB, and its 95 % interval over pairs."""
    from scipy.stats import bootstrap  # two seconds: only where there are pairs

    whole, other = (where(frame, variant=name).groupby("pair")[layer].mean() for name in (WHOLE, part.name))
    gain = (other - whole if part.added else whole - other).to_numpy()
    average = float(gain.mean())
    if len(gain) < FEWEST_PAIRS:
        return average, math.nan, math.nan
    if np.ptp(gain) == 0:
        return average, average, average
    interval = bootstrap((gain,), np.mean, method="percentile", rng=np.random.default_rng(_SEED)).confidence_interval
    return average, float(interval.low), float(interval.high)


_HEADS = (
    "part", "instead", "T", "R", "T SSIM", "R SSIM", "T gained by it", "R gained by it", "evaluations", "s", "",
)  # fmt: skip
_MEANS = (
    mean("transmission"), mean("reflection"), mean("transmission_ssim", ".3f"), mean("reflection_ssim", ".3f"),
)  # fmt: skip
_WORK = (median("evaluations", ".0f"), median("seconds"))


def tables(frame: DataFrame) -> str:
    """Means over all scenes and the worth of every part; PSNR of both layers per incidence, and by the weights."""
    weighed = frame.variant.isin({weighting.part.name for weighting in WEIGHTINGS})
    by_weight, frame = frame[weighed], frame[~weighed]
    worth = DataFrame([_line(frame, part) for part in PARTS], columns=_HEADS, dtype=object)
    both = joined(*_MEANS[:2])
    by_incidence = across(
        "incidence_deg",
        sorted(values_of(frame, "incidence_deg")),
        lambda rows: "not run" if max(rows.not_run) else both(rows),
        "{:g} deg".format,
    )
    named = frame.assign(change=frame.variant.map({part.name: part.change for part in PARTS}))
    parts = [worth, summary(named, {"part": "change"}, by_incidence)]
    if len(by_weight):
        parts.append(_by_weight(by_weight))
    return "\n\n".join(map(markdown, parts))


def _by_weight(frame: DataFrame) -> DataFrame:
    """PSNR of both layers, mean over all scenes, for every term at each factor on its weight."""
    both = joined(*_MEANS[:2])
    lines = [
        [
            _words(term),
            f"without {_words(NEIGHBOURS[term])}" if alone else "",
            *(both(where(frame, variant=Weighting(term, factor, alone).part.name)) for factor in FACTORS),
        ]
        for term in NEIGHBOURS
        for alone in (False, True)
    ]
    return DataFrame(lines, columns=["term", "", *(f"x{factor:g}" for factor in FACTORS)], dtype=object)


def _line(frame: DataFrame, part: Part) -> list[str]:
    rows = where(frame, variant=part.name)
    if reason := max(rows.not_run):
        return [part.change, part.instead, *[""] * (len(_HEADS) - 3), f"not run: {reason}"]
    gains = [difference(frame, part, layer) for layer in LAYERS]
    *gained, verdict = [""] * 3 if part.name == WHOLE else [*map(_in_words, gains), _verdict(gains, added=part.added)]
    means, work = ([cell(rows) for cell in cells] for cells in (_MEANS, _WORK))
    return [part.change, part.instead, *means, *gained, *work, verdict]


def _in_words(gain: Gain) -> str:
    average, low, high = gain
    return f"{average:+.2f}" + ("" if math.isnan(low) else f" ({low:+.2f} to {high:+.2f})")


def _verdict(gains: Sequence[Gain], *, added: bool) -> str:
    if math.isnan(gains[0][1]):
        return "too few pairs"
    if any(average > WORTH_DB and low > 0 for average, low, _ in gains):
        return "would earn a place" if added else "earns its place"
    if any(average < -WORTH_DB and high < 0 for average, _, high in gains):
        return "better without"
    return "does not show here"


_COLUMNS = 8
_TICKS_DB = (-10, -3, -1, -0.5, 0, 0.5, 1, 3, 10, 20)
_FILLS = (Fill(BLUE, ""), Fill(ORANGE, "///"))


def figures(frame: DataFrame, shown: SceneJob | None = None) -> dict[str, Callable[[], Any]]:
    """What each part gains, and crops of a scene that is solved without each."""
    absent = set(frame.variant[frame.not_run != ""])
    parts = [part for part in PARTS if part.name not in absent]
    charts = {"gained": lambda: _gains(frame, parts[1:])}
    return charts if shown is None else charts | {"crops": lambda: crops(_solved(shown, parts), _COLUMNS)}


def _gains(frame: DataFrame, parts: Sequence[Part]) -> Any:
    """Bars of the dB that every part gains on both layers, with their intervals."""
    figure = new_figure(8, 0.5 * len(parts) + 1.4)
    axes = figure.subplots()
    places = np.arange(len(parts))[::-1]
    for i, (layer, fill) in enumerate(zip(LAYERS, _FILLS, strict=True)):
        average, low, high = np.transpose([difference(frame, part, layer) for part in parts])
        spread = np.nan_to_num(np.stack([average - low, high - average])).clip(0)
        axes.barh(
            places - 0.4 * i + 0.2, average, 0.38, xerr=spread, error_kw={"linewidth": 1}, label=layer, **fill.bar
        )
    axes.set_yticks(places, [part.name for part in parts])
    axes.set_xscale("symlog", linthresh=1)
    low, high = axes.get_xlim()
    axes.set_xticks(_TICKS_DB, [f"{tick:g}" for tick in _TICKS_DB])
    axes.set_xlim(min(low, -0.5), 1.3 * high)
    axes.axvline(0, color="black", linewidth=0.8)
    axes.set_xlabel("PSNR with the part less that without it (dB; linear within 1 dB, logarithmic beyond)")
    axes.legend(loc="lower right")
    return figure


def _solved(job: SceneJob, parts: Sequence[Part]) -> dict[str, Sequence[np.ndarray]]:
    """Both layers (h, w, 3) of one scene: the truth, and what is made of it without each part."""
    sample = job.sample()
    estimate = parts[0].estimate(sample.capture, noise_level(sample.capture))
    shown: dict[str, Sequence[np.ndarray]] = {"truth": job.photographs.frames}
    for part in parts:
        if part.init == LEARNED and seen_in_training(job.photos):
            continue
        layers = part.solved(sample.capture, estimate, sample.scene).layers
        shown[part.change.replace("without ", "without\n").replace("with ", "with\n")] = [*map(planes_last, layers)]
    return shown


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the study."""
    options = study_parser(__doc__).parse_args(arguments)
    quick = effort_of(options) == "quick"
    size = QUICK_SIZE if quick else SIZE
    jobs = [
        SceneJob(protocol(incidence), pair, options.photos, size)
        for pair in range(n_pairs_of(options, 2 if quick else N_PAIRS, size))
        for incidence in (QUICK_INCIDENCES_DEG if quick else INCIDENCES_DEG)
    ]
    frame = run_study(NAME, run, jobs, Row, options, {"weights": weights_digest()})
    shown = SceneJob(protocol(SHOWN_DEG), 0, options.photos, size)
    publish(NAME, options, tables(frame), figures(frame, shown))


if __name__ == "__main__":
    main()
