"""The scenes that studies separate: one vocabulary, one list.

A scene is a pane, what light, camera and photographer do (`Taking`), and what the software is given of the pane. It is
plain values, so that a job can hold it; `studies.camera.take` photographs it with a pair of photographs as its layers.

`SCENES` holds all of them by name, in four sets: the paper's `PROTOCOL` (further incidences and noises by `protocol`),
the `LADDER`'s families, each with the lowest scene model that is adequate, the `STABILITY` scenes, families that leave
step by step what the software can do, and those of different `STARTS`. Panes with random numbers come from
`random_scene`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from polaropt.optics import SceneParameters, ghost_step

Formula = Literal["paper", "plate"]
Light = Literal["photograph", "hdr", "highlight", "dark hdr"]
Draw = Literal["protocol", "stability"]
Sensor = Literal["", "mono", "color"]

BLIND = SceneParameters(None, None, None)
"""What is given of a pane by default: nothing."""

# The source paper's protocol.
INCIDENCES_DEG = (10, 40, 60, 70, 80, 85)
REFRACTIVE_INDEX = 1.5
THICKNESS_PX = 10.0
NOISE = 0.005
"""Standard deviation in each photograph (white = 1)."""
BITS = 12

INCIDENCE_DEG, WIDE_INCIDENCE_DEG = 60.0, 55.0
"""Where nothing else is said: from afar, and in the middle of a wide lens."""
VIEW_DEG = 45.0
"""Of a wide lens, along the frame's side."""
MOST_BENT_DEG = 8.0
"""How far a bent pane's normal turns at most from the middle to the end of the frame's side."""
SCREEN_DOLP, SKY_DOLP = 0.6, 0.3
"""Degrees of polarization of a screen behind the glass and of the sky that it mirrors."""
WATER_INDEX = 1.33
CLIPPED = 0.05


@dataclass(frozen=True)
class Pane:
    """What is known of the pane and its view before azimuth, bend and polarization angles are drawn for a pair.

    Attributes
    ----------
    incidence_deg, refractive_index : float
    ghosts : {"paper", "plate", "in place"}
        Formula of the step from one ghost to the next, see `polaropt.ghost_step`; "in place": no ghost is shifted.
    single_surface : bool
        No back face (water).
    view_deg : float
        Field of view along the side; 0: seen from afar.
    most_bent_deg : float
        How far the normal turns at most from the middle to the end of the side, as `SceneParameters.bend_deg_per_px`.
    screen_dolp, sky_dolp : float
        Degree of polarization of the light from behind and of the mirrored light.
    """

    incidence_deg: float = INCIDENCE_DEG
    refractive_index: float = REFRACTIVE_INDEX
    ghosts: Literal["paper", "plate", "in place"] = "paper"
    single_surface: bool = False
    view_deg: float = 0.0
    most_bent_deg: float = 0.0
    screen_dolp: float = 0.0
    sky_dolp: float = 0.0

    @property
    def ghost_shift(self) -> float:
        """In pixels."""
        if self.ghosts == "in place":
            return 0.0
        return ghost_step(self.incidence_deg, self.refractive_index, THICKNESS_PX, self.ghosts)


