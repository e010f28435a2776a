"""The refractive index of a pane whose glass is unknown, or coated so that it mirrors as another glass would.

Light that arrives unpolarized tells two numbers of a flat pane in place, what it mirrors along and across the plane of
incidence; incidence and index are these two. Along a valley of both the polarization stays about the same. There
gradients in small windows tell one pane from another where noise leaves the mirrored scene to be seen. Else the layers'
edges and the spectra of ghosts do, clearly beyond Brewster's angle, weakly below it. So window glass is kept unless
another index explains the capture clearly better.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture, PlateFrame, plate_frame, registered_noise, stokes_images
from polaropt.errors import InputError
from polaropt.estimation.flat.estimate import LEAST_NOISE, estimate_scene
from polaropt.estimation.flat.ghost_overlap import LayerOverlap
from polaropt.estimation.flat.ghosts import cross_spectra
from polaropt.estimation.flat.gradients import PaneGradients
from polaropt.estimation.flat.lone_edges import mirrored_incidences
from polaropt.estimation.flat.overlap import noise_of_mirrored
from polaropt.estimation.flat.window import judged_pane, judged_window
from polaropt.estimation.flat.windows.axis import HARDLY_PX
from polaropt.estimation.flat.windows.search import LikelyWindow, alike_incidences, equivalent_single
from polaropt.estimation.flat.windows.tiles import tile_likelihood
from polaropt.estimation.index_by_tiles import (
    INDEX_SEARCH,
    LikelierIndex,
    tiles_tell,
    told_by_tiles,
)
from polaropt.numerics import local_minima, local_minimum, minimum_error, vertex
from polaropt.optics import GLASS_INDEX, INCIDENCE_SEARCH_DEG, SceneParameters

# All below by trial.
_TRIALS = (1.33, GLASS_INDEX, 1.7, 1.9)
"""Indices at which the pane is looked for blindly: with one far off, another pane is found."""
_STEPS = (0.08, 0.04)
"""Beside the likeliest index: where it is looked for more closely."""
_FARTHEST = 1.25
"""Steps up to which a parabola is followed."""
_USUAL_WIDTH, _USUAL = 0.2, 1e-3
"""How far indices usually lie from that of window glass, and the score that one so far off costs."""
_LEAST_GAIN, _SURE = 0.003, 1.5
"""Score that an index must gain over window glass, and how many standard errors of it."""
_RIVALS = 2.0
"""Standard errors that reach to the farthest index that cannot be told from the one found."""


_COLOURED = 3.0
"""Standard errors by which incidences of two colours must differ to tell of a coating. Measured on 16 scenes of
photographs: up to 1.2 of clear glass, from 5.8 on of a coated pane at 60 degrees."""


@dataclass(frozen=True)
class IndexFit:
    """A scene whose index is known.

    Attributes
    ----------
    scene : SceneParameters
    error : float or None
        Standard error of the index; None where it was given.
    coated : bool
        Whether the colours tell of different panes, as coated glass mirrors each in its own way. It is looked for where
        the index is.
    """

    scene: SceneParameters
    error: float | None = None
    coated: bool = False


@dataclass(frozen=True)
class _Trial:
    """The pane found with an index, and how well it explains the capture."""

    scene: SceneParameters
    likely: LikelyWindow

    @property
    def index(self) -> float:
        return self.scene.index

    @property
    def score(self) -> float:
        """Less is better; an unusual index costs a little."""
        return self.likely.score + _USUAL * _off_glass(self.index)

    def clearly_better(self, other: _Trial) -> bool:
        """Whether it explains the capture better in all of the frame, whatever indices are usual."""
        return self.likely.clearly_better(other.likely, _LEAST_GAIN, _SURE)


def with_index(
    capture: Capture,
    asked: SceneParameters,
    noise: float,
    *,
    thickness_px: float | None = None,
    thickness_kind: Literal["paper", "plate"] = "paper",
) -> IndexFit:
    """A scene with the index that is found where it is None: that of a single flat pane that is seen from far.

    Parameters
    ----------
    capture : Capture
    asked : SceneParameters
        Fields that are None are to be found; only the index is found here, the others stay as they are. An index
        that is not window glass's is that of one clear pane, and no other windows are looked for.
    noise : float
        Standard deviation of one photograph's noise; of a mosaic, of a sample's.
    thickness_px, thickness_kind
        As for `estimate_scene`.

    Raises
    ------
    InputError
        A window of several panes, a bent pane, tinted glass or a single surface: there an index must be given.
    """
    if asked.refractive_index is not None:
        return IndexFit(asked)
    if not asked.single_and_clear or asked.bent or asked.single_surface:
        raise InputError("the index is found of one clear, flat pane; give it for tinted, bent or several, and water")
    if capture.cells is not None:
        thickness = None if thickness_px is None else thickness_px / capture.scale
        small = asked.scaled(1 / capture.scale)
        of_cells = registered_noise(capture, noise)
        fit = with_index(capture.registered, small, of_cells, thickness_px=thickness, thickness_kind=thickness_kind)
        return dataclasses.replace(fit, scene=fit.scene.scaled(capture.scale))
    search = _IndexSearch(capture, asked, noise, thickness_px, thickness_kind)
    trials = [search.blind(index) for index in _TRIALS]
    if None in trials:
        # Nothing is polarized: no index says anything.
        return IndexFit(asked.replace(refractive_index=GLASS_INDEX))
    return search.chosen([trial for trial in trials if trial is not None])


def clear_pane(scene: SceneParameters, refractive_index: float) -> SceneParameters:
    """A scene as that of one clear pane of an index: tint and further panes may be a wrong index's."""
    return scene.replace(
        refractive_index=refractive_index, n_panes=1, gap_shift=0.0, gap_azimuth_deg=None, absorption=0.0
    )


