"""Windows of several panes, or of tinted glass: which of those that the search finds explains the capture."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from polaropt.capture import PlateFrame, StokesImages, plate_frame
from polaropt.estimation.flat.estimate import SceneEstimate
from polaropt.estimation.flat.ghosts import CrossSpectra
from polaropt.estimation.flat.windows.axis import (
    CLOSE_PX,
    HARDLY_PX,
    NEEDED,
    SURE_OF_TILES,
    SURER,
    Evidence,
    Scan,
    WindowAxis,
    is_close,
    looks_single,
    looks_turned,
    tells_of_tint,
    window_of,
)
from polaropt.estimation.flat.windows.likelihood import Window
from polaropt.estimation.flat.windows.search import LikelyWindow, equivalent_incidences
from polaropt.estimation.flat.windows.tiles import USUAL_TILES
from polaropt.optics import Rival, SceneParameters

# All below by trial.
TRIAL_DEG, _STEEPEST_DEG = (40.0, 52.0, 62.0, 72.0, 80.0), 86.0
"""Incidences of single panes that windows are likened to where the axis is in doubt, and another of several panes: two
of heavy glass at 82 degrees are like one there. Single ones so steep are not looked for: in noise they pass for any."""
_LEAST_GAIN = 0.003
"""Score that a single pane of another kind must gain."""
_SURE = 2.0
"""The same in standard errors of what is gained."""
_NEEDED_IN_DOUBT = 7.0
"""Standard errors, all together, by which several panes must be likelier where the noise leaves no edges of what they
mirror to be seen, where they lie across the pane that was found, or where two that are thinner than any glass look like
the two faces of one at a steeper angle. Of 110 random windows of one pane at 10 to 33 degrees
(`studies.random_windows`, training photographs, even seeds from 17400) noise tells several by 6.5 at most; of 560 of an
engine of its own 3 pass for thin ones, by 6.6 at most, and lose 2 to 11 dB."""
_CHANCE_OF_ONE = 0.5
"""That what noise tells of a frame with more tiles than usual is a single pane after all, or what edges contradict."""
_MAY_BE_SEVERAL, _CHANCE_OF_SEVERAL = 2.5, 0.5
"""Evidence from which on a single pane may be several where tiles are surer of them, and the chance of that. Of 48
random windows of one pane (`studies.random_windows`, training photographs, numbers from 704000, plain or with double
images) none has more than 0.5, of 13 of several that are taken for one, at a loss of 3 to 24 dB, 9 have 3.6 to 5.5, and
tiles surer of them by 1.9 to 4.8."""
_EDGES_AGAINST = -3.75
"""Standard errors of the overlap of edges from which on they contradict several panes: patterns that a single pane
mirrors (bricks, rows of windows) look like images further off, and taken out as such leave edges in both layers. Of 88
windows of several panes that were found right (44 random ones of `studies.random_windows`, training photographs,
numbers from 704024, and 44 of an engine of its own) one has less, of 5 single panes before patterns that pass for
several 2, of 8 before meshes 5."""
_LEAST_DEG = 12.0
"""Incidence beyond which they are told in noise: nearer to the normal, where a warning says that hardly anything is,
chance windows of that many numbers suit noise best. Set by hand."""
_SURE_OF_CLOSE = 1.5
"""Those of mean spectra and edges added where all images lie close together, and the single pane's do, too. With pairs
of photographs that no figure is taken of and those inside scikit-image, two panes at 30 to 70 degrees and single ones
at 20 to 80 (shifts of 1 to 3 px, noise 0.3 to 2 %): all of 18 of two panes have 2.2 and more, of 18 single ones 17 have
0.3 at most. Nor may tiles speak against them: of 40 of an engine of its own that are found they speak for all."""
_SPEAKS_AGAINST, _MUCH_WORSE = -3.0, 0.03
"""Standard errors of mean spectra, and score lost, from which on tiles are not believed against them: the larger the
frame, the surer tiles are of chance images. Of 126 random windows of one pane at 10 to 35 degrees and 320x320
(`studies.random_windows`, training photographs, even seeds from 72000) 3 are taken for several by it instead of 10, of
256x256 one instead of 3; of 156 of several panes one less is told of 89 that are told well."""
_LEAST_OF_TILES = 2.0
"""Standard errors by which tiles must be likelier under tinted glass, as mean spectra take ghosts that interpolation
dims for those of tint; all together tint must be told as several panes must. Of some 400 random windows of clear glass
(`studies.random_windows`, training photographs, even seeds from 9000, 20000 and 22000) one is taken for tinted, of 150
of tinted glass about 45 are told."""
_NEEDED_ACROSS, _GAIN_ACROSS = 3.0, 0.005
"""Standard errors, all together, and score by which a tinted pane across must be likelier, edges and all. Of 130 random
windows of one clear pane beyond 53 degrees (`studies.random_windows`, training photographs, even seeds from 8000) none
gains more than 0.002 of the score; of 52 of tinted glass 7 lay across, with 3.5 standard errors and 0.012 at least. On
other seeds, of 90 of clear glass and 50 of tinted none is turned wrongly and 2 of 6 rightly. From 930000 on 60 of clear
glass gain 0.001 at most and have no evidence, 7 of 40 of tinted lie across, with 3.2 standard errors and 0.008 at
least."""
MOST_FOUND = 3
"""Panes of a window that is found: two, and one more; what is told may have more."""
_DOUBTFUL_MARGIN, ACROSS_FROM_DEG = 0.2, 55.0
"""Margin of the azimuth's axis up to which the one across is looked at, too, as the single pane that it is of may be
wrong, and incidence of that pane from which on it always is: several panes polarize as a steeper one does across."""
_NEARLY_AS_LIKELY, _SINGLE_NEARLY_AS_LIKELY, _TINT_NEARLY_AS_LIKELY = 0.01, 0.03, 0.003
"""Log likelihood that a scan across may lack of the single pane's for several panes, and a single one, to be looked for
closely there; and the same of tinted panes. Of 190 random windows (`studies.random_windows`, training photographs, even
seeds from 1100000 and 1200000) ten of several panes that lie across lack 0.003 at most, and tinted panes that are taken
there 0.0002; of those of one pane 84 and 69 % lack more."""
_FAR_LESS_LIKELY, _HOPELESS, _LEAST_SEEN = 0.4, 2.0, 0.005
"""What a single pane across may lack of the log likelihood of the one found to be that itself; the same for windows
across to be scanned (two steep ones whose images lie 8 and 18 px apart lacked 0.41 and 1.7); and what a scan of two
must gain where one without double images was found: on the random windows to fit on those that are found gain 0.018."""


def _shows_across(across: WindowAxis, single: LikelyWindow, first: WindowAxis, plain: LikelyWindow) -> bool:
    """Whether a single pane that lies across explains the capture clearly better.

    Edges in noise may seem to say so where the spectra, or single tiles, clearly say otherwise.
    """
    if not single.clearly_better(plain, _LEAST_GAIN, _SURE) or plain.clearly_likelier(single, _SURE):
        return False
    return across.evidence(single, plain, first).tiles > -_SURE


def _several(axis: WindowAxis, scans: tuple[Scan, Scan], single: LikelyWindow) -> list[LikelyWindow]:
    """The best windows of two panes, and of three, that may be the true one: the likelier of them first.

    Windows have more numbers than a single pane: where none near any that is likely is likelier, there are none.
    """
    two, three = (axis.candidates(scan) for scan in scans)
    if not any(window.misfit < single.misfit for window in (*two, *three)):
        return []
    fewer = axis.surest(two)
    more = axis.surest(axis.search.with_another(fewer.window) + three)
    sure = 0.0 if is_close(more.window) else axis.surer(more.window, fewer.window)
    third = sure > SURER or (sure > -SURER and more.score < fewer.score - _LEAST_GAIN)
    ordered = (more, fewer) if third else (fewer, more)
    return [window for window in ordered if axis.shows(window.window) or _is_told_in_noise(window.window)]


def _is_told_in_noise(window: Window) -> bool:
    """Whether several panes may be told where the noise leaves no edges of what they mirror to be seen."""
    return not is_close(window) and window.incidence_deg > _LEAST_DEG


def _likelier(axis: WindowAxis, window: LikelyWindow, beside: WindowAxis, single: LikelyWindow) -> bool:
    """Whether a window of several panes is so much likelier than a single pane, of the same axis or of the one across.

    Where more numbers are free, edges overlap less by chance; where layers have edges in common they may overlap more.
    Images a pixel or two apart hardly change the spectra, but leave edges doubled. They suit few windows: no chance
    likeness was chosen from many. What lies closer passes for a pane of another index, or a tinted one.
    """
    evidence = axis.evidence(window, single, beside)
    if axis is beside and (evidence.spectra < _SPEAKS_AGAINST or window.score > single.score + _MUCH_WORSE):
        return False
    if looks_single(window.window):
        return evidence.together > _NEEDED_IN_DOUBT
    close = is_close(window.window) and HARDLY_PX <= abs(single.window.pane_shift) <= CLOSE_PX
    told = evidence.spectra + evidence.edges > _SURE_OF_CLOSE and evidence.tiles > 0 and window.score < single.score
    if close and axis is beside and told:
        return True
    if axis is not beside or not axis.shows(window.window):
        return evidence.together > _NEEDED_IN_DOUBT
    return evidence.together > NEEDED or (evidence.tiles > SURE_OF_TILES and not is_close(window.window))


def _with_panes(
    axes: Sequence[tuple[WindowAxis, Sequence[float]]], plain: LikelyWindow, found: LikelyWindow
) -> tuple[WindowAxis, LikelyWindow, LikelyWindow | None]:
    """A pane that was found, or the window that is clearly likelier; with its axis, and what else it may be.

    Parameters
    ----------
    axes : sequence of (axis, incidences)
        The one found and, where it is in doubt, the one across, and where single panes are looked for.
    plain : LikelyWindow
        The single clear pane.
    found : LikelyWindow
        It, or a tinted one.
    """
    first = taken = axes[0][0]
    likely, single_across = list[tuple[WindowAxis, list[LikelyWindow]]](), plain
    for axis, incidences in axes:
        told = () if axis is not first else (plain.window,)
        singles, across = axis.search.single(incidences), axis is not first
        begun = [singles]
        if across:
            steep = axis.search.single((_STEEPEST_DEG,))
            begun = [near for near in (singles, steep) if near[0].misfit <= plain.misfit + _HOPELESS]
        scans = [(axis.scan(2, near, *told), axis.scan(MOST_FOUND, near, *told)) for near in begun]
        if across:
            scans = _as_likely(scans, plain, _SINGLE_NEARLY_AS_LIKELY)
        if not scans:
            continue
        # A gap that the spectra show shows in a scan as well; where a pane's ghosts are seen, it may not.
        unseen = not (across or plain.window.pane_shift) and scans[0][0].gain < _LEAST_SEEN
        if unseen and not axis.glimpses([start for scan in scans[0] for start in scan.starts], plain.window):
            continue
        if across:
            # What looks like several panes there may be a single one.
            single_across = axis.best(axis.search.panes(incidences))
            may_be = singles[0].misfit <= plain.misfit + _FAR_LESS_LIKELY and single_across.score < found.score
            if may_be and _shows_across(axis, single_across, first, plain):
                taken, found = axis, single_across
            scans = _as_likely(scans, plain, _NEARLY_AS_LIKELY)
        if told_of := [windows for pair in scans if (windows := _several(axis, pair, plain))]:
            likely.append((axis, min(told_of, key=lambda windows: windows[0].score)))
    likely.sort(key=lambda one: one[1][0].score)
    rival: LikelyWindow | None = None
    for axis, window in ((axis, window) for axis, windows in likely for window in windows):
        if not _likelier(axis, window, first, plain) or (found.window.absorption and window.score > found.score):
            rival = rival or (window if axis is first and _may_be_several(axis, window, plain) else None)
            continue
        if looks_turned(window.window) and not axis.likelier_than_turned(window):
            continue
        # Two thin panes look much like the faces of one, whose ghost may have been missed.
        single = axis.with_ghost_of(window.window, plain.window) if axis is first else single_across
        if _likelier(axis, window, axis, single):
            return axis, window, None
        rival = rival or (window if axis is first and _may_be_several(axis, window, single) else None)
        better = single.score < found.score and single.clearly_better(plain, _LEAST_GAIN, _SURE)
        if axis is first and (better or axis.tells(single, plain)):
            return axis, single, rival
    return taken, found, rival if taken is first else None


def _as_likely(scans: list[tuple[Scan, Scan]], plain: LikelyWindow, most: float) -> list[tuple[Scan, Scan]]:
    """Scans of two panes and of three that found one that lacks so much log likelihood of the single pane's at most."""
    return [pair for pair in scans if min(scan.misfit for scan in pair) <= plain.misfit + most]