@dataclass(frozen=True)
class Taking:
    """What light, camera and photographer do beside the pane.

    Attributes
    ----------
    noise : float
        Standard deviation in each photograph (white = 1).
    bits : int
    below_white : bool
        Exposed so that nothing clips, unless it is meant to.
    clipped : float
        Share of the pixels that some photograph clips.
    clipped_transmission : float
        Share of the transmission's pixels that exceed white.
    headroom : bool
        The sensor shows what is brighter than white, too; scores are of the same pixels.
    gamma : float
        Photographs are encoded as ``I^(1/gamma)``.
    shift_px : float
        How far the second and fourth photograph lie from the others, in opposite directions.
    turn_deg : float
        How far they are turned about the middle, in opposite directions.
    defocus_px : float
        Standard deviation of a Gaussian by which the third photograph is less sharp than the others.
    parallax_px : float
        How far the mirrored scene lies beside its first place in the other photographs, each in a direction of its own,
        while what is behind the pane stays: what moving the camera leaves when the photographs are moved onto that.
    unglazed_side : float
        Width of a window frame on all four sides of the photograph, in its shorter side: it shows no glass, scores are
        of what lies within.
    angle_error_deg : float
        The filter's angles are off by this, +, -, +, - along the sequence.
    reflection_gain : float
        Brightness of the mirrored scene.
    light : {"photograph", "hdr", "highlight", "dark hdr"}
        What is done to the photographs of the two scenes, see `studies.camera`.
    stops : float
        Range of brightness of the light "hdr".
    bend_deg : float
        How much the normal of a pane bent about the vertical turns from side to side, seen from afar.
    gains : tuple of float
        What each photograph's light is multiplied by, as exposures differ.
    moving_side, moving_step : float
        Side of a square thing behind the pane, and how far it goes from photograph to photograph, in sides of the
        frame; 0: nothing moves.
    sensor : {"", "mono", "color"}
        Of a polarization camera, which takes one raw mosaic; "" takes four full photographs.
    lens_blur_px : float
        Standard deviation of what the camera's lens makes of a point; the true layers are as it images them.
    reflection_blur_px : float
        The same of what is mirrored alone, which lies at another distance than what is in focus.
    shot_noise : float
        Growth of the noise with the light: its variance is ``noise^2 + shot_noise * light``.
    noise_blur_px : float
        Standard deviation of the Gaussian that makes neighbours' noise alike, as demosaicking or resizing does; it is
        as strong in each pixel as without.
    """

    noise: float = NOISE
    bits: int = BITS
    below_white: bool = False
    clipped: float = 0.0
    clipped_transmission: float = 0.0
    headroom: bool = False
    gamma: float = 1.0
    shift_px: float = 0.0
    turn_deg: float = 0.0
    defocus_px: float = 0.0
    parallax_px: float = 0.0
    unglazed_side: float = 0.0
    angle_error_deg: float = 0.0
    reflection_gain: float = 1.0
    light: Light = "photograph"
    stops: float = 0.0
    bend_deg: float = 0.0
    gains: tuple[float, ...] = (1.0, 1.0, 1.0, 1.0)
    moving_side: float = 0.0
    moving_step: float = 0.0
    sensor: Sensor = ""
    lens_blur_px: float = 0.0
    reflection_blur_px: float = 0.0
    shot_noise: float = 0.0
    noise_blur_px: float = 0.0

    @property
    def noise_at_white(self) -> float:
        """Standard deviation of all noise in light of 1."""
        return math.sqrt(self.noise**2 + self.shot_noise)


@dataclass(frozen=True)
class Scene:
    """A scene; azimuth, noise and all other chance come with the pair of photographs.

    Attributes
    ----------
    name : str
        Unique.
    pane : Pane
    taking : Taking
    hint : SceneParameters
        What the software is given of the pane; None is estimated.
    hint_error : (str, float) or None
        One number that it is given as well, and how far that is off.
    draw : {"protocol", "stability"}
        How chance is drawn. "protocol": azimuth and noise have a generator each, seeded by the pair's number;
        "stability": one generator, seeded by 1000 more, for azimuth, polarization angles, highlights and noise.
    family : str
        Scenes that belong together.
    value, second : float
        Where along the family, and along the other axis of a map.
    rung : str
        The lowest adequate scene model, where the study of models asks for it.
    easy : bool
        Whether it is the family's easy end, against which the others are measured.
    """

    name: str
    pane: Pane = Pane()
    taking: Taking = Taking()
    hint: SceneParameters = BLIND
    hint_error: tuple[str, float] | None = None
    draw: Draw = "protocol"
    family: str = ""
    value: float = 0.0
    second: float = 0.0
    rung: str = ""
    easy: bool = False

    @property
    def label(self) -> str:
        """Its name within the family."""
        return self.name.removeprefix(f"{self.family}: ")

    def hint_of(self, true: SceneParameters) -> SceneParameters:
        """What the software is given of the true pane."""
        if self.hint_error is None:
            return self.hint
        name, error = self.hint_error
        return self.hint.replace(**{name: getattr(true, name) + error})


# The paper's protocol.


def protocol(incidence_deg: float, formula: Formula = "paper", noise: float = NOISE) -> Scene:
    """The paper's kind of scene at an incidence: a pane 10 px thick of index 1.5, little noise, 12 bits."""
    more = (", plate" if formula == "plate" else "") + (f", noise {noise:g}" if noise != NOISE else "")
    pane = Pane(float(incidence_deg), ghosts=formula)
    return Scene(f"{incidence_deg:g} deg{more}", pane, Taking(noise), family="protocol", value=float(incidence_deg))


PROTOCOL = tuple(protocol(incidence) for incidence in INCIDENCES_DEG)


# One family for each scene model.

_WIDE = Pane(WIDE_INCIDENCE_DEG, ghosts="in place", view_deg=VIEW_DEG)
_WIDE_WITH_GHOSTS = replace(_WIDE, ghosts="paper")
_CLIPPED_INCIDENCES_DEG = (40, 60, 80)


