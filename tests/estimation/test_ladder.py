"""Which rung is taken, and what is said of each, where it is known how much polarized light each leaves."""

from __future__ import annotations

import itertools
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import reduce
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from polaropt import InputError, SceneParameters
from polaropt.estimation import ladder, rung, rungs
from polaropt.estimation.flat.errors import weighted_incidence
from polaropt.estimation.flat.estimate import SceneEstimate
from polaropt.estimation.flat.samples.ghosts import SampledPane
from polaropt.estimation.flat.samples.light import PolarizedPane
from polaropt.estimation.rung import Evidence, Rung, RungFit, noise_misfit
from polaropt.estimation.wide.blocks import SCATTERS
from polaropt.estimation.wide.fits import PerspectiveFit
from polaropt.optics import Rival, SceneErrors


def replace_in(names: SimpleNamespace, **changes: object) -> SimpleNamespace:
    return SimpleNamespace(**{**vars(names), **changes})


PLAIN = SceneParameters(55.0, 20.0, 4.0)
BLIND = SceneParameters(None, None, None)
LENS, BENT = PLAIN.replace(focal_px=90.0), PLAIN.replace(bend_deg_per_px=(0.1, 0.0, 0.0))
OTHER = Rival(PLAIN.replace(incidence_deg=70.0), 0.4)
ALL, MOST, HALF, HARDLY = 1.0, 2.0, 4.0, 8.0
"""What a rung leaves of light of misfit 10: nothing but noise, or 11, 33 and 78 % of it."""


@dataclass(frozen=True)
class Estimated:
    """What the ladder asks of the plain pane's estimate."""

    scene: SceneParameters = PLAIN
    errors: SceneErrors = SceneErrors(incidence_deg=0.3)  # noqa: RUF009 (frozen)
    rivals: tuple[Rival, ...] = (OTHER,)


@pytest.fixture(autouse=True)
def _large_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Large blocks of a mosaic's cells show what they are said to."""
    large = lambda stokes, most: SimpleNamespace(constant_misfit=lambda azimuth: stokes.in_large)  # noqa: E731
    monkeypatch.setattr(rung, "PolarizedBlocks", large)


def evidence(
    misfit: float = 10.0,
    wanted: str = "auto",
    asked: SceneParameters | None = None,
    aliased: bool = False,
    in_large: float = 1.0,
) -> Evidence:
    open_scene = SceneParameters(None, None, None)
    stokes, blocks = SimpleNamespace(aliased=aliased, in_large=in_large), SimpleNamespace(n=800)
    return Evidence(None, 0.005, stokes, blocks, asked or open_scene, Estimated(), misfit, wanted)


def leaves(misfit: float, known: bool = True, scene: SceneParameters = LENS, **more: object) -> RungFit:
    return RungFit(scene, misfit, 2, known, **more)


def climbed(attempts: dict[str, RungFit], patch: pytest.MonkeyPatch, **given: object) -> ladder.LadderResult:
    """Up a ladder of rungs that make these attempts, a clock that ticks once a look, and no ghosts to be found."""
    seconds = itertools.count()
    patch.setattr(ladder, "RUNGS", [
        Rung(name.split()[0], lambda evidence: True, lambda evidence, fit=fit: fit) for name, fit in attempts.items()
    ])  # fmt: skip
    patch.setattr(ladder.time, "perf_counter", lambda: float(next(seconds)))
    patch.setattr(ladder, "with_ghosts", lambda evidence, attempt: attempt)
    return ladder._climbed(evidence(**given), 7.0, "A remark.")


LEFT = "It leaves polarized light unexplained. A remark."
BEST = "No higher rung explains what it leaves. A remark."
UNKNOWN = "The photographs do not tell it."
ASKED, ANOTHER = "It is the one asked for.", "Another one was asked for."
EDGES = {"told_by_edges": True}
AGAINST = {"known": False, "second_choice": True}
CLIMBS = {
    "the first that explains all": (
        {"perspective": leaves(ALL), "curved": leaves(ALL)}, {}, 1, [LEFT, "It explains 100 % of"]),
    "what is not told is not taken": (
        {"perspective": leaves(ALL, False, remark="Why."), "curved": leaves(ALL)},
        {}, 2, [LEFT, f"{UNKNOWN} Why.", "It explains 100 % of"]),
    "what explains too little": (
        {"perspective": leaves(HARDLY), "curved": leaves(6.0)},
        {}, 0, [BEST, "It explains only 22 % of the polarized light that the ghosts rung leaves.", "It explains only"]),
    "the best of those that explain most": (
        {"perspective": leaves(HALF), "curved": leaves(MOST)},
        {}, 2, [LEFT, "It explains 67 % of the polarized light that the ghosts rung leaves, another one more.",
                "It explains 89 % of the polarized light that the ghosts rung leaves."]),
    "the fewer numbers": (
        {"perspective": leaves(MOST), "curved": replace(leaves(MOST), n_parameters=5)}, {}, 1, [LEFT, "", ""]),
    "compared where blocks agree": (
        {"perspective": leaves(MOST), "curved": leaves(HALF, agreed_misfit=1.5)},
        {}, 2, [LEFT, "", "It explains 94 %"]),
    "edges against it, and no other": (
        {"perspective": leaves(ALL, **AGAINST), "polarized": leaves(ALL)}, {}, 1, [LEFT, UNKNOWN]),
    "edges against it, and another": (
        {"perspective": leaves(ALL, **AGAINST), "curved": leaves(ALL)}, {}, 2, [LEFT, UNKNOWN, "It explains 100 %"]),
    "edges against one that explains little": (
        {"perspective": leaves(MOST, **AGAINST), "polarized": leaves(ALL)},
        {}, 2, [LEFT, UNKNOWN, "It explains 100 %"]),
    "nothing is left": (
        {"perspective": leaves(ALL)}, {"misfit": 1.1}, 0,
        ["It leaves no polarized light beyond the noise. A remark.", ""]),
    "edges tell it where nothing is left": (
        {"polarized": leaves(1.05, **EDGES)}, {"misfit": 1.1}, 1,
        ["It leaves edges unexplained. A remark.", "The layers' edges and spectra tell it."]),
    "edges tell it where more than noise is left": (
        {"polarized": leaves(5.0, **EDGES)}, {"misfit": 1.1}, 0,
        ["It leaves no polarized light beyond the noise. A remark.", ""]),
    "edges of cells tell it where more than noise is left, as something aliases": (
        {"polarized": leaves(5.0, **EDGES)}, {"misfit": 2.0, "aliased": True}, 1,
        ["It leaves edges unexplained. A remark.", "The layers' edges and spectra tell it."]),
    "edges of cells tell nothing where polarized light is left": (
        {"polarized": leaves(HARDLY, **EDGES)}, {"aliased": True}, 0, [BEST, "It explains only 22 %"]),
    "the one asked for": (
        {"perspective": leaves(ALL), "curved": leaves(HARDLY)},
        {"wanted": "curved"}, 1, [ANOTHER + " A remark.", ASKED]),
    "the better of two that are asked for": (
        {"polarized 1": leaves(MOST), "polarized 2": leaves(HALF)},
        {"wanted": "polarized"}, 1, [ANOTHER, ASKED, ANOTHER]),
    "asked for, and not told": (
        {"polarized 1": leaves(MOST, False), "polarized 2": leaves(HALF, False)},
        {"wanted": "polarized"}, 2, [ANOTHER, ANOTHER, ASKED]),
    "one without double images is asked for, and some are given": (
        {}, {"wanted": "pixelwise"}, 0, ["The one asked for does not suit what is given or found. A remark."]),
    "the plain one is asked for": ({"curved": leaves(ALL)}, {"wanted": "ghosts"}, 0, [ASKED + " A remark."]),
}  # fmt: skip