def _may_be_several(axis: WindowAxis, window: LikelyWindow, single: LikelyWindow) -> bool:
    """Whether several panes explain the capture better than a single one, if not so clearly that they are taken."""
    if is_close(window.window) or looks_turned(window.window) or not axis.shows(window.window):
        return False
    evidence = axis.evidence(window, single, axis)
    return evidence.tiles > SURER and evidence.together > _MAY_BE_SEVERAL


def _tinted_or(axis: WindowAxis, starts: Sequence[Window], plain: LikelyWindow) -> LikelyWindow:
    """A clear pane, or a tinted one whose ghost lies so far off, and is so much dimmer, that it tells of tint."""
    tinted = axis.tinted_near(starts, plain.window)
    if tinted is None:
        return plain
    clear = axis.judged(axis.nearest_by_tiles(replace(tinted.window, absorption=0.0), ("pane_shift",)).window)
    panes = [clear, plain, *([axis.judged(replace(plain.window, pane_shift=0.0))] if plain.window.pane_shift else [])]
    likeliest = min(panes, key=lambda pane: axis.tiles_under(pane.window).misfit)
    judged = axis.judged(tinted.window)
    evidence = Evidence(tinted.believed_over(axis.tiles_under(likeliest.window)), *judged.surer_than(likeliest))
    if evidence.tiles <= _LEAST_OF_TILES or evidence.together <= NEEDED:
        return plain
    # Its ghosts are there all the same.
    return clear if axis.is_clear_and_turned(tinted) else judged