def _ladder() -> Iterable[Scene]:
    def scene(name: str, rung: str, pane: Pane, taking: Taking = Taking(), hint: SceneParameters = BLIND) -> Scene:
        return Scene(name, pane, taking, hint, family=name, rung=rung)

    water = SceneParameters(None, None, None, WATER_INDEX, single_surface=True)
    yield scene("in place, 60 deg", "pixelwise", Pane(ghosts="in place"))
    yield scene("ghosts, 40 deg", "ghosts", Pane(40.0))
    yield scene("ghosts, 70 deg", "ghosts", Pane(70.0))
    yield scene("wide lens, 45 deg of view", "perspective", _WIDE)
    yield scene("wide lens with ghosts", "perspective", _WIDE_WITH_GHOSTS)
    yield scene("bent pane, 45 deg of view", "curved", replace(_WIDE, most_bent_deg=MOST_BENT_DEG))
    on_water = Pane(60.0, WATER_INDEX, "in place", single_surface=True)
    yield scene("water, single surface", "pixelwise", on_water, hint=water)
    yield scene("index 1.6 told as 1.5", "ghosts", Pane(60.0, 1.6))
    yield scene("ghosts, 60 deg", "ghosts", Pane(60.0))
    for incidence in _CLIPPED_INCIDENCES_DEG:
        for how, headroom in (("beyond white but seen", True), ("clipped", False)):
            name = f"ghosts, {incidence} deg, 5 % {how}"
            yield scene(name, "ghosts", Pane(float(incidence)), Taking(clipped=CLIPPED, headroom=headroom))
    for name, pane in (("", Pane(60.0)), ("wide lens, ", _WIDE)):
        yield scene(f"{name}screen behind", "polarized", replace(pane, screen_dolp=SCREEN_DOLP))
        yield scene(f"{name}sky reflected", "polarized", replace(pane, sky_dolp=SKY_DOLP))
        if not name:
            yield scene("screen and sky", "polarized", replace(pane, screen_dolp=SCREEN_DOLP, sky_dolp=SKY_DOLP))
    of_both = replace(_WIDE_WITH_GHOSTS, screen_dolp=SCREEN_DOLP, sky_dolp=SKY_DOLP)
    yield scene("wide lens with ghosts, screen and sky", "polarized", of_both)


LADDER = tuple(_ladder())


# Families that leave step by step what the software can do.

MAP = "incidence and noise"
SPECIAL = "special cases"
QUICK_EVERY, QUICK_FIRST = 14, 3
"""A quick look at the stability has the easy ends, the special cases, and each 14th scene from the fourth on."""


def _stable(family: str, value: float, label: str = "", **parts: Any) -> Scene:
    """A scene of a family: `taking` is exposed below white, and chance is drawn as the families have it."""
    taking = replace(parts.pop("taking", Taking()), below_white=True)
    name = f"{family}: {label or f'{value:g}'}"
    return Scene(name, taking=taking, draw="stability", family=family, value=value, **parts)


def incidence_and_noise(incidence_deg: float, noise: float) -> Scene:
    """A scene of the map over both."""
    return _stable(
        MAP, incidence_deg, f"{incidence_deg:g} deg, noise {noise:g}", pane=Pane(incidence_deg), taking=Taking(noise),
        second=noise, easy=(incidence_deg, noise) == (INCIDENCE_DEG, 0.001),
    )  # fmt: skip


def _map() -> Iterable[Scene]:
    for noise in (0.001, 0.003, 0.005, 0.01, 0.02, 0.04):
        for incidence in (10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0, 85.0):
            yield incidence_and_noise(incidence, noise)


def _given_wrongly() -> Iterable[Scene]:
    for index in (1.5, 1.33, 1.4, 1.45, 1.55, 1.6, 1.7, 1.9):
        pane = Pane(refractive_index=index)
        yield _stable("index told as 1.5", index, pane=pane, easy=index == REFRACTIVE_INDEX)
    for error in (0.0, -20.0, -10.0, -5.0, -2.0, 2.0, 5.0, 10.0, 20.0):
        yield _off("incidence told wrongly (deg)", "incidence_deg", error)
    for error in (0.0, 1.0, 2.0, 5.0, 10.0, 20.0, 45.0):
        yield _off("azimuth told wrongly (deg)", "azimuth_deg", error)
    for error in (0.0, -8.0, -3.0, -1.0, 1.0, 3.0, 8.0):
        yield _off("ghost shift told wrongly (px)", "ghost_shift", error)