class _IndexSearch:
    """Trials of one capture."""

    def __init__(
        self,
        capture: Capture,
        asked: SceneParameters,
        noise: float,
        thickness_px: float | None,
        thickness_kind: Literal["paper", "plate"],
    ) -> None:
        self._capture, self._noise = capture, noise
        self._asked = asked.replace(focal_px=None, n_panes=1, gap_shift=0.0, absorption=0.0)
        if asked.ghost_shift is None and capture.start_unknown:
            self._asked = self._asked.replace(ghost_shift=0.0)
        self._whole = asked
        self._thickness_px, self._thickness_kind = thickness_px, thickness_kind
        self._stokes = stokes_images(capture, max(noise, LEAST_NOISE))

    def blind(self, index: float) -> _Trial | None:
        """The pane found with an index; None where the capture shows no polarization."""
        return self._found(self._asked.replace(refractive_index=index))

    def near(self, trial: _Trial, index: float) -> _Trial:
        """The pane found with an index near that of a trial, at its azimuth and with its ghosts."""
        found = self._found(
            trial.scene.replace(refractive_index=index, incidence_deg=self._asked.incidence_deg), tied=False
        )
        return trial if found is None else found

    def _found(self, asked: SceneParameters, *, tied: bool = True) -> _Trial | None:
        thickness = self._thickness_px if tied else None
        estimate = estimate_scene(
            self._capture, asked, noise=self._noise, thickness_px=thickness, thickness_kind=self._thickness_kind
        )
        if not estimate.polarized:
            return None
        scene = estimate.scene
        frame = plate_frame(self._stokes, scene.values()[1])
        return _Trial(scene, judged_pane(frame, scene, incidence_open=self._asked.incidence_deg is None))

    def chosen(self, trials: list[_Trial]) -> IndexFit:
        """Window glass, or the likeliest index of all where that is clearly worse."""
        best, error = min(trials, key=lambda trial: trial.score), math.inf
        for step in _STEPS:
            beside = [self.near(best, index) for index in _beside(best.index, step)]
            before, here, after = (trial.score for trial in beside)
            move = vertex(before, here, after, _FARTHEST)
            error = _error([trial.likely for trial in beside], step)
            trials = [*trials, *beside, self.near(best, float(np.clip(beside[1].index + step * move, *INDEX_SEARCH)))]
            best = min(trials, key=lambda trial: trial.score)
        # Ghosts that were found better, too, are no sign of another index.
        trials.append(self.near(best, GLASS_INDEX))
        glass = min((trial for trial in trials if trial.index == GLASS_INDEX), key=lambda trial: trial.score)
        taken = best if best.clearly_better(glass) else glass
        rivals = [trial.index for trial in trials if not best.clearly_better(trial)]
        reach = max((abs(index - taken.index) for index in rivals), default=0.0)
        error = max(error, reach / _RIVALS)
        by_gradients = None
        if not self._stokes.aliased:
            by_gradients = _index_by_gradients(plate_frame(self._stokes, taken.scene.values()[1]), taken.scene)
        index = taken.index
        if by_gradients is not None and by_gradients[0].sure and by_gradients[0].error < error:
            index, error = by_gradients[0].index, by_gradients[0].error
        found = self._whole.replace(refractive_index=index)
        if index != GLASS_INDEX:
            found = clear_pane(found, index)
        return IndexFit(found, error, self._coloured(glass.scene))

    def _coloured(self, scene: SceneParameters) -> bool:
        """Whether the incidences at which the edges of each colour overlap least differ beyond their errors."""
        if not self._capture.color or self._asked.incidence_deg is not None:
            return False
        images, valid = self._capture.intensities, self._capture.valid
        values, errors = [], []
        for k in range(images.shape[1]):
            capture = self._capture.replace(intensities=images[:, k], valid=valid[:, k])
            estimate = estimate_scene(capture, scene.replace(incidence_deg=None))
            if not estimate.polarized or estimate.errors.incidence_deg is None:
                return False
            values.append(estimate.scene.values()[0])
            errors.append(estimate.errors.incidence_deg)
        least, most = int(np.argmin(values)), int(np.argmax(values))
        return bool(values[most] - values[least] > _COLOURED * math.hypot(errors[least], errors[most]))