@pytest.mark.parametrize("name", CLIMBS)
def test_the_rung_that_is_taken_and_why(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    attempts, given, taken, said = CLIMBS[name]
    found = climbed(attempts, monkeypatch, **given)
    assert [step.taken for step in found.tried] == [i == taken for i in range(len(said))]
    for step, sentence in zip(found.tried, said, strict=True):
        assert step.reason.startswith(sentence)
        assert step.reason.count(".") >= 1
    fit = [None, *attempts.values()][taken]
    assert found.scene == (PLAIN if fit is None else fit.scene)
    assert found.estimate.rivals == ((OTHER,) if taken == 0 else ())


BEFORE_SKY = PLAIN.scaled(2).replace(reflection_polarization=(0.3, 110.0))
MOSAIC = SimpleNamespace(period=2)


@pytest.mark.parametrize(
    ("possible", "given", "edges", "rivals"),
    [
        (True, {}, False, (OTHER, Rival(BEFORE_SKY.scaled(1 / 2), 0.5))),
        (False, {}, False, (OTHER,)),
        (True, {"asked": BLIND.replace(azimuth_deg=20.0)}, False, (OTHER,)),
        (True, {"asked": BLIND.replace(transmission_polarization=(0.2, 0.0))}, False, (OTHER,)),
        (True, {"wanted": "ghosts"}, False, (OTHER,)),
        (True, {"misfit": 10.0}, False, (OTHER,)),
        # Cells bear it out: what they tell is taken.
        (True, {}, True, ()),
    ],
    ids=["surely", "unsurely", "azimuth given", "light given", "not asked for", "cells show more", "cells, too"],
)
def test_polarized_light_that_tiles_of_a_mosaic_tell_and_cells_do_not_may_be_there(
    possible: bool, given: dict[str, object], edges: bool, rivals: tuple[Rival, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    attempt = leaves(1.0, edges, told_by_edges=True)
    monkeypatch.setattr(ladder, "RUNGS", [Rung("polarized", lambda evidence: True, lambda evidence: attempt)])
    monkeypatch.setattr(ladder, "with_ghosts", lambda evidence, fit: fit)
    monkeypatch.setattr(rung, "polarized_pane", lambda mosaic, scene, asked: PolarizedPane(BEFORE_SKY, possible))
    told = replace(evidence(**{"misfit": 1.1, "aliased": True, **given}), mosaic=MOSAIC)
    assert ladder._climbed(told, 1.0, "").estimate.rivals == rivals


@pytest.mark.parametrize(
    ("scene", "told"),
    [
        (PLAIN, True),
        (PLAIN.replace(ghost_shift=-11.0), False),
        (PLAIN.replace(single_surface=True, ghost_shift=0.0), False),
        (PLAIN.replace(absorption=0.3), False),
        (PLAIN.replace(n_panes=2), False),
    ],
)
def test_tiles_of_a_mosaic_tell_light_of_a_single_clear_pane_with_its_ghosts_near_by(
    scene: SceneParameters, told: bool
) -> None:
    seen = replace(evidence(1.1, aliased=True), mosaic=MOSAIC, estimate=Estimated(scene))
    assert seen.tiles_tell_light is told
    assert replace(seen, mosaic=None).light_of_tiles is None


@pytest.mark.parametrize(("light", "expected"), [(PolarizedPane(BEFORE_SKY, False), True), (None, False)])
def test_of_a_mosaic_tiles_must_speak_for_polarized_light_that_a_plain_pane_explains(
    light: PolarizedPane | None, expected: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rungs, "looks_polarized", lambda stokes, scene: True)
    monkeypatch.setattr(rung, "polarized_pane", lambda mosaic, scene, asked: light)
    seen = evidence(1.1, aliased=True)
    assert rungs._edges_look_polarized(seen)
    assert rungs._edges_look_polarized(replace(seen, mosaic=MOSAIC)) is expected


def test_seconds_of_the_rung_that_is_taken_hold_the_search_for_its_ghosts(monkeypatch: pytest.MonkeyPatch) -> None:
    found = climbed({"perspective": leaves(MOST), "curved": leaves(HALF)}, monkeypatch)
    assert [step.seconds for step in found.tried] == [7.0, 2.0, 1.0]


def test_the_score_is_the_bayesian_information_criterion(monkeypatch: pytest.MonkeyPatch) -> None:
    found = climbed({"perspective": leaves(MOST)}, monkeypatch)
    assert found.tried[1].score == pytest.approx(800 * np.log(2) + 2 * np.log(800))
    assert noise_misfit(800) == pytest.approx(1.25)


ESTIMATE = SceneEstimate(PLAIN, 9.0, SceneErrors(ghost_shift=0.1), True, 1.0, 0.0, np.inf, 0.5, *4 * [np.zeros(1)])


def test_what_is_not_separated_has_no_pane() -> None:
    found = ladder._unseparated(ESTIMATE, 3.0, "Why.")
    assert (found.scene.rung, found.estimate.scene.rung) == ("none", "none")
    assert [(step.rung, step.seconds, step.taken, step.reason) for step in found.tried] == [("none", 3.0, True, "Why.")]


GHOSTS = {
    "flat": (PLAIN, None),
    "before a lens": (LENS, 5.0),
    "bent": (BENT, 5.0),
    "before a lens, given": (LENS, None, {"ghost_shift": 4.0}),
    "water": (LENS.replace(single_surface=True), None),
    "no bounces": (LENS.replace(n_bounces=0), None),
    "polarized": (LENS.replace(transmission_polarization=(0.3, 20.0)), None),
    "two panes": (LENS.replace(n_panes=2), None),
}


@pytest.mark.parametrize("name", GHOSTS)
def test_ghosts_are_looked_for_where_incidence_varies_and_they_are_open(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, expected, *asked = GHOSTS[name]
    scene = scene.replace(ghost_shift=0.0) if expected else scene
    found = SimpleNamespace(shows=True, pixels=5.0)
    spectra = SimpleNamespace(likeliest_shift=lambda: found, incidence=lambda shift: None)
    monkeypatch.setattr(rungs, "VaryingSpectra", lambda *given, **more: spectra)
    given = evidence(asked=SceneParameters(None, None, None).replace(**(asked[0] if asked else {})))
    attempt = leaves(ALL, scene=scene, remark="Before.")
    after = rungs.with_ghosts(given, attempt)
    if expected is None:
        assert after is attempt
    else:
        assert after.scene.ghost_shift == expected
        assert after.remark == "Before. Its double images lie 5.0 px apart."


@pytest.mark.parametrize(("behind", "turned"), [(2.0, True), (0.2, False), (-2.0, False)])
def test_an_azimuth_that_is_told_is_turned_where_the_other_side_suits_the_light_clearly_better(
    behind: float, turned: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = evidence(wanted="perspective", asked=BLIND.replace(azimuth_deg=20.0, focal_px=90.0))

    def fitted(stokes: object, incidence: object, azimuth: float, focal: float) -> PerspectiveFit:
        # Twice what it may scatter by chance, or less.
        more = behind * SCATTERS * given.scatter
        return replace(WELL, misfit=3.0 + (more if azimuth == 20.0 else 0.0))

    monkeypatch.setattr(rungs, "fit_told_perspective", fitted)
    found = rungs._told_perspective(replace(given, capture=SimpleNamespace(focal_px=None)))
    assert found.scene.azimuth_deg == (200.0 if turned else 20.0)
    assert ("leans to the other side" in found.remark) == turned


WELL = PerspectiveFit(54.0, 21.0, 80.0, 0.5, 1.0, 3.0, ALL, 800, True)
NOT_TOLD = "The polarized light does not tell how incidence and azimuth change over the picture."
DARK = "A layer would have less than no light in 17 % of the picture."
BENDS = "The layers' edges tell another incidence: the pane is not flat."
# The fit without a focal length, that with the file's, the file's, what of the layers is negative; whether it is known,
# the focal length taken, its error and what is said.
LENSES = {
    "told": (WELL, None, None, 0.0, (True, 80.0, 3.0, "")),
    "uncertain": (replace(WELL, incidence_error_deg=3.1), None, None, 0.0, (False, 80.0, 3.0, NOT_TOLD)),
    "just certain enough": (replace(WELL, incidence_error_deg=3.0), None, None, 0.0, (True, 80.0, 3.0, "")),
    "no better than chance": (replace(WELL, misfit=9.9), None, None, 0.0, (False, 80.0, 3.0, NOT_TOLD)),
    "less than no light": (WELL, None, None, 0.17, (False, 80.0, 3.0, DARK)),
    "edges against it": (replace(WELL, edges_agree=False), None, None, 0.0, (False, 80.0, 3.0, BENDS)),
    "by the file": (WELL, WELL, 60.0, 0.0, (True, 60.0, None, "")),
    "cropped since": (
        WELL, replace(WELL, misfit=MOST), 60.0, 0.0,
        (True, 80.0, 3.0, "The focal length that the file tells does not fit."),
    ),
    "hardly better without the file's": (
        replace(WELL, misfit=1.9), replace(WELL, misfit=MOST), 60.0, 0.0, (True, 60.0, None, "")),
}  # fmt: skip


@pytest.mark.parametrize("name", LENSES)
def test_a_lens_is_known_where_light_and_edges_tell_it(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    free, with_file, focal_px, negative, expected = LENSES[name]
    monkeypatch.setattr(rungs, "fit_perspective", lambda stokes, focal, plain: free if focal is None else with_file)
    monkeypatch.setattr(rungs, "negative_light", lambda blocks, scene: negative)
    monkeypatch.setattr(rungs, "_tolerant", lambda evidence: None)
    given = replace(evidence(), capture=SimpleNamespace(focal_px=focal_px))
    found = rungs._perspective(given)
    assert (found.known, found.scene.focal_px, found.errors.focal_px, found.remark) == expected
    assert found.second_choice == (expected[-1] == BENDS)
    assert found.n_parameters == (2 if expected[2] is None else 3)
    assert (found.scene.incidence_deg, found.errors.incidence_deg) == (54.0, free.incidence_error_deg)


@pytest.mark.parametrize(("misfit", "tolerant"), [(5.4, False), (5.6, True)])
def test_where_a_lens_explains_less_than_half_blocks_that_disagree_may_be_left_out(
    misfit: float, tolerant: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    instead = leaves(ALL)
    monkeypatch.setattr(rungs, "fit_perspective", lambda *given: replace(WELL, misfit=misfit))
    monkeypatch.setattr(rungs, "negative_light", lambda *given: 0.0)
    monkeypatch.setattr(rungs, "_tolerant", lambda evidence: instead)
    found = rungs._perspective(replace(evidence(), capture=SimpleNamespace(focal_px=None)))
    assert (found is instead) == tolerant


@pytest.mark.parametrize(("change", "share", "focal_px", "found"), [
    ({}, 0.9, None, True), ({"edges_agree": False}, 0.9, None, False), ({"incidence_error_deg": 3.1}, 0.9, None, False),
    ({}, 0.79, None, False), ({}, 0.8, 60.0, True), ({"incidence_deg": 86.0}, 0.9, None, False),
])  # fmt: skip
def test_most_of_the_frame_agrees_on_a_lens(
    change: dict[str, object], share: float, focal_px: float | None, found: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    agreed = SimpleNamespace(pane=replace(WELL, **change), explained=share)
    monkeypatch.setattr(rungs, "fit_tolerant", lambda *given: agreed)
    blocks = SimpleNamespace(n=800, misfit=lambda incidence, azimuth, focal: focal / 10)
    fit = rungs._tolerant(replace(evidence(), capture=SimpleNamespace(focal_px=focal_px), blocks=blocks))
    assert (fit is not None) == found
    if fit is not None:
        assert (fit.scene.focal_px, fit.misfit) == ((80.0, 8.0) if focal_px is None else (60.0, 6.0))
        assert fit.errors.focal_px == (3.0 if focal_px is None else None)
        assert fit.compared == pytest.approx(1 + (1 - share) * 9)
        assert (fit.known, fit.n_parameters) == (True, 3 if focal_px is None else 2)


MIXED = SimpleNamespace(scene=PLAIN, misfit=1.05, errors=SceneErrors(incidence_deg=1.0), negative=0.0, n_parameters=6)
MIXTURES = {
    "told": (MIXED, 10.0, True, "Incidence and azimuth change over the picture."),
    "uncertain": (replace_in(MIXED, errors=SceneErrors(incidence_deg=3.1)), 10.0, False, "Nor does it before a lens."),
    "explains too little": (replace_in(MIXED, misfit=1.3), 10.0, False, "Nor does it before a lens."),
    "explains enough": (replace_in(MIXED, misfit=1.26), 10.0, True, "Incidence and azimuth change over the picture."),
    "less than no light": (replace_in(MIXED, negative=0.17), 10.0, False, DARK),
    "no better than chance": (replace_in(MIXED, misfit=1.0), 1.14, False, "Nor does it before a lens."),
}


@pytest.mark.parametrize("name", MIXTURES)
def test_polarized_light_before_a_lens_is_known_where_it_explains_nearly_all(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    fit, misfit, known, remark = MIXTURES[name]
    monkeypatch.setattr(rungs, "fit_polarized_perspective", lambda *given: fit)
    found = rungs._polarized_perspective(evidence(misfit))
    assert (found.known, found.remark, found.n_parameters) == (known, remark, 6)


# What the fit leaves and gains, what is left without it; whether it is known, and whether edges tell it.
GAINS = {
    "explains all there is": (1.0, 0.001, 10.0, (True, False)),
    "gains nothing": (1.0, -0.001, 10.0, (False, False)),
    "gains enough": (2.0, 0.005, 10.0, (True, False)),
    "gains too little": (2.0, 0.003, 10.0, (False, False)),
    "edges speak of it": (1.0, 0.031, 1.1, (True, True)),
    "edges hardly speak of it": (1.0, 0.029, 1.1, (False, False)),
    "little is left": (1.5, 0.029, 2.0, (False, False)),
    "more is left": (1.5, 0.029, 2.1, (True, False)),
}


@pytest.mark.parametrize("name", GAINS)
def test_polarized_light_is_known_where_it_gains_enough(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    misfit, gain, left, expected = GAINS[name]
    fit = SimpleNamespace(scene=PLAIN, misfit=misfit, gain=gain, errors=SceneErrors(), rivals=(OTHER,))
    monkeypatch.setattr(rungs, "fit_polarized", lambda *given: fit)
    found = rungs._polarized(evidence(left))
    assert (found.known, found.told_by_edges) == expected
    assert found.remark == ("" if found.known else "Polarized light makes it hardly any likelier.")
    assert rungs._polarized(evidence(left, "polarized")).known
    monkeypatch.setattr(rungs, "fit_polarized", lambda *given: None)
    assert not rungs._polarized(evidence(left)).known


BEND = SimpleNamespace(
    incidence_deg=54.0, azimuth_deg=21.0, focal_px=None, bend_deg_per_px=(0.1, 0.0, 0.0), incidence_error_deg=0.5,
    azimuth_error_deg=1.0, focal_error_px=None, bend_error_deg_per_px=(0.01, 0.01, 0.01), edges_agree=True, misfit=ALL,
)  # fmt: skip
AGAINST = "The layers' edges speak against it."
UNBENT = "The polarized light does not tell how the pane is bent."
BENT_PANES = {
    "told": (BEND, 0.0, "auto", (True, "", 5)),
    "uncertain": (replace_in(BEND, incidence_error_deg=3.1), 0.17, "auto", (False, UNBENT, 5)),
    "no better than chance": (replace_in(BEND, misfit=9.9), 0.0, "auto", (False, UNBENT, 5)),
    "less than no light": (BEND, 0.17, "auto", (False, DARK, 5)),
    "edges against it": (replace_in(BEND, edges_agree=False), 0.0, "auto", (False, AGAINST, 5)),
    "asked for": (BEND, 0.17, "curved", (True, "", 5)),
    "before a lens": (replace_in(BEND, focal_px=80.0, focal_error_px=3.0), 0.0, "auto", (True, "", 6)),
}


@pytest.mark.parametrize("name", BENT_PANES)
def test_a_bent_pane_is_known_where_light_tells_it(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    fit, negative, wanted, expected = BENT_PANES[name]
    monkeypatch.setattr(rungs, "fit_curved", lambda *given: fit)
    monkeypatch.setattr(rungs, "negative_light", lambda *given: negative)
    found = rungs._curved(replace(evidence(wanted=wanted), capture=SimpleNamespace(focal_px=None)))
    assert (found.known, found.remark, found.n_parameters) == expected
    assert found.errors.focal_px == fit.focal_error_px


OPEN = SceneParameters(None, None, None)
LIT = {"transmission_polarization": (0.3, 20.0)}
# What is asked, what the plain pane leaves, the rung that is wanted, and what is left off the plane of two Stokes
# vectors; whether polarized light may explain all, and most.
LIGHTS = {
    "all but a little": (OPEN, 11.0, "auto", 2.9, (True, False)),
    "most": (OPEN, 11.0, "auto", 3.1, (False, True)),
    "just most": (OPEN, 11.0, "auto", 7.9, (False, True)),
    "some": (OPEN, 11.0, "auto", 8.1, (False, False)),
    "two panes": (OPEN.replace(n_panes=2), 11.0, "auto", 1.0, (False, False)),
    "given": (OPEN.replace(**LIT), 11.0, "auto", 1.0, (False, False)),
    "before a lens": (OPEN.replace(focal_px=90.0), 11.0, "auto", 1.0, (False, False)),
    "azimuth given": (OPEN.replace(azimuth_deg=20.0), 11.0, "auto", 1.0, (False, False)),
    "asked for": (OPEN, 11.0, "polarized", 8.1, (True, False)),
    "asked for, azimuth given": (OPEN.replace(azimuth_deg=20.0), 11.0, "polarized", 8.1, (True, False)),
    "asked for and given": (OPEN.replace(**LIT), 11.0, "polarized", 1.0, (False, False)),
    "asked for before a lens": (OPEN.replace(focal_px=90.0), 11.0, "polarized", 1.0, (False, False)),
    "edges speak of it": (OPEN, 1.1, "auto", 1.0, (True, False)),
}


@pytest.mark.parametrize("name", LIGHTS)
def test_when_polarized_light_is_looked_for(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    asked, misfit, wanted, off, expected = LIGHTS[name]
    monkeypatch.setattr(rungs, "Mixture", lambda stokes: SimpleNamespace(misfit=off))
    monkeypatch.setattr(rungs, "looks_polarized", lambda stokes, scene: True)
    monkeypatch.setattr(Evidence, "gains_explain", False)
    given = evidence(misfit, wanted, asked)
    assert tuple(rungs._may_be_polarized(given, part) for part in (rungs._ALL_BUT, rungs._MOST_BUT)) == expected
    monkeypatch.setattr(Evidence, "gains_explain", True)
    told = tuple(rungs._may_be_polarized(given, part) for part in (rungs._ALL_BUT, rungs._MOST_BUT))
    assert told == (expected if wanted == "polarized" else (False, False))


@pytest.mark.parametrize(("in_large", "looked_for"), [(2.1, False), (2.3, False), (11.0, True)])
def test_what_large_blocks_of_a_mosaic_show_may_be_polarized_light(
    in_large: float, looked_for: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of that as much must lie in the plane of two Stokes vectors, be it nothing in small blocks."""
    monkeypatch.setattr(rungs, "Mixture", lambda stokes: SimpleNamespace(misfit=1.5))
    monkeypatch.setattr(rungs, "looks_polarized", lambda stokes, scene: False)
    monkeypatch.setattr(Evidence, "gains_explain", False)
    given = evidence(1.2, "auto", OPEN, aliased=True, in_large=in_large)
    assert given.explained is (in_large < 2.2)
    assert rungs._may_be_polarized(given) is looked_for
    # Photographs do not alias, and of frontal glass nothing could be told.
    assert evidence(1.1, "auto", OPEN, in_large=in_large).explained
    assert replace(given, estimate=Estimated(PLAIN.replace(incidence_deg=29.0))).explained


@pytest.mark.parametrize(("shift", "left"), [(0.0, 2.9), (6.0, 1.25)])
def test_what_polarized_light_leaves_in_cells_is_counted_in_units_of_what_aliases(shift: float, left: float) -> None:
    """Only spectra know of images that lie apart; they take all that aliases for light."""
    scene = PLAIN.replace(ghost_shift=shift, transmission_polarization=(0.4, 80.0))
    fit: Any = SimpleNamespace(scene=scene, misfit=5.0, shown=None)
    blocks = SimpleNamespace(n=800, aliases=2.0, plane_misfit=lambda shown: 2.9)
    assert rungs._left_by(fit, replace(evidence(3.7, aliased=True), blocks=blocks)) == left
    assert rungs._left_by(fit, replace(evidence(3.7), blocks=blocks)) == 5.0
    frontal = Estimated(PLAIN.replace(incidence_deg=29.0))
    assert rungs._left_by(fit, replace(evidence(3.7, aliased=True), blocks=blocks, estimate=frontal)) == 5.0


@pytest.mark.parametrize(("incidence_deg", "seen"), [(55.0, True), (5.0, False)])
def test_frontal_glass_is_not_asked_for_polarized_light(
    incidence_deg: float, seen: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rungs, "looks_polarized", lambda stokes, scene: True)
    monkeypatch.setattr(Evidence, "gains_explain", False)
    estimate = Estimated(PLAIN.replace(incidence_deg=incidence_deg))
    assert rungs._may_be_polarized(replace(evidence(1.1, asked=OPEN), estimate=estimate)) == seen


# What is asked, what is left, the rung that is wanted, whether the frame's angle is unknown; whether the pane may vary,
# and light be polarized as well.
PANES_THAT_VARY = {
    "open": (OPEN, 10.0, "auto", False, (True, True)),
    "nothing is left": (OPEN, 1.1, "auto", False, (False, False)),
    "nothing is left, asked for": (OPEN, 1.1, "curved", False, (True, False)),
    "incidence given": (OPEN.replace(incidence_deg=50.0), 10.0, "auto", False, (False, False)),
    "azimuth given": (OPEN.replace(azimuth_deg=50.0), 10.0, "curved", False, (False, False)),
    "angles from an unknown start": (OPEN, 10.0, "auto", True, (False, False)),
    "light given": (OPEN.replace(**LIT), 10.0, "auto", False, (True, False)),
}


@pytest.mark.parametrize("name", PANES_THAT_VARY)
def test_when_a_pane_that_varies_is_looked_for(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    asked, misfit, wanted, start_unknown, expected = PANES_THAT_VARY[name]
    monkeypatch.setattr(Evidence, "gains_explain", False)
    given = replace(evidence(misfit, wanted, asked), capture=SimpleNamespace(start_unknown=start_unknown))
    assert (rungs._may_vary(given), rungs._may_be_polarized_and_vary(given)) == expected
    monkeypatch.setattr(Evidence, "gains_explain", True)
    assert not rungs._may_be_polarized_and_vary(given)
    assert rungs._may_be_polarized_and_vary(replace(given, wanted="polarized")) == expected[1]


@pytest.mark.parametrize(("apart", "explains"), [(0.0, False), (0.049, False), (0.051, True)])
def test_gains_that_are_wrong_leave_no_more_than_six_times_what_does_not_add_up(
    apart: float, explains: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rung, "closure_share", lambda *given: apart)
    blocks = SimpleNamespace(n=800, stokes=[np.full((2, 2), 10.0)])
    capture = SimpleNamespace(intensities=None, angles_deg=None, mask=None)
    assert replace(evidence(10.0), blocks=blocks, capture=capture).gains_explain == explains


GRADIENTS, SPECTRA = (39.0, 0.36), (40.0, 0.36)
# How the scene differs, what gradients tell, and the error of the edges where they count, gradients and spectra, which
# are put together.
TOLD = {
    "edges, gradients and spectra": ({}, GRADIENTS, (0.36, GRADIENTS, SPECTRA)),
    "sure gradients": ({}, (40.1, 0.36), (None, (40.1, 0.36), SPECTRA)),
    "no gradients": ({}, None, (0.36, None, SPECTRA)),
    "two panes": ({"n_panes": 2}, (41.0, 0.3), (0.3, (41.0, 0.3), None)),
    "tinted": ({"absorption": 0.1}, (41.0, 0.3), (0.3, (41.0, 0.3), None)),
    "not from far": ({"focal_px": 90.0, "ghost_shift": 0.0}, GRADIENTS, (0.3, None, None)),
}


@pytest.mark.parametrize("name", TOLD)
def test_edges_gradients_and_spectra_tell_the_incidence_together(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    change, gradients, (edges_error, *others) = TOLD[name]
    monkeypatch.setattr(ladder, "plate_frame", lambda stokes, azimuth: None)
    monkeypatch.setattr(ladder, "cross_spectra", lambda frame: None)
    monkeypatch.setattr(ladder, "spectral_incidence", lambda spectra, scene: SPECTRA)
    monkeypatch.setattr(ladder, "incidence_by_gradients", lambda frame, scene: gradients)
    monkeypatch.setattr(ladder, "with_tiles", lambda frame, scene, errors, asked: (scene, errors))
    scene = PLAIN.replace(incidence_deg=38.0, **change)
    found = ladder.LadderResult(scene, replace(ESTIMATE, scene=scene, errors=SceneErrors(incidence_deg=0.3)), ())
    told = ladder._with_all_told(found, None, BLIND)
    edges = None if edges_error is None else (38.0, edges_error)
    mean, error = reduce(weighted_incidence, [part for part in (edges, *others) if part is not None])
    assert told.scene == told.estimate.scene
    assert (told.scene.incidence_deg, told.errors.incidence_deg) == pytest.approx((mean, error))
    assert (told is found) == (others == [None, None])


def test_tiles_have_the_last_word_on_flat_panes(monkeypatch: pytest.MonkeyPatch) -> None:
    by_tiles = PLAIN.replace(incidence_deg=41.0, ghost_shift=8.2), SceneErrors(incidence_deg=0.1, ghost_shift=0.05)
    monkeypatch.setattr(ladder, "plate_frame", lambda stokes, azimuth: None)
    monkeypatch.setattr(ladder, "cross_spectra", lambda frame: None)
    monkeypatch.setattr(ladder, "spectral_incidence", lambda spectra, scene: SPECTRA)
    monkeypatch.setattr(ladder, "incidence_by_gradients", lambda frame, scene: GRADIENTS)
    monkeypatch.setattr(ladder, "with_tiles", lambda frame, scene, errors, asked: by_tiles)
    found = ladder.LadderResult(PLAIN, replace(ESTIMATE, errors=SceneErrors(incidence_deg=0.3)), ())
    told = ladder._with_all_told(found, None, BLIND)
    assert (told.scene, told.errors) == by_tiles
    assert told.scene == told.estimate.scene


@pytest.mark.parametrize(
    ("asked", "model", "refused"),
    [
        (BLIND, "curved", ""),
        (BLIND.replace(incidence_deg=40.0), "curved", "finds incidence and azimuth itself"),
        (BLIND.replace(azimuth_deg=10.0), "curved", "finds incidence and azimuth itself"),
        (BLIND.replace(azimuth_deg=10.0), "polarized", ""),
        (BLIND.replace(azimuth_deg=10.0, focal_px=90.0), "polarized", "finds incidence and azimuth itself"),
        (BLIND.replace(focal_px=90.0), "polarized", ""),
        (BLIND.replace(focal_px=90.0), "ghosts", "focal length is that of a wide lens"),
        (BLIND.replace(focal_px=90.0), "perspective", ""),
    ],
)
def test_a_model_that_has_no_place_for_what_is_told_is_refused(
    asked: SceneParameters, model: str, refused: str
) -> None:
    with pytest.raises(InputError, match=refused) if refused else nullcontext():
        ladder.check_model(asked, model)


@pytest.mark.parametrize(
    ("wanted", "light_is_open", "stacked", "signal", "looked_for"),
    [
        ("auto", True, False, True, True),
        ("pixelwise", True, False, True, False),
        ("auto", False, False, True, False),
        ("auto", True, True, True, False),
        ("auto", True, False, False, False),
    ],
)
def test_things_that_are_polarized_are_looked_for_where_nothing_else_explains_the_light(
    wanted: str, light_is_open: bool, stacked: bool, signal: bool, looked_for: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ladder, "polarized_things", lambda blocks, apart: "things")
    left = ladder.RungReport("pixelwise", 9.0, 1.0, 0.1, True, "")
    found = ladder.LadderResult(PLAIN.replace(signal=signal), None, (left,))
    light = SimpleNamespace(wanted=wanted, light_is_open=light_is_open, asked=SimpleNamespace(stacked=stacked))
    seen = {"blocks": None, "apart": 0.0, "most_unexplained": 2.0, "gains_explain": False}
    light.__dict__.update(seen, stokes=SimpleNamespace(aliased=False))
    assert ladder._things_beside(found, light) == ("things" if looked_for else None)


class Seen(Exception):
    """What the plain pane's estimate was asked."""


def test_of_a_mosaic_s_cells_a_thickness_is_in_cells(monkeypatch: pytest.MonkeyPatch) -> None:
    def asked(capture: object, scene: SceneParameters, *, noise: float, thickness_px: float, **more: object) -> None:
        raise Seen(scene.transmission_ghost_shift, noise, thickness_px)

    monkeypatch.setattr(ladder, "estimate_scene", asked)
    monkeypatch.setattr(ladder, "stokes_images", lambda *given: None)
    monkeypatch.setattr(ladder, "registered_noise", lambda capture: 0.002)
    monkeypatch.setattr(ladder, "tiles_of_mosaic", lambda capture, noise: None)
    mosaic = SimpleNamespace(cells=1, scale=4, registered=SimpleNamespace(cells=None, start_unknown=False))
    scene = SceneParameters(None, None, None, transmission_ghost_shift=6.0)
    given = {"thickness_px": 10.0, "thickness_kind": "plate"}
    with pytest.raises(Seen) as seen:
        ladder._completed(mosaic, scene, 0.005, "ghosts", **given)
    assert seen.value.args == (1.5, 0.002, 2.5)


def test_what_a_ladder_found_is_told_in_other_pixels_and_with_the_index_s_error() -> None:
    given = ladder.LadderResult(PLAIN, None, ())
    assert given.scaled(2) == ladder.LadderResult(PLAIN.replace(ghost_shift=8.0), None, ())
    assert given.with_index(SimpleNamespace(error=None)) is given
    assert given.with_index(SimpleNamespace(error=0.02)).errors == SceneErrors(refractive_index=0.02)
    found = ladder.LadderResult(PLAIN, replace(ESTIMATE, scene=PLAIN, rivals=()), ())
    assert found.scaled(2).estimate.scene == found.scaled(2).scene == PLAIN.replace(ghost_shift=8.0)
    assert found.with_index(SimpleNamespace(error=None)) is found
    assert found.with_index(SimpleNamespace(error=0.02)).errors.refractive_index == 0.02


@pytest.mark.parametrize(
    ("left", "taken", "unexplained"), [(3.0, True, 3.0), (3.0, False, 1.0), (None, True, 1.0), (None, False, 1.0)]
)
def test_what_is_unexplained_is_what_the_rung_taken_leaves(left: float | None, taken: bool, unexplained: float) -> None:
    tried = (
        ladder.RungReport("curved", 9.0, 1.0, 0.1, False, ""),
        ladder.RungReport("ghosts", left, 1, 0.1, taken, ""),
    )
    assert ladder.LadderResult(PLAIN, None, tried).unexplained == unexplained


SAMPLED = SampledPane(shift_px=9.0, shift_error_px=0.2, incidence_deg=57.0, incidence_error_deg=0.5)
# What is asked, the rung that is wanted, whether only the side is to be told, what samples tell of a pane of 8 px and
# 55 degrees; the shift and its error, and whether the incidence is a mean of both.
MOSAICS = {
    "all is open": (OPEN, "auto", False, SAMPLED, (9.0, 0.2), True),
    "ghosts are asked for": (OPEN, "ghosts", False, SAMPLED, (9.0, 0.2), True),
    "another rung is": (OPEN, "pixelwise", False, SAMPLED, (8.0, 0.4), False),
    "all is given": (PLAIN, "auto", False, SAMPLED, (8.0, 0.4), False),
    "the shift is given": (OPEN.replace(ghost_shift=8.0), "auto", False, SAMPLED, (8.0, 0.4), True),
    "the incidence is given": (
        OPEN.replace(incidence_deg=55.0), "auto", False, replace(SAMPLED, incidence_error_deg=None), (9.0, 0.2),
        False),
    "a thickness is": (OPEN, "auto", True, replace(SAMPLED, incidence_error_deg=None), (9.0, 0.4), False),
    "samples tell nothing": (OPEN, "auto", False, None, (8.0, 0.4), False),
    "samples tell of no ghosts": (OPEN, "auto", False, replace(SAMPLED, shift_px=0.0), (0.0, None), True),
    "no ghosts, which are asked for": (OPEN, "ghosts", False, replace(SAMPLED, shift_px=0.0), (8.0, 0.4), False),
}  # fmt: skip


@pytest.mark.parametrize("name", MOSAICS)
def test_samples_of_a_mosaic_tell_ghosts_and_incidence(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    asked, wanted, sense_only, sampled, shift, told = MOSAICS[name]
    seen: list[dict[str, object]] = []

    def samples(capture: object, scene: SceneParameters, noise: float, **how: object) -> object:
        assert (scene.ghost_shift, noise) == (8.0, 0.005)
        seen.append(how)
        return sampled

    monkeypatch.setattr(ladder, "pane_of_samples", samples)
    errors = SceneErrors(incidence_deg=0.3, ghost_shift=0.2)
    reports = tuple(ladder.RungReport(rung, 1.0, 1.0, 0.1, rung == "ghosts", "") for rung in ("ghosts", "curved"))
    of_cells = ladder.LadderResult(PLAIN, replace(ESTIMATE, scene=PLAIN, errors=errors, rivals=()), reports)
    found = ladder.in_full(of_cells, SimpleNamespace(scale=2), asked, 0.005, wanted, sense_only=sense_only)
    assert (found.scene.ghost_shift, found.errors.ghost_shift) == shift
    by_edges = np.hypot(0.3, 0.6)
    mean = weighted_incidence((55.0, by_edges), (57.0, 0.5)) if told else (55.0, 0.3)
    assert (found.scene.incidence_deg, found.errors.incidence_deg) == pytest.approx(mean)
    assert found.estimate.scene == found.scene
    assert [one.rung for one in found.tried] == [found.scene.rung, "curved"]
    if seen:
        (how,) = seen
        assert how.pop("incidence_error_deg") == pytest.approx(by_edges)
        opened = {"open_shift": asked.ghost_shift is None, "sense_only": sense_only}
        assert how == {**opened, "open_incidence": asked.incidence_deg is None and not sense_only}
    assert bool(seen) == (name not in ("another rung is", "all is given"))


BY_TILES = (56.0, 0.4)
# What is asked, the rung that is wanted, what tiles tell of a pane of 4 px of the cells and 55 degrees, and of the
# incidence; the shift that is found, in pixels of half a cell's side, and whether the incidence is a mean of both.
TILES = {
    "all is told": (OPEN, "auto", (12.0, 0.3), BY_TILES, 7.0, True),
    "no ghosts": (OPEN, "auto", (0.0, np.inf), BY_TILES, 0.0, True),
    "no ghosts, which are asked for": (OPEN, "ghosts", (0.0, np.inf), BY_TILES, 8.0, False),
    "no incidence": (OPEN, "auto", (12.0, 0.3), None, 7.0, False),
    "the incidence is given": (OPEN.replace(incidence_deg=55.0), "auto", (12.0, 0.3), BY_TILES, 7.0, False),
    "the shift is given": (OPEN.replace(ghost_shift=8.0), "auto", (12.0, 0.3), BY_TILES, 8.0, True),
}


@pytest.mark.parametrize(("shift", "asked"), [(5.25, True), (5.3, False), (-5.3, False)])
def test_tiles_are_not_asked_of_ghosts_far_off(shift: float, asked: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    tiles = SimpleNamespace(ghosts=lambda asked, incidence: (0.0, np.inf), incidence=lambda scene: None)
    monkeypatch.setattr(ladder, "PaneOfTiles", lambda *_: tiles)
    monkeypatch.setattr(ladder, "pane_of_samples", lambda *_, **__: SAMPLED)
    scene = PLAIN.replace(ghost_shift=shift)
    of_cells = ladder.LadderResult(scene, replace(ESTIMATE, scene=scene, rivals=()), ())
    capture = SimpleNamespace(scale=2, cells=SimpleNamespace(samples="samples"), angles_deg=())
    found = ladder.in_full(of_cells, capture, OPEN, 0.005, mosaic=SimpleNamespace(period=4))
    assert found.scene.ghost_shift == (0.0 if asked else SAMPLED.shift_px)


@pytest.mark.parametrize("name", TILES)
def test_tiles_of_a_mosaic_tell_ghosts_which_samples_make_exact_and_the_incidence(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked, wanted, ghosts, incidence, shift, counts = TILES[name]
    tiles = SimpleNamespace(ghosts=lambda asked, incidence: ghosts, incidence=lambda scene: incidence)

    def near(samples: object, angles: object, scene: SceneParameters, noise: float, error: float) -> object:
        assert (samples, scene.ghost_shift, noise, error) == ("samples", 12.0, 0.005, 0.3)
        return 14.0, 0.2

    monkeypatch.setattr(ladder, "sampled_shift", near)
    monkeypatch.setattr(ladder, "PaneOfTiles", lambda *_: tiles)
    errors = SceneErrors(incidence_deg=0.3, ghost_shift=0.2)
    of_cells = ladder.LadderResult(PLAIN, replace(ESTIMATE, scene=PLAIN, errors=errors, rivals=()), ())
    capture = SimpleNamespace(scale=2, cells=SimpleNamespace(samples="samples"), angles_deg=())
    found = ladder.in_full(of_cells, capture, asked, 0.005, wanted, mosaic=SimpleNamespace(period=4))
    told = weighted_incidence((55.0, np.hypot(0.3, 0.6)), BY_TILES) if counts else (55.0, 0.3)
    assert (found.scene.incidence_deg, found.errors.incidence_deg) == pytest.approx(told)
    assert found.scene.ghost_shift == shift


@pytest.mark.parametrize("incidence_deg", [None, 55.0])
def test_tiles_of_a_mosaic_tell_tint_which_then_is_no_polarized_light(
    incidence_deg: float | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    def tint(scene: SceneParameters, *, incidence_open: bool) -> tuple[float, float]:
        assert (scene.ghost_shift, incidence_open) == (14.0, incidence_deg is None)
        return 0.4, 0.05

    tiles = SimpleNamespace(ghosts=lambda *_: (12.0, 0.3), incidence=lambda scene: None, tint=tint)
    monkeypatch.setattr(ladder, "sampled_shift", lambda *_: (14.0, 0.2))
    monkeypatch.setattr(ladder, "PaneOfTiles", lambda *_: tiles)
    light = Rival(PLAIN.replace(transmission_polarization=(0.5, 10.0)), 0.2)
    estimate = replace(ESTIMATE, scene=PLAIN, errors=SceneErrors(incidence_deg=0.3), rivals=(OTHER, light))
    capture = SimpleNamespace(scale=2, cells=SimpleNamespace(samples="samples"), angles_deg=())
    asked = OPEN.replace(absorption=None, incidence_deg=incidence_deg)
    of_cells = ladder.LadderResult(PLAIN, estimate, ())
    found = ladder.in_full(of_cells, capture, asked, 0.005, mosaic=SimpleNamespace(period=4))
    assert (found.scene.absorption, found.errors.absorption) == (0.4, 0.05)
    assert [rival.chance for rival in found.estimate.rivals] == [OTHER.chance]


def test_a_scene_that_was_given_is_that_of_the_mosaic_too() -> None:
    given = ladder.LadderResult(PLAIN, None, ())
    assert ladder.in_full(given, SimpleNamespace(scale=2), OPEN, 0.005) == given.scaled(2)


def plain_estimate(asked: SceneParameters, model: str, monkeypatch: pytest.MonkeyPatch, **more: object) -> object:
    """What the plain pane's estimate is asked; None where nothing is estimated."""

    def seen(capture: object, scene: SceneParameters, **how: object) -> None:
        raise Seen(scene)

    monkeypatch.setattr(ladder, "estimate_scene", seen)
    monkeypatch.setattr(ladder, "stokes_images", lambda *given: None)
    start_unknown = more.pop("start_unknown", False)
    capture = SimpleNamespace(cells=None, start_unknown=start_unknown)
    try:
        ladder._completed(capture, asked, 0.005, model, **{"thickness_px": None, "thickness_kind": "paper", **more})
    except Seen as asked_for:
        return asked_for.args[0]
    return None


def test_what_the_plain_pane_is_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    assert plain_estimate(PLAIN, "auto", monkeypatch) is None
    assert plain_estimate(PLAIN, "auto", monkeypatch, thickness_px=3.0) == PLAIN
    # Panes that mirror nothing are one.
    nothing = PLAIN.replace(refractive_index=1.0, n_panes=None, gap_shift=None)
    assert plain_estimate(nothing, "auto", monkeypatch) is None
    assert plain_estimate(OPEN, "auto", monkeypatch).ghost_shift is None
    assert plain_estimate(OPEN, "ghosts", monkeypatch).ghost_shift is None
    for wanted, unknown in (("pixelwise", False), ("curved", False), ("auto", True), ("ghosts", True)):
        assert plain_estimate(OPEN, wanted, monkeypatch, start_unknown=unknown).ghost_shift == 0.0
    told = OPEN.replace(ghost_shift=3.0)
    assert plain_estimate(told, "pixelwise", monkeypatch).ghost_shift == 3.0
    # A focal length asks for the rung of a lens, whose ghosts are looked for later.
    asked = plain_estimate(OPEN.replace(focal_px=90.0), "auto", monkeypatch)
    assert (asked.focal_px, asked.ghost_shift) == (None, 0.0)
    assert plain_estimate(OPEN.replace(focal_px=90.0), "ghosts", monkeypatch).ghost_shift is None
    # Several panes are one at first where their images are looked for.
    panes = OPEN.replace(n_panes=2, gap_shift=None)
    one = plain_estimate(panes, "auto", monkeypatch)
    assert (one.n_panes, one.gap_shift, one.ghost_shift) == (1, 0.0, None)
    both = plain_estimate(panes, "curved", monkeypatch)
    assert (both.n_panes, both.gap_shift, both.ghost_shift) == (2, 0.0, 0.0)
    given = plain_estimate(panes.replace(gap_shift=5.0, ghost_shift=2.0), "curved", monkeypatch)
    assert (given.n_panes, given.gap_shift, given.ghost_shift) == (2, 5.0, 2.0)


@pytest.mark.parametrize(
    ("asked", "more", "message"),
    [
        (OPEN.replace(n_panes=2), {"thickness_px": 3.0}, "thickness is for a single pane"),
        (OPEN.replace(bend_deg_per_px=(0.1, 0.0, 0.0)), {}, "bent pane must be given whole"),
    ],
)
def test_what_contradicts_itself_is_refused(
    asked: SceneParameters, more: dict[str, float], message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(InputError, match=message):
        plain_estimate(asked, "auto", monkeypatch, **more)


@pytest.mark.parametrize(("focal_px", "seen_from"), [(None, rungs.LONGEST * 40), (60.0, 60.0)])
@pytest.mark.parametrize(("leans_deg", "azimuth_deg"), [(20.0, 20.0), (200.0, 200.0)])
def test_where_light_does_not_tell_the_tilt_the_plain_pane_is_seen_by_the_lens(
    focal_px: float | None, seen_from: float, leans_deg: float, azimuth_deg: float
) -> None:
    blocks = SimpleNamespace(n=800, misfit=lambda incidence, azimuth, focal: 1 + abs(azimuth - leans_deg) + focal)
    capture = SimpleNamespace(shape=(3, 30, 40), focal_px=focal_px)
    found = rungs._from_afar(replace(evidence(wanted="perspective"), blocks=blocks, capture=capture))
    assert (found.scene.focal_px, found.scene.azimuth_deg, found.scene.incidence_deg) == (seen_from, azimuth_deg, 55.0)
    assert (found.misfit, found.known, found.errors) == (1 + seen_from, True, Estimated().errors)
