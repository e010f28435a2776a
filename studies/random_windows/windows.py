"""Random scenes: a number tells all of one, and its family what is special about it.

Even numbers are for fitting, odd ones for judging what was fitted; of either kind each family has as many.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from polaropt.optics import SceneParameters
from studies.camera import Sample, photograph
from studies.photographs import Pair, pairs_of
from studies.scenes import REFRACTIVE_INDEX, Sensor, Taking, focal_px, random_bend

SEED = 2026
"""Of all scenes together."""
FIT, JUDGE = "fit", "judge"
HALVES = (FIT, JUDGE)
"""What the even and the odd numbers are for."""

# What scenes are drawn from; as everywhere, photographs have white = 1.
INCIDENCES_DEG, POLARIZED_INCIDENCES_DEG, BENT_INCIDENCES_DEG = (10.0, 85.0), (30.0, 80.0), (20.0, 75.0)
INDICES = (1.33, 1.9)
NOISES, STRONG_NOISES = (0.002, 0.01), (0.01, 0.03)
MOST_SHIFT_PX, LEAST_SHIFT_PX = 20.0, 0.5
"""Of double images: the largest, and that from which on they are seen as such."""
MOST_PANES, GAPS_PX, GAP_TURN_DEG = 3, (2.0, 20.0), 20.0
"""Panes, shifts from one to the next, and how far the direction of these is turned (standard deviation)."""
TINTS = (0.3, 0.95)
"""Share of the light that a tinted pane passes."""
DEGREES = (0.1, 1.0)
"""Of polarization."""
VIEWS_DEG, BENT_VIEWS_DEG, STEEPEST_DEG = (12.0, 85.0), (12.0, 50.0), 86.0
"""Fields of view, those before a bent pane, and the incidence at the middle of the frame's side that a lens sees."""
BENDS_DEG = (1.0, 8.0)
CLIPPED_SHARES = (0.01, 0.2)
BITS, LOW_BITS = (10, 12, 14, 16), (6, 7, 8)
REFLECTION_GAINS, ALL_REFLECTION_GAINS = (0.3, 3.0), (0.1, 10.0)
"""Brightness of the mirrored scene beside that behind the glass; the wider range is of mixed scenes."""
MOST_GAIN_ERROR, MOST_ANGLE_ERROR_DEG = 0.02, 2.0
MOVING_SIDES, MOVING_STEPS = (0.1, 0.35), (0.02, 0.1)
"""In sides of the frame, see `Taking`."""
LENS_BLURS_PX, MOSAIC_MARGIN_PX = (0.3, 1.0), 40
"""Of a polarization camera's lens, and what is kept beyond its frame for ghosts to come from."""
MIXED_CHANCE = 0.3
"""With which each special thing is in a mixed scene."""
_QUARTERS = 4
DARK_SHARES = (0.05, 0.5)
"""Noise in the dark beside that at white, of a sensor whose noise grows with the light."""
# Added to a scene's number for a generator of its own, so that no other number changes.
_OF_LENSES, _OF_LIGHT = 10**9, 2 * 10**9