# What follows by trial, on the random windows to fit on (`studies.random_windows`, even seeds).
_WALK, _MOST_STEPS = 0.1, 5
"""Step of the indices at which a single pane is looked at beside the one told, and how many of them on one side."""
_ROUNDS, _AT_REST_DEG = 3, 0.5
"""In which a pane of another index is found near the last one, and the change that ends them."""
_LEAST_EVIDENCE, _EVIDENT = 0.004, 2.5
"""Score that another index must gain before anything is said of it, and how many standard errors of it."""
_AGAINST = 2.0
"""Standard errors by which the spectra alone may speak against it."""
_AS_GOOD = 1.0
"""Standard errors by which a window of several panes, or tinted, may be better than a single pane in its place."""
_SCAN_DEG = 5.0
"""Spacing of the incidences at which a single pane is looked for in the place of several."""


def likelier_index(capture: Capture, scene: SceneParameters, noise: float) -> LikelierIndex | None:
    """What the photographs tell of an index beside the one that was told; None where they do not speak against it.

    Single clear panes are compared near the scene, each at the incidence that suits it. A wrong index may pass for tint
    or a second pane: one clear pane of another index must explain the capture about as well. Window glass's index is
    mostly assumed; against another, which somebody measured or looked up, only what is sure speaks, unless what was
    found is no single clear pane and may be wrong itself.

    Parameters
    ----------
    capture : Capture
        No mosaic: its cells.
    scene : SceneParameters
        Complete, with the index that was told and all else as it was found.
    noise : float
        Standard deviation of one photograph's noise.
    """
    if scene.varies or scene.polarized or scene.single_surface or not scene.signal:
        return None
    stokes = stokes_images(capture, max(noise, LEAST_NOISE))
    frame = plate_frame(stokes, scene.values()[1])
    if scene.single_and_clear and not stokes.aliased and mirrored_incidences(frame, scene):
        # One layer's edges tell no index.
        return None
    measured = scene.single_and_clear and scene.index != GLASS_INDEX
    # What aliases in a mosaic's cells looks like gradients of both layers.
    if scene.single_and_clear and not stokes.aliased:
        told = _told_by_gradients(frame, scene, _SURE_GAIN_BY_GRADIENTS if measured else _LEAST_GAIN_BY_GRADIENTS)
        # Where double images lie apart tiles are the surer.
        if told is not None or tiles_tell(frame, scene):
            return told or told_by_tiles(tile_likelihood(frame), scene, frame.azimuth_deg)
    single = None if stokes.aliased else _single_pane_of(scene)
    if single is not None:
        told = told_by_tiles(tile_likelihood(frame), single, frame.azimuth_deg, beside=scene)
        if told is not None:
            return told
    told = _told_by_spectra(frame, scene)
    return None if told is not None and measured and not told.sure else told