def _tinted_across(across: WindowAxis, first: WindowAxis, found: LikelyWindow) -> tuple[WindowAxis, LikelyWindow]:
    """A pane that was found, or a tinted one across that is likelier.

    Dark glass mirrors more beside what it lets through, and polarizes as clear glass does across.
    """
    near = [pane for pane in across.search.tinted(TRIAL_DEG) if pane.misfit <= found.misfit + _TINT_NEARLY_AS_LIKELY]
    starts = [pane.window for pane in sorted(near, key=lambda pane: pane.misfit)]
    tinted = across.tinted_near(starts, replace(starts[0], absorption=0.0)) if starts else None
    if tinted is None:
        return first, found
    judged = across.judged(tinted.window)
    evidence = Evidence(tinted.believed_over(first.tiles_under(found.window)), *judged.surer_than(found))
    told = evidence.together > _NEEDED_ACROSS and judged.score < found.score - _GAIN_ACROSS
    return (across, judged) if told else (first, found)


def with_window(estimate: SceneEstimate, stokes: StokesImages, asked: SceneParameters) -> SceneEstimate:
    """An estimate of a single clear pane, or the window that explains the capture clearly better.

    Parameters
    ----------
    estimate : SceneEstimate
        Of a single flat pane.
    stokes : StokesImages
    asked : SceneParameters
        Fields that are None are to be found: tint of a single pane, and up to three clear ones. A number of panes and
        an absorption that are given are kept.
    """
    incidence, azimuth, shift = estimate.scene.values()
    open_panes = asked.n_panes is None
    doubtful = estimate.axis_margin < _DOUBTFUL_MARGIN or (open_panes and incidence > ACROSS_FROM_DEG)
    doubtful &= asked.azimuth_deg is None
    first = WindowAxis(plate_frame(stokes, azimuth), asked)
    across = first.across() if doubtful else None
    shown = first.shows(Window(incidence, shift))
    if open_panes and not shown and across is None:
        return estimate

    several: tuple[Rival, ...] = ()
    axes = [(first, (incidence,)), *((axis, TRIAL_DEG) for axis in (across,) if axis is not None)]
    if open_panes or asked.n_panes == 1:
        plains = {Window(incidence, px, absorption=asked.absorption or 0.0) for px in (shift, 0.0)}
        before = plain = min((first.judged(window) for window in plains), key=lambda judged: judged.score)
        of_tint = asked.absorption is None and (shown or not open_panes)
        tinted = [near.window for near in first.search.tinted((incidence,))] if of_tint else []
        if shown:
            # A dim ghost that is looked for may be one of clear glass.
            clear = [replace(window, absorption=0.0) for window in tinted]
            panes = [near.window for near in first.search.panes((incidence,))]
            plain = first.with_surer_ghosts([*panes, *clear], plain)
        found, taken = _tinted_or(first, tinted, plain) if of_tint else plain, first
        if of_tint and across is not None:
            taken, found = _tinted_across(across, first, found)
        if open_panes and taken is first:
            taken, found, rival = _with_panes(axes, plain, found)
            several = () if rival is None else (Rival(first.refined(rival.window)[0], _CHANCE_OF_SEVERAL),)
        elif open_panes:
            # Several panes there polarize as dark glass does.
            plain = taken.best(taken.search.panes(TRIAL_DEG))
            window = _with_panes([(taken, TRIAL_DEG)], plain, found)[1]
            found = window if window.window.n_panes > 1 else found
        if found is before:
            return replace(estimate, rivals=(*estimate.rivals, *several))
    else:
        n_panes = asked.n_panes or 1
        scans = [(axis, axis.scan(n_panes, axis.search.single(near))) for axis, near in axes]
        pairs = [(axis, axis.best(axis.candidates(scan))) for axis, scan in scans]
        taken, found = min(pairs, key=lambda pair: pair[1].score)
    scene, errors = taken.refined(found.window)
    tint_found = bool(found.window.absorption) and asked.absorption is None
    if tint_found and not tells_of_tint(window_of(scene, taken.frame.azimuth_deg)):
        # At the incidence that edges tell no ghost tells of tint.
        return estimate
    errors = replace(errors, azimuth_deg=estimate.errors.azimuth_deg)
    if open_panes and taken is first and _is_contradicted(found, before):
        return replace(estimate, rivals=(*estimate.rivals, Rival(scene, _CHANCE_OF_SEVERAL)))
    doubted = open_panes and _may_be_one(taken, found.window)
    rivals = (*several, *((Rival(estimate.scene, _CHANCE_OF_ONE),) if doubted else ()))
    return replace(estimate, scene=scene, errors=errors, axis_chance=0.0, axis_gain_db=math.inf, rivals=rivals)