@dataclass(frozen=True)
class Window:
    """A random scene.

    Attributes
    ----------
    number : int
    family : str
    scene : SceneParameters
        The true pane, complete.
    index_told : float
        Refractive index that the software is given; nothing else of the pane is.
    taking : Taking
    pair : int
        Which photographs are its layers, modulo how many pairs there are.
    quarters : (int, int)
        Quarter turns of the photograph behind the pane, and of the mirrored one.
    """

    number: int
    family: str
    scene: SceneParameters
    index_told: float
    taking: Taking
    pair: int
    quarters: tuple[int, int]

    @property
    def half(self) -> str:
        """What its number is for."""
        return HALVES[self.number % 2]

    @property
    def hint(self) -> SceneParameters:
        """What is given of the pane."""
        return SceneParameters(
            None, None, None, self.index_told, n_panes=None, gap_shift=None, absorption=None
        )  # fmt: skip

    @property
    def rung(self) -> str:
        """The scene model that it was made with; double images closer than half a pixel are none."""
        scene = self.scene
        shifts = {name: getattr(scene, name) or 0.0 for name in ("ghost_shift", "gap_shift")}
        near = {name: 0.0 for name, shift in shifts.items() if abs(shift) < LEAST_SHIFT_PX}
        return scene.replace(**near).rung

    def photographs(self, folder: str | None, size: int) -> Pair:
        """Its layers, in a frame with a side of `size` pixels."""
        pairs = pairs_of(folder, size, MOSAIC_MARGIN_PX if self.taking.sensor else size // 2)
        pair = pairs[self.pair % len(pairs)]
        turned = (
            np.ascontiguousarray(np.rot90(image, turns))
            for image, turns in zip((pair.transmission, pair.reflection), self.quarters, strict=True)
        )
        return Pair(self.number, *turned, pair.margin)

    def sample(self, folder: str | None, size: int) -> Sample:
        """The scene as it is photographed."""
        return photograph(self.photographs(folder, size), self.scene, self.taking, self.hint)


class Dice:
    """Draws numbers of one scene."""

    def __init__(self, number: int) -> None:
        self.random = np.random.default_rng([SEED, number])

    def within(self, limits: tuple[float, float]) -> float:
        """A number, evenly."""
        return float(self.random.uniform(*limits))

    def in_proportion(self, limits: tuple[float, float]) -> float:
        """A number whose logarithm is drawn evenly."""
        return math.exp(self.within((math.log(limits[0]), math.log(limits[1]))))

    def one_of(self, values: tuple[Any, ...]) -> Any:
        """A value, each as likely."""
        return values[int(self.random.integers(len(values)))]

    def signed(self, limits: tuple[float, float]) -> float:
        """A number of either sign whose size is drawn evenly."""
        return self.within(limits) * (1 if self.random.random() < 1 / 2 else -1)


@dataclass(frozen=True)
class _Draft:
    scene: SceneParameters
    taking: Taking
    index_told: float | None = None


Special = Callable[[_Draft, Dice, int], _Draft]


def window_of(number: int, size: int, sensor: Sensor = "", shot_noise: bool = False) -> Window:
    """The random scene with this number, for frames with a side of `size` pixels.

    A polarization camera takes all angles at once: nothing moves before it. With shot noise the noise that is drawn is
    that at white.
    """
    dice = Dice(number)
    family = tuple(FAMILIES)[number // 2 % len(FAMILIES)]
    shift = dice.signed((LEAST_SHIFT_PX, MOST_SHIFT_PX)) if dice.random.random() < 1 / 2 else 0.0
    scene = SceneParameters(
        dice.within(INCIDENCES_DEG), dice.within((0.0, 360.0)), shift, refractive_index=dice.within(INDICES)
    )
    taking = Taking(
        noise=dice.in_proportion(NOISES),
        bits=dice.one_of(BITS),
        below_white=True,
        reflection_gain=dice.in_proportion(REFLECTION_GAINS),
    )
    pair, *quarters = (int(drawn) for drawn in dice.random.integers(0, 1000 * _QUARTERS, 3))
    draft = FAMILIES[family](_Draft(scene, taking), dice, size)
    if sensor:
        blur = Dice(number + _OF_LENSES).within(LENS_BLURS_PX)
        draft = _photographed(draft, sensor=sensor, lens_blur_px=blur, moving_side=0.0, moving_step=0.0)
    if shot_noise:
        white = draft.taking.noise
        dark = white * Dice(number + _OF_LIGHT).in_proportion(DARK_SHARES)
        draft = _photographed(draft, noise=dark, shot_noise=white**2 - dark**2)
    told = draft.scene.refractive_index if draft.index_told is None else draft.index_told
    turns = quarters[0] % _QUARTERS, quarters[1] % _QUARTERS
    return Window(number, family, draft.scene, told, draft.taking, pair, turns)


def numbers_of(half: str, per_family: int, first: int = 0) -> range:
    """Numbers of the scenes of one half from the first on, so many of each family."""
    first += (HALVES.index(half) - first) % len(HALVES)
    return range(first, first + len(HALVES) * per_family * len(FAMILIES), len(HALVES))


# What is special about a family.


def _pane(draft: _Draft, **changes: Any) -> _Draft:
    return replace(draft, scene=draft.scene.replace(**changes))


def _photographed(draft: _Draft, **changes: Any) -> _Draft:
    return replace(draft, taking=replace(draft.taking, **changes))


def _plain(draft: _Draft, dice: Dice, size: int) -> _Draft:
    shift = dice.signed((0.0, LEAST_SHIFT_PX)) if dice.random.random() < 1 / 2 else 0.0
    return _pane(draft, ghost_shift=shift)


def _ghosts(draft: _Draft, dice: Dice, size: int) -> _Draft:
    return _pane(draft, ghost_shift=dice.signed((LEAST_SHIFT_PX, MOST_SHIFT_PX)))


def _strong_noise(draft: _Draft, dice: Dice, size: int) -> _Draft:
    return _photographed(draft, noise=dice.in_proportion(STRONG_NOISES))


def _screen(draft: _Draft, dice: Dice, size: int) -> _Draft:
    light = dice.within(DEGREES), dice.within((0.0, 180.0))
    return _pane(draft, incidence_deg=dice.within(POLARIZED_INCIDENCES_DEG), transmission_polarization=light)


def _sky(draft: _Draft, dice: Dice, size: int) -> _Draft:
    light = dice.within(DEGREES), dice.within((0.0, 180.0))
    return _pane(draft, incidence_deg=dice.within(POLARIZED_INCIDENCES_DEG), reflection_polarization=light)


def _both(draft: _Draft, dice: Dice, size: int) -> _Draft:
    return _sky(_screen(draft, dice, size), dice, size)


def _wide(draft: _Draft, dice: Dice, size: int) -> _Draft:
    view = dice.within(VIEWS_DEG)
    incidence = dice.within((INCIDENCES_DEG[0], min(INCIDENCES_DEG[1], STEEPEST_DEG - view / 2)))
    return _pane(draft, incidence_deg=incidence, focal_px=focal_px(view, size))


def _bent(draft: _Draft, dice: Dice, size: int) -> _Draft:
    draft = _pane(draft, incidence_deg=dice.within(BENT_INCIDENCES_DEG))
    view = dice.within(BENT_VIEWS_DEG) if dice.random.random() < 1 / 2 else 0.0
    bend = random_bend(dice.within(BENDS_DEG), size, dice.random)
    return _pane(draft, focal_px=focal_px(view, size), bend_deg_per_px=bend)


def _clipped(draft: _Draft, dice: Dice, size: int) -> _Draft:
    return _photographed(draft, clipped=dice.in_proportion(CLIPPED_SHARES))


def _low_bits(draft: _Draft, dice: Dice, size: int) -> _Draft:
    return _photographed(draft, bits=dice.one_of(LOW_BITS))


def _index_wrong(draft: _Draft, dice: Dice, size: int) -> _Draft:
    return replace(draft, index_told=REFRACTIVE_INDEX)


def _errors_of_filters(draft: _Draft, dice: Dice, size: int) -> _Draft:
    gains = tuple(1 + dice.within((-MOST_GAIN_ERROR, MOST_GAIN_ERROR)) for _ in draft.taking.gains)
    return _photographed(draft, gains=gains, angle_error_deg=dice.signed((0.0, MOST_ANGLE_ERROR_DEG)))


def _panes(draft: _Draft, dice: Dice, size: int) -> _Draft:
    turned = dice.random.random() < 1 / 2
    azimuth = draft.scene.values()[1] + GAP_TURN_DEG * float(dice.random.standard_normal())
    return _pane(
        draft,
        n_panes=dice.one_of(tuple(range(2, MOST_PANES + 1))),
        gap_shift=dice.signed(GAPS_PX),
        gap_azimuth_deg=azimuth if turned else None,
    )


def _tinted(draft: _Draft, dice: Dice, size: int) -> _Draft:
    return _pane(_ghosts(draft, dice, size), absorption=-math.log(dice.within(TINTS)))


def _moving(draft: _Draft, dice: Dice, size: int) -> _Draft:
    return _photographed(draft, moving_side=dice.within(MOVING_SIDES), moving_step=dice.within(MOVING_STEPS))


def _mixed(draft: _Draft, dice: Dice, size: int) -> _Draft:
    """Everything at once, each with its chance."""
    draft = _photographed(
        draft,
        noise=dice.in_proportion((NOISES[0], STRONG_NOISES[1])),
        bits=int(dice.random.integers(min(LOW_BITS), max(BITS) + 1)),
        reflection_gain=dice.in_proportion(ALL_REFLECTION_GAINS),
    )
    # A lens comes after what draws an incidence of its own.
    for special in (_screen, _sky, _bent, _clipped, _index_wrong, _errors_of_filters, _panes, _tinted, _moving, _wide):
        if dice.random.random() < MIXED_CHANCE:
            draft = special(draft, dice, size)
    return draft


FAMILIES: dict[str, Special] = {
    "plain": _plain,
    "ghosts": _ghosts,
    "strong noise": _strong_noise,
    "polarized screen": _screen,
    "sky": _sky,
    "both": _both,
    "wide lens": _wide,
    "bent": _bent,
    "clipped": _clipped,
    "low bits": _low_bits,
    "index wrong": _index_wrong,
    "gain and angles": _errors_of_filters,
    "several panes": _panes,
    "tinted": _tinted,
    "moving": _moving,
    "mixed": _mixed,
}
"""By what is special about their scenes."""
POLARIZED_FAMILIES = ("polarized screen", "sky", "both")
