"""Photographs that lie a little beside each other, as a whole or each layer by itself, or are not equally sharp.

A filter is turned between the photographs, the camera moves, focuses anew or is not held still. A tenth of a pixel, or
one photograph a little out of focus, makes polarized light of every edge, in which panes are then found that are none.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from polaropt.capture.capture import Capture
from polaropt.capture.checks import swapped_photographs
from polaropt.capture.matching.blur import BlurFit, covariances
from polaropt.capture.matching.parallax import ParallaxFit
from polaropt.capture.matching.restoration import FOR_SCENE, restored
from polaropt.capture.matching.spectra import DetailSpectra, detail_spectra, polarized_axis
from polaropt.capture.matching.transfer import Transfer
from polaropt.capture.noise import LEAST_NOISE, noise_level
from polaropt.capture.registration import Motions, Shifts, measure_shifts, measure_turns, turns_show
from polaropt.numerics import middle_part

_LOOKED_AT_PX = 512
"""Side of the middle of a frame by which shifts are measured; set by hand, for the time it takes."""
_SURE = 5.0
"""Standard errors that a shift must be larger than to be undone without being asked to: of 192 random windows one, in
strong noise, had a shift of three. By trial."""
_MOST_OF_FRAME = 1 / 4
"""Distance between two photographs, as a part of the shorter side of the frame and of what is looked at, up to which
they are moved without being asked to: what one of them does not show at the edges is not valid in it. Set by hand; of
240 random windows (`studies.random_windows`, even seeds from 930000), whose photographs lie in place, none is measured
to lie by more than 0.3 px beside the first."""
_FAR_PX = 1.0
"""Distance between two photographs from which on turns are measured without a glance; set by hand."""
_MOST_IN_TILES_PX = 24.0
"""Distance up to which shifts are undone with all else, in tiles that have 32 pixels around them. Set by hand."""
_MOST_BLUR_PX = 5.0
"""Widest blur that is undone: tiles are restored with 32 pixels around them. Set by hand."""
_MOST_BESIDE = 0.2
"""Polarized light beside one line, as a share of that on it, up to which the scene is one of a flat pane; by trial."""
_MOST_LEFT = 1.5
"""What is left at most where blurs, or layers that move, are why photographs leave something unexplained, in units of
the noise as it is measured, of which these make more than there is: where more is left, the reason is another one. Set
by hand."""
_LEAST_BESIDES, _BETTER_BY_LAYERS = 1.03, 0.92
"""What no two pictures in place explain, in units of the noise, from which on both layers may have moved by themselves,
and the part of it that is left at most where they have: of 192 random windows, in which none has, the smallest part was
0.97 but for two of which no more than noise was left, and of double images seen by a wide lens 0.94. By trial."""
_LEAST_NOISE_OF_PHOTOGRAPHS = 1e-3
"""Noise that photographs are taken to have at least (white = 1): with less, double images, several panes and tint leave
more than two pictures explain. By trial on random windows without noise."""
_NEARLY_ALL = 0.1
"""Part of it that may be left where more than `_MOST_LEFT` is: at the edges of what is looked at layers that have moved
far show what others do not. Set by hand."""
_LEAST_MIRRORED = -0.15
"""Degree of polarization of what is mirrored, across the plane of incidence, from which on it is that of a pane: where
another reason makes two layers look as if they had moved, they come out as alike as they are let. By trial."""
_AS_GOOD = 1.1
"""What motions of whole photographs may leave, in units of what layers that move by themselves do, before and after
these were undone. Set by hand: of turned photographs 0.97 to 1.03, of layers that moved 10 and more."""
_MOST_OF_LAYERS_PX = 8.0
"""Shift of a layer that is undone at most: tiles are restored with 32 pixels around them. Set by hand."""


@dataclass(frozen=True)
class Matching:
    """Photographs that were made to agree.

    Attributes
    ----------
    capture : Capture
        Both layers in the place of the first photograph, and as sharp as in the sharpest.
    transfer : Transfer
        What was undone. Of a result its layers, where these have moved by themselves, are what is behind the pane and
        what it mirrors.
    of_scene : Capture
        The same for the estimation of the scene: without what no photograph tells, and with noise like that of others.
        Of a result the same as `capture`.
    noise : float or None
        Standard deviation of one photograph's noise, where blurs or layers that move were undone: photographs that are
        made of each other say less of it than there is. None where they tell it themselves.
    exposures : tuple of float
        How long each was exposed, relative to their geometric mean, which was divided out; empty where nothing was.
    white_balances : tuple of tuple of float
        How much longer each colour of each photograph was exposed than its colours together, as a factor, which was
        divided out, too; empty where all had the same.
    motions : Motions or None
        What was undone before all else, from the middle of the frame: turns, scales, and shifts of more than 24 pixels;
        None where there were none.
    """

    capture: Capture
    transfer: Transfer
    of_scene: Capture
    noise: float | None = None
    exposures: tuple[float, ...] = ()
    white_balances: tuple[tuple[float, ...], ...] = ()
    motions: Motions | None = None

    @classmethod
    def of_none(cls, capture: Capture) -> Matching:
        """Photographs that lie in place and are equally sharp as they are."""
        return cls(capture, Transfer.of_shifts(np.zeros((len(capture.angles_deg), 2))), capture)

    def of(self, capture: Capture) -> Matching:
        """The same undone in photographs of which other pixels count; none of which is blurred."""
        of_scene = restored(capture, self.transfer, noise=self.noise or 0.0)
        return replace(self, capture=restored(capture, self.transfer), of_scene=of_scene)

    def with_azimuth(self, azimuth_deg: float | None) -> Matching:
        """The same once the plane of incidence is known: layers in their order, without the scene's own photographs.

        These are of no use any more, and much memory.
        """
        layers = self.transfer.layers
        told = replace(self, of_scene=self.capture)
        if layers is None or azimuth_deg is None:
            return told
        return replace(told, transfer=Transfer.of_layers(layers.seen_by(azimuth_deg)))


def far_motions(capture: Capture, shifts: Shifts) -> Motions | None:
    """How photographs are turned and scaled against each other, or shifted by more than 24 pixels.

    Parameters
    ----------
    capture : Capture
        No mosaic.
    shifts : Shifts
        `shifts_in_the_middle` of it.

    Returns
    -------
    Motions or None
        From the middle of the frame. None where they are not surely so, and where they lie so far apart that too little
        would be left.
    """
    motions = None
    # Far turns hide from a glance, but most shift the middle, too.
    if (shifts.certain and shifts.largest > _FAR_PX) or turns_show(capture, shifts):
        turns = measure_turns(capture, shifts)
        motions = turns.motions if turns.better and turns.at_corners > _SURE * turns.error else None
    if motions is None and _believed(shifts) and shifts.largest > _MOST_IN_TILES_PX:
        motions = Motions.of_shifts(shifts.pixels)
    if motions is None or motions.apart_at_corners(capture.shape) > _MOST_OF_FRAME * min(capture.shape[-2:]):
        return None
    return motions


def agree_as_wholes(capture: Capture, laid: Capture) -> bool:
    """Whether motions of whole photographs are why they did not agree.

    Far ones may be mistaken, and layers that moved by themselves, of which one shows here and one there, look turned.

    Parameters
    ----------
    capture, laid : Capture
        Before and after they were undone. Three photographs do not tell.
    """
    if len(capture.angles_deg) == 3:
        return True
    noise = noise_level(laid)
    before, after = (detail_spectra(one, max(noise, _LEAST_NOISE_OF_PHOTOGRAPHS)) for one in (capture, laid))
    if before is None or after is None:
        return noise <= noise_level(capture)
    azimuth, _ = polarized_axis(laid)
    as_it_was, in_place = ParallaxFit(before, azimuth), ParallaxFit(after, azimuth)
    # A wide lens, or a bent pane, leaves more than noise, wherever photographs lie.
    by_layers = min(as_it_was.found()[1], in_place.found()[1])
    return in_place.besides_two() <= _AS_GOOD * by_layers


def may_lie_apart(capture: Capture, noise: float) -> bool:
    """Whether photographs were taken one after the other, not all at once by a mosaic, nor computed.

    What leaves no noise that could be measured was computed, and its rounding tells nothing.
    """
    return capture.cells is None and not capture.of_mosaic and noise > LEAST_NOISE


def match_photographs(capture: Capture, noise: float, shifts: Shifts | None = None) -> Matching | None:
    """Move photographs, or both layers of them, by a few pixels onto the first one, and make them equally sharp.

    Parameters
    ----------
    capture : Capture
    noise : float
        Standard deviation of one photograph's noise.
    shifts : Shifts, optional
        `shifts_in_the_middle` of it, where they are at hand.

    Returns
    -------
    Matching or None
        None where nothing is to be done, and of mosaics, which take all at once. Three photographs do not tell which of
        them is less sharp, nor where each shows both layers.
    """
    count = len(capture.angles_deg)
    if not may_lie_apart(capture, noise):
        return None
    quiet, noise = noise < _LEAST_NOISE_OF_PHOTOGRAPHS, max(noise, _LEAST_NOISE_OF_PHOTOGRAPHS)
    moved = _moved(capture, shifts or shifts_in_the_middle(capture))
    in_place = restored(capture, moved) if moved.moves else capture
    detail = detail_spectra(in_place, noise) if count > 3 else None
    if detail is None:
        return Matching(in_place, moved, in_place) if moved.moves else None
    azimuth, beside = polarized_axis(in_place)
    fit = ParallaxFit(detail, azimuth)
    before = fit.besides_two()
    if quiet and before < _LEAST_BESIDES:
        return Matching(in_place, moved, in_place) if moved.moves else None
    blurred = None if beside > _MOST_BESIDE else _with_blurs(moved, detail, azimuth)
    as_it_was = detail_spectra(capture, noise) if moved.moves else None
    if as_it_was is not None:
        # Where layers move by themselves, a shift of the whole may explain nothing.
        unmoved = ParallaxFit(as_it_was, azimuth)
        if (besides_two := unmoved.besides_two()) <= before:
            fit, before, moved = unmoved, besides_two, Transfer.of_shifts(np.zeros((count, 2)))
    apart = _with_parallax(fit, moved, before)
    # Blurs are fewer numbers: layers in places of their own must explain more.
    told = blurred if apart is None or (blurred and apart[1] > _BETTER_BY_LAYERS * blurred[1]) else apart
    if told is None:
        return Matching(in_place, moved, in_place) if moved.moves else None
    transfer, left = told
    noise = max(LEAST_NOISE, noise * math.sqrt(left))
    if transfer.layers is not None:
        return Matching(restored(capture, transfer), transfer, restored(capture, transfer, noise=noise), noise)
    of_scene = restored(capture, transfer, detail, FOR_SCENE, noise)
    return Matching(restored(capture, transfer, detail), transfer, of_scene, noise)


def look_swapped_in_place(capture: Capture, shifts: Shifts) -> bool:
    """Whether photographs look as if they were in a wrong order once they are moved onto the first one, too.

    A pixel or two between them can break the closure as an exchange of two of them does. The shifts are
    `shifts_in_the_middle` of them.
    """
    middle = capture.part(*middle_part(capture.shape, _LOOKED_AT_PX))
    moved = _moved(middle, shifts)
    return bool(swapped_photographs(restored(middle, moved) if moved.moves else middle))


def shifts_in_the_middle(capture: Capture) -> Shifts:
    """Shifts of photographs as a whole, as the middle of large ones tells them."""
    return measure_shifts(capture.part(*middle_part(capture.shape, _LOOKED_AT_PX)))


def _moved(capture: Capture, shifts: Shifts) -> Transfer:
    """Surely measured shifts of photographs as a whole, none where they lie too far apart."""
    most = min(_MOST_IN_TILES_PX, _MOST_OF_FRAME * min(capture.shape[-2:]))
    believed = _believed(shifts) and shifts.largest <= most
    return Transfer.of_shifts(shifts.pixels if believed else np.zeros((len(capture.angles_deg), 2)))


def _believed(shifts: Shifts) -> bool:
    near = shifts.largest <= _MOST_OF_FRAME * _LOOKED_AT_PX
    return shifts.certain and near and shifts.largest > _SURE * shifts.error


def _with_blurs(moved: Transfer, in_place: DetailSpectra, azimuth_deg: float) -> tuple[Transfer, float] | None:
    """Shifts with the blurs that explain what photographs of a flat pane leave unexplained, and what is then left.

    That is the variance of the noise, as a share of what it was taken for. None where no blurs do.
    """
    blurs, after = BlurFit(in_place, azimuth_deg).found()
    blurred = Transfer(moved.shifts_px, covariances(blurs), azimuth_deg)
    if not blurred.blurred or after > _MOST_LEFT or max(blurred.blurs_px) > _MOST_BLUR_PX:
        return None
    return blurred, after


def _with_parallax(fit: ParallaxFit, moved: Transfer, before: float) -> tuple[Transfer, float] | None:
    """The shifts of both layers, where these explain what no two pictures in place do, and what is then left.

    That is the variance of the noise, as for blurs. None where they do not.
    """
    if before < _LEAST_BESIDES and not moved.moves:
        return None
    beside, after = fit.found()
    layers = replace(beside, shifts_px=beside.shifts_px + moved.shifts_px)
    most_left = min(_BETTER_BY_LAYERS * before, max(_MOST_LEFT, _NEARLY_ALL * before))
    if (
        after > most_left
        or np.abs(layers.shifts_px).max() > _MOST_OF_LAYERS_PX
        or layers.polarized[1] > _LEAST_MIRRORED
    ):
        return None
    return Transfer.of_layers(layers), after