def _off(family: str, name: str, error: float) -> Scene:
    """One number is given, and that wrongly; all others stay open."""
    return _stable(family, error, hint_error=(name, error), easy=error == 0)


def _along_pane(family: str, values: Iterable[float], name: str, base: Pane = Pane()) -> Iterable[Scene]:
    """Scenes along one property of the pane; the first is the easy end."""
    for i, value in enumerate(values):
        yield _stable(family, value, pane=replace(base, **{name: value}), easy=i == 0)


def _along_taking(
    family: str, values: Iterable[float], name: str, pane: Pane = Pane(), **fixed: Any
) -> Iterable[Scene]:
    """Scenes along one property of `Taking`; the first is the easy end."""
    for i, value in enumerate(values):
        yield _stable(family, value, pane=pane, taking=replace(Taking(**fixed), **{name: value}), easy=i == 0)


def _of_light() -> Iterable[Scene]:
    yield from _along_pane("screen behind, degree", (0, 0.1, 0.2, 0.4, 0.6, 0.8, 1.0), "screen_dolp")
    yield from _along_pane("sky mirrored, degree", (0, 0.1, 0.2, 0.3, 0.5, 0.8), "sky_dolp")
    yield from _along_taking("brightness of the reflection", (1.0, 0.02, 0.1, 0.3, 3.0, 10.0), "reflection_gain")
    yield from _along_taking("range of brightness (stops)", (4.0, 6.0, 8.0, 10.0, 12.0), "stops", light="hdr")


def _of_geometry() -> Iterable[Scene]:
    wide = Pane(WIDE_INCIDENCE_DEG, ghosts="in place")
    yield from _along_pane("field of view (deg)", (0, 10.0, 20.0, 30.0, 45.0, 60.0, 75.0), "view_deg", wide)
    yield from _along_taking("bend of the pane (deg)", (0, 1.0, 2.0, 5.0, 10.0, 20.0), "bend_deg", wide)


def _of_camera() -> Iterable[Scene]:
    yield from _along_taking("share of clipped pixels", (0, 0.01, 0.05, 0.1, 0.2, 0.35), "clipped_transmission")
    yield from _along_taking("bits", (14, 12, 10, 8, 6, 5), "bits", noise=0.001)
    yield from _along_taking("gamma of the encoding", (1.0, 1.05, 1.1, 1.2, 1.5, 1.8, 2.2), "gamma")
    yield from _along_taking("misregistration (px)", (0, 0.1, 0.25, 0.5, 1.0, 2.0, 5.0), "shift_px")
    yield from _along_taking("one photograph out of focus (px)", (0, 0.3, 0.5, 0.8, 1.2, 2.0, 3.0), "defocus_px")
    yield from _along_taking("parallax of the layers (px)", (0, 0.2, 0.5, 1.0, 2.0, 4.0, 6.0), "parallax_px")
    frames = (0, 0.03, 0.06, 0.1, 0.15, 0.2, 0.25)
    yield from _along_taking("frame that shows no glass (sides)", frames, "unglazed_side")
    yield from _along_taking("error of the filter's angles (deg)", (0, 0.5, 1.0, 2.0, 5.0, 10.0), "angle_error_deg")
    yield from _along_taking("turned photographs (deg)", (0, 0.03, 0.1, 0.3, 1.0, 2.0, 4.0), "turn_deg")
    yield from _along_taking("noise alike in neighbours (px)", (0, 0.35, 0.5, 0.7, 1.0, 1.5), "noise_blur_px")
    yield from _along_taking("all out of focus (px)", (0, 1.0, 2.0, 3.0), "lens_blur_px")
    place = Pane(ghosts="in place")
    yield from _along_taking("reflection out of focus (px)", (0, 2.0, 5.0), "reflection_blur_px", place)


def _special() -> Iterable[Scene]:
    """The paper's four, and an easy one."""
    scenes = (
        ("easy", Pane(), Taking()),
        ("weakly polarized", Pane(30.0, sky_dolp=0.1), Taking(reflection_gain=0.3)),
        ("fully polarized screen", Pane(screen_dolp=1.0), Taking()),
        ("highlight", Pane(), Taking(light="highlight")),
        ("dark, high dynamic range", Pane(), Taking(light="dark hdr")),
    )
    for i, (name, pane, taking) in enumerate(scenes):
        yield _stable(SPECIAL, i, name, pane=pane, taking=taking, easy=i == 0)


