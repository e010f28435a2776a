"""The scenes of the study of starts: incidence and noise, and the special cases."""

from __future__ import annotations

from collections.abc import Sequence

from studies.protocol import NOISE
from studies.stability_scenes import MAP, Case, Taking

INCIDENCES_DEG = (10.0, 15.0, 20.0, 25.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0, 85.0)
NOISES = (NOISE, 0.02)
SCREEN, SATURATION, STRONG_NOISE = "polarized screen", "saturation", "strong noise"
SPECIAL_INCIDENCES_DEG = (40.0, 60.0, 80.0)
FRONTAL_DEG = 25.0
"""Up to here the layers' detail can hardly be told apart."""
_SPECIAL = {
    SCREEN: Taking(screen_dolp=0.6),
    SATURATION: Taking(clipped=0.05),
    STRONG_NOISE: Taking(noise=0.05),
}
_QUICK_INCIDENCES_DEG = (10.0, 60.0, 85.0)


def scenes(quick: bool = False) -> list[Case]:
    """All scenes, or one of each special case and three incidences."""
    return [*_map(quick), *_special(quick)]


def _map(quick: bool) -> Sequence[Case]:
    incidences, noises = (_QUICK_INCIDENCES_DEG, NOISES[:1]) if quick else (INCIDENCES_DEG, NOISES)
    return [
        Case(MAP, incidence, noise, f"{incidence:g} deg, noise {noise:g}", incidence, taking=Taking(noise=noise))
        for noise in noises
        for incidence in incidences
    ]


def _special(quick: bool) -> Sequence[Case]:
    incidences = SPECIAL_INCIDENCES_DEG[1:2] if quick else SPECIAL_INCIDENCES_DEG
    return [
        Case(family, incidence, taking.noise, f"{incidence:g} deg", incidence, taking=taking)
        for family, taking in _SPECIAL.items()
        for incidence in incidences
    ]


def regime(family: str, incidence_deg: float, noise: float) -> str:
    """What the conclusions are drawn for: a special case, or a part of the map."""
    if family != MAP:
        return family
    side = f"incidence <= {FRONTAL_DEG:g} deg" if incidence_deg <= FRONTAL_DEG else f"beyond {FRONTAL_DEG:g} deg"
    return f"{side}, noise {noise:g}"