def _told_by_spectra(frame: PlateFrame, scene: SceneParameters) -> LikelierIndex | None:
    """What the spectra of double images and the layers' edges tell of an index beside the one that was told."""
    spectra = cross_spectra(frame)
    single = clear_pane(scene, scene.index)
    panes: dict[int, LikelyWindow] = {}

    def nearest(step: int, incidences_deg: Sequence[float]) -> LikelyWindow:
        """The best single pane so many steps of index away, near some incidences."""
        return min((pane(step, incidence) for incidence in incidences_deg), key=lambda found: found.score)

    def pane(step: int, incidence_deg: float) -> LikelyWindow:
        trial = single.replace(refractive_index=scene.index + step * _WALK, incidence_deg=incidence_deg)
        best = judged_pane(frame, trial, spectra=spectra)
        for _ in range(1, _ROUNDS):
            moved = abs(best.window.incidence_deg - trial.values()[0])
            if moved < _AT_REST_DEG:
                break
            trial = trial.replace(incidence_deg=best.window.incidence_deg)
            likely = judged_pane(frame, trial, spectra=spectra)
            # In noise the edges' overlap may fall on and on, past what spectra allow.
            if likely.score > best.score:
                break
            best = likely
        return best

    starts = [scene.values()[0]]
    if scene.stacked:
        overlap = LayerOverlap(frame, single.replace(ghost_shift=0.0), starts[0])
        angles = np.arange(INCIDENCE_SEARCH_DEG[0], INCIDENCE_SEARCH_DEG[1], _SCAN_DEG)
        starts = angles[local_minima(np.array([overlap.at(float(angle)) for angle in angles]))].tolist() or starts
    panes[0] = nearest(0, starts)
    low, high = ((limit - scene.index) / _WALK for limit in INDEX_SEARCH)
    for side in (-1, 1):
        for step in range(side, side * (_MOST_STEPS + 1), side):
            if not low <= step <= high:
                break
            last = panes[step - side]
            starts = alike_incidences(last.window.incidence_deg, scene.index + (step - side) * _WALK, side * _WALK)
            panes[step] = nearest(step, starts)
            if panes[step].score > last.score:
                break
    best = min(panes, key=lambda step: panes[step].score)
    window = panes[0] if scene.single_and_clear else judged_window(frame, scene, spectra)
    # Edges alone may mislead: ghosts that lie close together double them.
    if best == 0 or not _evident(panes[best], panes[0]) or panes[0].clearly_likelier(panes[best], _AGAINST):
        return None
    if window.clearly_better(panes[best], 0.0, _AS_GOOD):
        return None
    index = scene.index + best * _WALK
    reach = max(abs(step - best) for step, found in panes.items() if not _evident(panes[best], found))
    error = max(_WALK / 2, reach * _WALK / _RIVALS)
    inside = {best - 1, best + 1} <= panes.keys()
    if inside:
        beside = [panes[step] for step in (best - 1, best, best + 1)]
        before, here, after = (found.score for found in beside)
        index += _WALK * vertex(before, here, after, _FARTHEST)
        error = max(error, _error(beside, _WALK))
    usual = window.score + _USUAL * (_off_glass(scene.index) - _off_glass(index))
    evident = _evident(panes[best], dataclasses.replace(window, score=usual))
    sure = inside and panes[best].misfit <= panes[0].misfit and evident
    return LikelierIndex(index, error, sure)


