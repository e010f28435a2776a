"""The scenes of the stability study: families that leave, step by step, what the software can do."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from typing import Any, Literal

from polaropt.optics import SceneParameters, ghost_step
from studies.protocol import BITS, NOISE, REFRACTIVE_INDEX, THICKNESS_PX

Light = Literal["photograph", "hdr", "highlight", "dark hdr"]

BLIND = SceneParameters(None, None, None)
INCIDENCE_DEG, WIDE_INCIDENCE_DEG = 60.0, 55.0
MAP = "incidence and noise"
SPECIAL = "special cases"


@dataclass(frozen=True)
class Taking:
    """What camera, light and photographer do beside the pane.

    Attributes
    ----------
    noise : float
        Standard deviation in each photograph (white = 1).
    bits : int
    clipped : float
        Share of the transmission's pixels that exceed white.
    gamma : float
        Photographs are encoded as ``I^(1/gamma)``.
    shift_px : float
        How far the second and fourth photograph lie from the others, in opposite directions.
    angle_error_deg : float
        The filter's angles are off by this, +, -, +, - along the sequence.
    reflection_gain : float
        Brightness of the mirrored scene.
    light : {"photograph", "hdr", "highlight", "dark hdr"}
        What is done to the photographs of the two scenes, see `studies.stability_capture`.
    stops : float
        Range of brightness of the light "hdr".
    view_deg : float
        Field of view along the side.
    bend_deg : float
        How much the pane's normal turns from side to side.
    screen_dolp, sky_dolp : float
        Degree of polarization of the light from behind and of the mirrored light.
    """

    noise: float = NOISE
    bits: int = BITS
    clipped: float = 0.0
    gamma: float = 1.0
    shift_px: float = 0.0
    angle_error_deg: float = 0.0
    reflection_gain: float = 1.0
    light: Light = "photograph"
    stops: float = 0.0
    view_deg: float = 0.0
    bend_deg: float = 0.0
    screen_dolp: float = 0.0
    sky_dolp: float = 0.0


@dataclass(frozen=True)
class Case:
    """One scene of the study; its azimuth comes with the pair.

    Attributes
    ----------
    family : str
    value : float
        Where along the family.
    second : float
        Where along the other axis of a map.
    label : str
    incidence_deg : float
    refractive_index : float
    ghosts : bool
        Whether bounces shift; else they are in place.
    taking : Taking
    told : callable
        From the true scene to what the software is told; None is estimated.
    easy : bool
        Whether it is the family's easy end, against which the others are measured.
    """

    family: str
    value: float
    second: float = 0.0
    label: str = ""
    incidence_deg: float = INCIDENCE_DEG
    refractive_index: float = REFRACTIVE_INDEX
    ghosts: bool = True
    taking: Taking = Taking()
    told: Callable[[SceneParameters], SceneParameters] = field(default=lambda true: BLIND, repr=False)
    easy: bool = False

    @property
    def name(self) -> str:
        """Unique in the study."""
        return f"{self.family}: {self.label or f'{self.value:g}'}"

    @property
    def facts(self) -> frozenset[str]:
        """Warnings that are true of this scene, whether or not it fails.

        That the model does not explain the photographs is true where the scene is none of the model's.
        """
        taking = self.taking
        polarized = taking.screen_dolp > 0 or taking.sky_dolp > 0
        moved, encoded = 2 * taking.shift_px >= 0.5, taking.gamma != 1
        told_wrongly = "told" in self.family and not self.easy
        true = {
            "SATURATED": True,
            "NEAR_NORMAL": self.incidence_deg < 12,
            "GRAZING": self.incidence_deg > 84,
            "MISALIGNED": moved,
            "GAMMA_ENCODED": encoded,
            "POLARIZED_SOURCE": polarized,
            "INCIDENCE_DOUBTFUL": told_wrongly and self.family.startswith("incidence"),
            "MODEL_DOES_NOT_EXPLAIN": any((polarized, moved, encoded, told_wrongly, taking.bend_deg)),
        }
        return frozenset(name for name, holds in true.items() if holds)

    @property
    def ghost_shift(self) -> float:
        """Of the true pane, in pixels."""
        if not self.ghosts:
            return 0.0
        return ghost_step(self.incidence_deg, self.refractive_index, THICKNESS_PX, "paper")


def cases(quick: bool = False) -> list[Case]:
    """All scenes, or about every sixth of them."""
    found = [*_map(), *_told_wrongly(), *_of_light(), *_of_geometry(), *_of_camera(), *_special()]
    if not quick:
        return found
    return [case for i, case in enumerate(found) if case.easy or case.family == SPECIAL or i % 14 == 3]


def _map() -> Iterable[Case]:
    for noise in (0.001, 0.003, 0.005, 0.01, 0.02, 0.04):
        for incidence in (10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0, 85.0):
            yield Case(
                MAP, incidence, noise, f"{incidence:g} deg, noise {noise:g}", incidence, taking=Taking(noise=noise),
                easy=(incidence, noise) == (INCIDENCE_DEG, 0.001),
            )  # fmt: skip


def _told_wrongly() -> Iterable[Case]:
    for index in (1.5, 1.33, 1.4, 1.45, 1.55, 1.6, 1.7, 1.9):
        yield Case("index told as 1.5", index, refractive_index=index, easy=index == REFRACTIVE_INDEX)
    for error in (0.0, -20.0, -10.0, -5.0, -2.0, 2.0, 5.0, 10.0, 20.0):
        yield Case("incidence told wrongly (deg)", error, told=_off("incidence_deg", error), easy=error == 0)
    for error in (0.0, 1.0, 2.0, 5.0, 10.0, 20.0, 45.0):
        yield Case("azimuth told wrongly (deg)", error, told=_off("azimuth_deg", error), easy=error == 0)
    for error in (0.0, -8.0, -3.0, -1.0, 1.0, 3.0, 8.0):
        yield Case("ghost shift told wrongly (px)", error, told=_off("ghost_shift", error), easy=error == 0)


def _off(name: str, error: float) -> Callable[[SceneParameters], SceneParameters]:
    """Tells one number, and that wrongly; all others stay open."""
    return lambda true: BLIND.replace(**{name: getattr(true, name) + error})


def _along(family: str, values: Iterable[float], name: str, base: Case | None = None, **fixed: Any) -> Iterable[Case]:
    """Scenes along one property of `Taking`; the first is the easy end."""
    for i, value in enumerate(values):
        case = base or Case(family, value)
        taking = replace(Taking(**fixed), **{name: value})
        yield replace(case, family=family, value=value, label=f"{value:g}", taking=taking, easy=i == 0)


def _of_light() -> Iterable[Case]:
    yield from _along("screen behind, degree", (0, 0.1, 0.2, 0.4, 0.6, 0.8, 1.0), "screen_dolp")
    yield from _along("sky mirrored, degree", (0, 0.1, 0.2, 0.3, 0.5, 0.8), "sky_dolp")
    yield from _along("brightness of the reflection", (1.0, 0.02, 0.1, 0.3, 3.0, 10.0), "reflection_gain")
    yield from _along("range of brightness (stops)", (4.0, 6.0, 8.0, 10.0, 12.0), "stops", light="hdr")


def _of_geometry() -> Iterable[Case]:
    wide = Case("", 0, incidence_deg=WIDE_INCIDENCE_DEG, ghosts=False)
    yield from _along("field of view (deg)", (0, 10.0, 20.0, 30.0, 45.0, 60.0, 75.0), "view_deg", wide)
    yield from _along("bend of the pane (deg)", (0, 1.0, 2.0, 5.0, 10.0, 20.0), "bend_deg", wide)


def _of_camera() -> Iterable[Case]:
    yield from _along("share of clipped pixels", (0, 0.01, 0.05, 0.1, 0.2, 0.35), "clipped")
    yield from _along("bits", (14, 12, 10, 8, 6, 5), "bits", noise=0.001)
    yield from _along("gamma of the encoding", (1.0, 1.05, 1.1, 1.2, 1.5, 1.8, 2.2), "gamma")
    yield from _along("misregistration (px)", (0, 0.1, 0.25, 0.5, 1.0, 2.0, 5.0), "shift_px")
    yield from _along("error of the filter's angles (deg)", (0, 0.5, 1.0, 2.0, 5.0, 10.0), "angle_error_deg")


def _special() -> Iterable[Case]:
    """The paper's four."""
    takings = {
        "easy": Taking(),
        "weakly polarized": Taking(reflection_gain=0.3, sky_dolp=0.1),
        "fully polarized screen": Taking(screen_dolp=1.0),
        "highlight": Taking(light="highlight"),
        "dark, high dynamic range": Taking(light="dark hdr"),
    }
    for i, (label, taking) in enumerate(takings.items()):
        incidence = 30.0 if label == "weakly polarized" else INCIDENCE_DEG
        yield Case(SPECIAL, i, label=label, incidence_deg=incidence, taking=taking, easy=i == 0)


def focal_px(view_deg: float, size: int) -> float | None:
    """Focal length of a lens that sees `view_deg` along a side of `size` pixels; None from afar."""
    return None if view_deg == 0 else size / 2 / math.tan(math.radians(view_deg / 2))