def _may_be_one(axis: WindowAxis, window: Window) -> bool:
    """Whether several panes are told in noise, of a frame larger than those on which it was found what tells them."""
    return window.n_panes > 1 and not axis.shows(window) and axis.tiles.n_tiles > USUAL_TILES


def _is_contradicted(found: LikelyWindow, single: LikelyWindow) -> bool:
    """Whether the layers' edges surely overlap more behind several panes than behind a single one of the same axis."""
    _, edges = found.surer_than(single)
    return found.window.n_panes > 1 and edges < _EDGES_AGAINST


def judged_pane(
    frame: PlateFrame, scene: SceneParameters, *, incidence_open: bool = True, spectra: CrossSpectra | None = None
) -> LikelyWindow:
    """How well a single pane that was found explains a capture, with its double images or in place.

    Parameters
    ----------
    frame : PlateFrame
        At the azimuth of the scene.
    scene : SceneParameters
        Complete.
    incidence_open : bool
        Whether the incidence may move to where the layers' edges overlap least.
    spectra : CrossSpectra, optional
        Of the frame, where they are at hand.
    """
    incidence, _, shift = scene.values()
    axis = WindowAxis(frame, scene.replace(incidence_deg=None) if incidence_open else scene, spectra)
    return axis.best([LikelyWindow(Window(incidence, px), math.inf, math.inf) for px in dict.fromkeys((shift, 0.0))])


def judged_window(frame: PlateFrame, scene: SceneParameters, spectra: CrossSpectra | None = None) -> LikelyWindow:
    """The same of a window that was found, of as many panes as it has, near its incidence."""
    return WindowAxis(frame, scene.replace(incidence_deg=None), spectra).judged(window_of(scene, frame.azimuth_deg))


def window_remark(scene: SceneParameters) -> str:
    """What is to be said of a pane without double images: several would look like it."""
    incidence = equivalent_incidences(scene.values()[0], 2, scene.index)[-1]
    return f"Without double images two panes at {incidence:.0f} degrees would look much alike."