def _off_glass(index: float) -> float:
    """Square of how far an index lies from that of window glass, in units of how far they usually do."""
    return ((index - GLASS_INDEX) / _USUAL_WIDTH) ** 2


_SHOWN_NOISE, _TELLING_DEG = 0.15, (25.0, 70.0)
"""Noise of a pixel of what is mirrored (white = 1) up to which gradients tell an index, and incidences between which
they are asked: beyond, edges and spectra tell it clearly. Set by hand."""
_INDEX_STEP, _INDEX_TOLERANCE = 0.1, 0.01
"""Spacing of the indices that are looked at, and accuracy of the likeliest. Set by hand."""
_LEAST_GAIN_BY_GRADIENTS, _TOLD_WITHIN = 3.5, 0.2
"""Log likelihood of gradients that another index must gain, and standard error up to which it is sure. Of photographs
that no figure is taken of 96 pairs, at 45 to 85 degrees, lack up to 3.0 with the true index. Of random windows of
single clear panes to fit on (`studies.random_windows`, even seeds to 954) 50 whose index was told rightly lack up to
2.8, and of 15 of which it was told wrongly by 0.05 and more seven gain 5.8 to 72."""
_SURE_GAIN_BY_GRADIENTS = 7.0
"""Log likelihood that it must gain to be taken in the place of window glass, or told beside an index that is another's:
what gains less is doubted. Of 190 panes of an engine of its own (training photographs, 25 to 70 degrees, seeds 3000 to
3249) three gain 3.7 to 6.5 with a wrong one; two of 400 others that were taken for one lost 3 and 20 dB."""


_PROMISING = 0.5
"""Share of the gain asked for that the likeliest of a few indices, with a parabola through its neighbours, must promise
to be looked at closely. Set by hand."""


def _told_by_gradients(frame: PlateFrame, scene: SceneParameters, least_gain: float) -> LikelierIndex | None:
    """What gradients in small windows tell of an index beside the one that was told, of a single clear pane."""
    found = _index_by_gradients(frame, scene, least_gain)
    if found is None or not found[0].sure:
        return None
    likelier, gain = found
    return dataclasses.replace(likelier, sure=gain >= _SURE_GAIN_BY_GRADIENTS)


def _index_by_gradients(
    frame: PlateFrame, scene: SceneParameters, least_gain: float = -math.inf
) -> tuple[LikelierIndex, float] | None:
    """The likeliest index of a single clear pane given gradients in small windows, and the log likelihood it gains.

    None where they tell nothing, or an index that gains less than so much over the scene's.
    """
    least, most = _TELLING_DEG
    if not least <= scene.values()[0] <= most or noise_of_mirrored(frame, scene) > _SHOWN_NOISE:
        return None
    low, high = INDEX_SEARCH
    search = _IndexGradients(frame, scene)
    start, promise = search.glanced()
    if promise < _PROMISING * least_gain:
        return None
    best = search.nearest(start)
    gain = search.cost(scene.index) - search.cost(best)
    if gain < least_gain:
        return None
    # Ghosts are brought into place as they are before the likelier pane.
    for _ in range(_ROUNDS if scene.has_ghosts else 0):
        search = _IndexGradients(frame, scene.replace(refractive_index=best, incidence_deg=search.incidence(best)))
        before, best = best, search.nearest(best)
        if abs(best - before) < _INDEX_TOLERANCE:
            break
    lower, here, upper = (search.cost(best + move) for move in (-_INDEX_STEP, 0.0, _INDEX_STEP))
    curvature = (lower + upper - 2 * here) / _INDEX_STEP**2
    error = math.hypot(_INDEX_TOLERANCE, 1 / math.sqrt(curvature)) if curvature > 0 else math.inf
    inside = low + _INDEX_STEP / 2 < best < high - _INDEX_STEP / 2
    return LikelierIndex(best, error, sure=inside and error < _TOLD_WITHIN), gain