STABILITY = (*_map(), *_given_wrongly(), *_of_light(), *_of_geometry(), *_of_camera(), *_special())
STABILITY_QUICK = tuple(
    scene
    for i, scene in enumerate(STABILITY)
    if scene.easy or scene.family == SPECIAL or i % QUICK_EVERY == QUICK_FIRST
)
SPECIAL_CASES = tuple(scene for scene in STABILITY if scene.family == SPECIAL and not scene.easy)
"""The paper's four."""


# Different starts: incidence and noise, and three special cases.

SCREEN, SATURATION, STRONG_NOISE = "polarized screen", "saturation", "strong noise"
START_INCIDENCES_DEG = (10.0, 15.0, 20.0, 25.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0, 85.0)
START_NOISES = (NOISE, 0.02)
_HARDER: dict[str, tuple[dict[str, float], Taking]] = {
    SCREEN: ({"screen_dolp": SCREEN_DOLP}, Taking()),
    SATURATION: ({}, Taking(clipped_transmission=CLIPPED)),
    STRONG_NOISE: ({}, Taking(noise=0.05)),
}


def starts(quick: bool = False) -> tuple[Scene, ...]:
    """Scenes for different starts; quick: one of each special case and three incidences."""
    on_map = ((10.0, 60.0, 85.0), START_NOISES[:1]) if quick else (START_INCIDENCES_DEG, START_NOISES)
    harder = (60.0,) if quick else (40.0, 60.0, 80.0)
    return (
        *(incidence_and_noise(incidence, noise) for noise in on_map[1] for incidence in on_map[0]),
        *(
            _stable(
                family, incidence, f"{incidence:g} deg", pane=Pane(incidence, **of_pane), taking=taking,
                second=taking.noise,
            )
            for family, (of_pane, taking) in _HARDER.items()
            for incidence in harder
        ),
    )  # fmt: skip


STARTS = starts()

SCENES = {scene.name: scene for scene in (*PROTOCOL, *LADDER, *STABILITY, *STARTS)}
"""All that have a name."""


# Panes with random numbers.

RANDOM_KINDS = ("pixelwise", "ghosts", "perspective", "curved", "screen", "sky")
POLARIZED_KINDS = {"screen": "transmission_polarization", "sky": "reflection_polarization"}
RANDOM_INCIDENCES_DEG = (20.0, 80.0)
WIDE_RANDOM_INCIDENCES_DEG = (30.0, 70.0)
"""A wide lens sees more than 15 degrees beside the middle."""
RANDOM_DEGREES = (0.2, 0.9)
RANDOM_THICKNESSES_PX = (6.0, 12.0)
RANDOM_VIEWS_DEG = (30.0, 50.0)


def random_scene(kind: str, size: int, random: np.random.Generator) -> SceneParameters:
    """A pane of one of the `RANDOM_KINDS` with random numbers, for frames of a size in pixels."""
    wide = kind in ("perspective", "curved")
    incidence = float(random.uniform(*(WIDE_RANDOM_INCIDENCES_DEG if wide else RANDOM_INCIDENCES_DEG)))
    scene = SceneParameters(incidence, float(random.uniform(0, 360)), 0.0, REFRACTIVE_INDEX)
    if kind in POLARIZED_KINDS:
        light = float(random.uniform(*RANDOM_DEGREES)), float(random.uniform(0, 180))
        scene = scene.replace(**{POLARIZED_KINDS[kind]: light})
    if kind == "ghosts" or kind in POLARIZED_KINDS:
        formula: Formula = "paper" if random.random() < 0.5 else "plate"
        thickness = float(random.uniform(*RANDOM_THICKNESSES_PX))
        return scene.replace(ghost_shift=ghost_step(incidence, REFRACTIVE_INDEX, thickness, formula))
    if wide:
        scene = scene.replace(focal_px=focal_px(float(random.uniform(*RANDOM_VIEWS_DEG)), size))
    if kind == "curved":
        scene = scene.replace(bend_deg_per_px=random_bend(MOST_BENT_DEG, size, random))
    return scene


def random_bend(most_deg: float, size: int, random: np.random.Generator) -> tuple[float, float, float]:
    """How the normal changes from pixel to pixel, at most `most_deg` from the middle to the end of the side."""
    b_xx, b_xy, b_yy = random.uniform(-most_deg, most_deg, 3) / (size / 2)
    return float(b_xx), float(b_xy), float(b_yy)


def focal_px(view_deg: float, size: int) -> float | None:
    """Focal length of a lens that sees `view_deg` along a side of `size` pixels; None from afar."""
    return None if view_deg == 0 else size / 2 / math.tan(math.radians(view_deg / 2))