class _IndexGradients:
    """How likely indices are, each at its likeliest incidence, given the gradients of what is seen in small windows."""

    def __init__(self, frame: PlateFrame, scene: SceneParameters) -> None:
        self._gradients, self._scene = PaneGradients(frame, scene), scene
        self._incidences: dict[float, float] = {}

    def incidence(self, index: float) -> float:
        """The likeliest incidence of an index, in degrees; no index is looked at twice."""
        if index not in self._incidences:
            here, told = self._scene.values()[0], self._scene.index
            near = (
                self._gradients.nearest(angle, index) for angle in (here, *alike_incidences(here, told, index - told))
            )
            self._incidences[index] = min(near, key=lambda angle: self._gradients.cost(angle, index))
        return self._incidences[index]

    def cost(self, index: float) -> float:
        """Minus log likelihood of an index."""
        return self._gradients.cost(self.incidence(index), index)

    def glanced(self) -> tuple[float, float]:
        """The likeliest of a few indices, and about what one near it gains over the one of the scene."""
        low, high = INDEX_SEARCH
        indices = np.arange(low, high + _INDEX_STEP / 2, _INDEX_STEP)
        costs = np.array([self.cost(index) for index in indices.tolist()])
        best = min(max(int(np.argmin(costs)), 1), len(costs) - 2)
        before, here, after = costs[best - 1 : best + 2].tolist()
        least = min(costs.min(), here - (before - after) / 4 * vertex(before, here, after))
        return float(indices[np.argmin(costs)]), self.cost(self._scene.index) - float(least)

    def nearest(self, index: float) -> float:
        """The likeliest index near one."""
        return local_minimum(self.cost, index, INDEX_SEARCH, _INDEX_STEP / 2, _INDEX_TOLERANCE)


def _single_pane_of(scene: SceneParameters) -> SceneParameters | None:
    """The single pane whose images two clear ones have, where they are hardly thick; None for all else."""
    incidence, _, shift = scene.values()
    if scene.n_panes != 2 or scene.absorption or scene.single_surface or abs(shift) >= HARDLY_PX:
        return None
    steeper = equivalent_single(incidence, scene.n_panes, scene.index)
    return clear_pane(scene, scene.index).replace(incidence_deg=steeper, ghost_shift=shift + (scene.gap_shift or 0.0))


def _evident(one: LikelyWindow, other: LikelyWindow) -> bool:
    return one.clearly_better(other, _LEAST_EVIDENCE, _EVIDENT)


def _beside(index: float, step: float) -> list[float]:
    """Three indices a step apart around one, inside the range."""
    low, high = INDEX_SEARCH
    middle = min(max(index, low + step), high - step)
    return [middle - step, middle, middle + step]


def _mean(values: NDArray[np.float64]) -> float:
    return float(values.mean()) if values.size else 0.0


def _error(panes: Sequence[LikelyWindow], step: float) -> float:
    """Standard error of the index of least score, from three panes a step apart, by leaving parts of the frame out.

    A frame of a single part tells none.
    """
    errors = [0.0]
    for part in range(len(panes[0].parts)):
        # Of likelihood and overlap one is that of the rest, the other that of all.
        rest = [pane.parts[part] + (pane.score - _mean(pane.parts[part])) for pane in panes]
        errors.append(minimum_error(rest, step) if rest[0].size > 1 else 0.0)
    return math.hypot(*errors)
