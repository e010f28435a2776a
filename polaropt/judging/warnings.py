"""What a capture cannot tell, and what went against the model: an enumeration with a sentence for each."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture, Mistakes, NoiseModel, closure_share, find_mistakes, registered_noise
from polaropt.errors import ResultWarning
from polaropt.estimation import (
    NOTABLE_CHANCE,
    NOTABLE_CHANCE_OF_MOSAIC,
    AngleMistake,
    LikelierIndex,
    SceneEstimate,
    angle_mistake,
)
from polaropt.judging.loss import LEAST_NOTABLE, SceneLoss
from polaropt.numerics import block_mean
from polaropt.optics import SceneParameters, stokes_from_intensities

Floats = NDArray[np.float32]
Mask = NDArray[np.bool_]

_UNKNOWN_REFLECTION = 0.86
"""There the fine detail of the reflection correlates with the truth by 0.3 to 0.4."""
# Incidences in degrees that the sentences below name: set by hand.
_FRONTAL_DEG, _GRAZING_DEG = 12.0, 84.0
# Share of values, that the sentence below names: set by hand.
_MUCH_CLIPPED = 0.01
_MUCH_NOISE = 0.42
"""There the transmission gains less than 7 dB on the plain intensity."""
_NOISE_HIDES = 1.25
"""Gain of less noise from which on it is noise that hides detail. Of simulated mosaics that hardly tell the reflection
a third of a noise of 1 % and more tells up to three times as much, of one of 0.1 % no more."""
_BAD_FIT = 2.2
"""Misfit ratio of four photographs, or of a mosaic: with the right pane it is 1.9 at most, on the random windows to fit
on (`studies.random_windows`), and what lies above are wrong panes, gains, angles or movement."""
_APART = 0.1
"""What photographs fail to add up by, over the polarized light, from where on their gains or angles make a pane of
their own. Set by hand: of random windows to fit on (`studies.random_windows`, even seeds) with wrong gains or angles 3
reach it, one of which fails, and none of the others; real captures have up to 0.006."""
_BLOCK = 8
"""Side in pixels of the blocks over which noise is averaged; set by hand."""
# Mean square in units of the noise of light polarized at 45 degrees that the pane does not explain, in blocks. Set by
# hand.
_MUCH_LEFT = 4.0
_LIKELY = 0.5
"""Chance of a large loss of the transmission for the errors of the scene, from which on it is said: as likely as not.
Of 72 random windows to fit on (`studies.random_windows`, even seeds) whose chance is 0.02 or more 34 fail, by the
chances 39; of the 37 above a half 28, by the chances 30. Of 88 below it 15 fail for what errors do not tell of: other
panes, another index, gains."""
# Pixels per side that the contrast is taken from, at most about twice as many.
_SAMPLE = 128


class SeparationWarning(Enum):
    """What a user should know before trusting a result; the value is the sentence.

    REFLECTION_NOT_IDENTIFIABLE tells an effect; its cause, if the capture has one, has a warning of its own:
    NO_POLARIZATION, NEAR_NORMAL, NOISE_TOO_HIGH or UNDERSAMPLED.

    Examples
    --------
    Glass that is seen frontally hardly polarizes:

    >>> from skimage.data import astronaut, coffee
    >>> from polaropt import SceneParameters, SeparationWarning, separate, simulate
    >>> pane = SceneParameters(5.0, 20.0, 0.3)
    >>> result = separate(simulate(coffee()[120:248, 200:328], astronaut()[30:158, 160:288], pane), pane)
    >>> SeparationWarning.NEAR_NORMAL in result.diagnostics.warnings
    True
    """

    NO_POLARIZATION = (
        "The photographs show no polarization: nothing can be separated, and the intensity is returned as transmission."
    )
    REFLECTION_NOT_IDENTIFIABLE = (
        "The photographs hardly tell the reflection: trust its slow changes at most. "
        "The transmission does not suffer from this."
    )
    NEAR_NORMAL = (
        "The glass is seen almost frontally (less than 12 degrees), where it hardly polarizes: "
        "photograph it more obliquely, best from 50 to 75 degrees."
    )
    GRAZING = (
        "The glass is seen at a grazing angle (more than 84 degrees), where it passes little light and small errors of "
        "the incidence matter much: the transmission is noisy; photograph the glass less obliquely."
    )
    NOISE_TOO_HIGH = (
        "The noise is large against the polarization or the brightness, and fine detail is lost in it: "
        "expose longer, or average several photographs at each angle."
    )
    UNDERSAMPLED = (
        "The samples of the mosaic lie too far apart for fine detail of this scene, and less noise would not tell it: "
        "photograph the glass more obliquely, best from 50 to 75 degrees, or the scene larger on the sensor."
    )
    SATURATED = "More than 1 % of the pixels are clipped at white; they were left out and filled in from the others."
    ANGLES_SWAPPED = (
        "The photographs look as if they were given in a wrong order (pairs do not add up, others would): "
        "check which file belongs to which polarizer angle, or the cell order of a mosaic."
    )
    CELL_ORDER_FOUND = (
        "The corners of the mosaic's cell are not in the usual order, whose orthogonal pairs do not add up: it was "
        "read in one in which they do. Which pair is 0/90, and in which sense angles count, that does not tell: the "
        "azimuth may be mirrored and off by 45 or 90 degrees, and double images are not looked for. Give the cell "
        "order (--cell-order), or try --angles relative."
    )
    ANGLES_REVERSED = (
        "The polarizer's angles look as if they were counted the other way (double images, or the change over the "
        "picture, contradict them): try --angle-sense cw (ccw if you gave cw)."
    )
    ANGLES_ROTATED = (
        "Double images lie along another direction than the polarizer's angles say: check from where and in which "
        "order the angles count, or try --angles relative."
    )
    MISALIGNED = (
        "The photographs are shifted or turned against each other by more than half a pixel: align them (--align, in "
        "Python polaropt.align)."
    )
    GAMMA_ENCODED = (
        "The photographs look gamma-encoded: pairs do not add up. Give linear files, or tell the encoding (gamma)."
    )
    POLARIZED_SOURCE = (
        "The light of a layer, or of things in it, looks polarized before it meets the glass (a screen behind it, blue "
        "sky in the reflection, water, leaves): check the layers for parts that belong to the other one."
    )
    INCIDENCE_DOUBTFUL = (
        "The photographs speak against the incidence that was given: with it the reflection would be taken off by a "
        "third too much or too little. Check it, or leave it to be found. Where it would do "
        "harm the intensity is returned as transmission, unless a model is asked for by its name."
    )
    SHIFT_DOUBTFUL = (
        "The photographs speak against the distance between double images that was given, or it is farther than the "
        "picture reaches: check it, in pixels of these photographs, or leave it to be found."
    )
    COATED = (
        "The colours tell of different panes, as coated glass mirrors each in its own way: the layers' colours are "
        "off, and what is left of the other layer in each differs."
    )
    AXIS_DOUBTFUL = (
        "A pane whose plane of incidence lies across, its layers exchanged, explains the photographs about as well: "
        "take them with less noise, or tell the azimuth (how the plane of incidence lies in the picture)."
    )
    POLARIZATION_DOUBTFUL = (
        "Several panes before polarized light show the same, as no double images are seen: how bright the layers are, "
        "and which is which, is told by what is likely alone. Tell the incidence, or photograph the glass from another "
        "side."
    )
    MODEL_DOES_NOT_EXPLAIN = (
        "The pane with these parameters does not explain the photographs down to their noise: "
        "a wide lens, a bent pane, polarized light, movement, or photographs whose exposures or angles are not exactly "
        "as told may be the reason."
    )
    MOVING = (
        "Something moved between the photographs: it was left out of the estimation. The layers show what is behind it "
        "where but one photograph saw it, else what one of them saw, the reflection as it is around. moving.png shows "
        "where."
    )
    SOLVER_FAILED = "The solver met values that are not finite; the best point before is returned."
    INDEX_DOUBTFUL = (
        "The photographs speak against the refractive index that was given or assumed: "
        "leave it to be found (--index free), or give that of the glass."
    )
    SCENE_UNCERTAIN = (
        "The pane is known less exactly than the noise would allow the layers to be: tell what you know of it (such as "
        "--incidence), or take the photographs with less noise or from another angle."
    )


@dataclass(frozen=True)
class Diagnostics:
    """What is known of a separation's trustworthiness.

    Attributes
    ----------
    warnings : tuple of SeparationWarning
    noise : float
        Standard deviation of one photograph's noise (white = 1).
    clipped : float
        Share of pixels that were not trusted, of what stands still.
    misfit_ratio : float
        Mean squared residual of the photographs in units of the noise, less what two free layers take up. Where the
        model explains them 1 to 1.9 for four photographs or a mosaic, up to 2.9 for three: layers of little noise
        follow it less than free ones.
    reflection_unknown : float
        Share of the reflection's detail (finer than about 5 px) that the photographs do not tell, 0..1.
    estimate : SceneEstimate or None
        How the scene was found; None where nothing was estimated.
    noise_model : NoiseModel or None
        How the noise grows with the light; None where that is not known.
    moving : float
        Share of the frame in which something moves between the photographs.
    likelier_index : LikelierIndex or None
        An index that the photographs tell beside the one that was given; None where they do not speak against it.
    loss : SceneLoss or None
        What the errors of the scene are expected to cost the layers; None where nothing was estimated.
    angles : AngleMistake or None
        What is wrong with the polarizer's angles.
    contradictory : bool
        Whether the photographs contradict each other by much of the polarized light that they show.
    """

    warnings: tuple[SeparationWarning, ...]
    noise: float
    clipped: float
    misfit_ratio: float
    reflection_unknown: float
    estimate: SceneEstimate | None
    noise_model: NoiseModel | None = None
    moving: float = 0.0
    likelier_index: LikelierIndex | None = None
    loss: SceneLoss | None = None
    angles: AngleMistake | None = None
    contradictory: bool = False

    def sentence(self, warning: SeparationWarning) -> str:
        """What a warning of these says; where nothing is polarized that the reflection is not told means more."""
        nothing = SeparationWarning.NO_POLARIZATION in self.warnings
        if warning is SeparationWarning.REFLECTION_NOT_IDENTIFIABLE and nothing:
            return _NO_REFLECTION
        return warning.value

    def warn(self, stacklevel: int = 1) -> None:
        """Issue what speaks against the result as a `ResultWarning`; nothing where nothing does.

        Parameters
        ----------
        stacklevel : int
            Of the place that is told, as `warnings.warn` counts: 1 is who calls this.
        """
        if self.warnings:
            told = "; ".join(self.sentence(warning).rstrip(".") for warning in self.warnings)
            warnings.warn(f"{told}.", ResultWarning, stacklevel=stacklevel + 1)


_NO_REFLECTION = (
    "Nothing is told of the reflection: it is left black, and what there is of it stays in the transmission."
)


def diagnose(
    capture: Capture,
    noise: float,
    *,
    misfit_ratio: float,
    reflection_unknown: float,
    estimate: SceneEstimate | None,
    scene: SceneParameters | None = None,
    unexplained: float = 1.0,
    noise_share: float = 0.0,
    gain_of_less_noise: float = math.inf,
    mistakes: Mistakes | None = None,
    moving: Mask | None = None,
    valid_share: float | None = None,
    doubtful_incidence: bool = False,
    coated: bool = False,
    likelier_index: LikelierIndex | None = None,
    loss: SceneLoss | None = None,
    finite: bool = True,
    polarized_things: bool = False,
    before: Diagnostics | None = None,
) -> Diagnostics:
    """Collect the warnings that a capture and its solution deserve.

    Parameters
    ----------
    capture : Capture
    noise, misfit_ratio, reflection_unknown, estimate
        As the attributes of `Diagnostics`.
    scene : SceneParameters, optional
        The scene of the solution. Default: that of the estimate.
    unexplained : float
        Light polarized at 45 degrees to the plane of incidence, mean square over blocks in units of its noise.
    noise_share : float
        See the function of this name.
    gain_of_less_noise : float
        How many times as much of the reflection's detail a third of the noise would tell. Samples of a mosaic may hide
        it themselves.
    mistakes : Mistakes, optional
        What was found wrong with the photographs. Default: it is looked for.
    moving : ndarray of bool, shape (h, w), optional
        Pixels in which something moves between the photographs: not valid in the capture.
    valid_share : float, optional
        Share of the pixels, what moves among them, that could be trusted in the photographs as they were taken.
        Default: that of the capture.
    doubtful_incidence : bool
        Whether the photographs speak against the incidence that was given.
    coated : bool
        Whether the colours tell of different panes, where the index was to be found.
    likelier_index, loss
        As the attributes of `Diagnostics`.
    finite : bool
        Whether the solver met nothing but finite values.
    polarized_things : bool
        Whether the scene was found beside things that are polarized by themselves.
    before : Diagnostics, optional
        Of a frame before: what is wrong with the camera's analyzers is so in every frame.
    """
    moving_share = 0.0 if moving is None else float(moving.mean())
    if valid_share is None:
        valid_share = capture.n_valid / capture.mask.size
    clipped = 1 - valid_share / (1 - moving_share)
    polarized = estimate is None or estimate.polarized
    if scene is None and estimate is not None:
        scene = estimate.scene
    mistakes = find_mistakes(capture.registered) if mistakes is None else mistakes
    mistake = None if before is None else before.angles
    # An azimuth that was given may be the one that is wrong.
    free = estimate is None or np.isfinite(estimate.axis_margin)
    if before is None and scene is not None and free and mistakes == Mistakes():
        small = 1 / capture.scale
        registered, of_cells = capture.registered, None if estimate is None else estimate.scaled(small)
        of_registered = registered_noise(capture, noise)
        mistake = angle_mistake(registered, of_registered, scene.scaled(small), of_cells, unexplained)
    notable = misfit_ratio * min(1.0, noise / LEAST_NOTABLE) ** 2
    explained = notable <= _bad_fit(capture) and unexplained <= _MUCH_LEFT
    # Of photographs in a wrong order, moved or encoded there is a warning of its own.
    contradictory = _far_apart(capture) if before is None else before.contradictory
    explained = explained and not (mistakes == Mistakes() and contradictory)
    # Panes before polarized light that show the same have a warning of their own.
    alike = estimate is not None and bool(estimate.rivals) and _found_polarized(scene, estimate)
    uncertain = _loses(loss) and not alike
    noise_hides = gain_of_less_noise > _NOISE_HIDES
    deserved = {
        SeparationWarning.NO_POLARIZATION: not polarized,
        SeparationWarning.REFLECTION_NOT_IDENTIFIABLE: not polarized or reflection_unknown > _UNKNOWN_REFLECTION,
        **_of_geometry_and_noise(polarized, reflection_unknown, noise_share, scene, uncertain, noise_hides),
        SeparationWarning.SATURATED: clipped > _MUCH_CLIPPED,
        **_of_mistakes(mistakes),
        SeparationWarning.CELL_ORDER_FOUND: capture.origin is not None and capture.origin.cell_order_found,
        **_of_angles(mistake),
        SeparationWarning.POLARIZED_SOURCE: polarized_things or _found_polarized(scene, estimate),
        SeparationWarning.INCIDENCE_DOUBTFUL: doubtful_incidence,
        SeparationWarning.SHIFT_DOUBTFUL: _shift_is_doubtful(scene, estimate, capture),
        SeparationWarning.COATED: coated,
        SeparationWarning.AXIS_DOUBTFUL: polarized and _may_lie_across(scene, estimate, capture),
        SeparationWarning.POLARIZATION_DOUBTFUL: _loses(loss) and alike,
        SeparationWarning.MODEL_DOES_NOT_EXPLAIN: polarized and not explained,
        SeparationWarning.MOVING: moving is not None,
        SeparationWarning.SOLVER_FAILED: not finite,
        SeparationWarning.INDEX_DOUBTFUL: likelier_index is not None,
        SeparationWarning.SCENE_UNCERTAIN: uncertain,
    }
    return Diagnostics(
        warnings=tuple(warning for warning, given in deserved.items() if given),
        noise=noise,
        clipped=clipped,
        misfit_ratio=misfit_ratio,
        reflection_unknown=reflection_unknown,
        estimate=estimate,
        moving=moving_share,
        likelier_index=likelier_index,
        loss=loss,
        angles=mistake,
        contradictory=contradictory,
    )


def noise_share(capture: Capture, transmission: Floats, variance: float) -> float:
    """Error that noise leaves in the transmission, over what was changed of the intensity or its contrast.

    Rms values; of the two the smaller counts. The separation gains as many decibels as this lies below 1.

    Parameters
    ----------
    capture : Capture
    transmission : ndarray, shape ([channel,] h, w)
    variance : float
        Mean square of the error.
    """
    rows, columns = (slice(None, None, max(1, side // _SAMPLE)) for side in capture.shape[-2:])
    seen = transmission[..., rows, columns]
    intensity = stokes_from_intensities(capture.intensities[..., rows, columns], capture.angles_deg)[0]
    changed = float(np.sqrt(np.mean(np.square(seen - intensity.reshape(seen.shape)))))
    least = min(changed, float(seen.std()))
    return float(np.sqrt(variance)) / least if least > 0 else 0.0


def _loses(loss: SceneLoss | None) -> bool:
    """Whether the transmission is as likely as not to lose much for the errors of the scene."""
    return loss is not None and loss.chance >= _LIKELY


def _bad_fit(capture: Capture) -> float:
    """Misfit ratio from which on the model does not explain a capture.

    Layers of little noise follow it less than two free values of every pixel could, which the ratio allows for: the
    fewer photographs there are, the larger it is where all is well.
    """
    k = len(capture.angles_deg)
    return _BAD_FIT if capture.samples is not None else _BAD_FIT * (k / (k - 2)) / (4 / (4 - 2))


def _far_apart(capture: Capture) -> bool:
    """Whether the photographs contradict each other by much of the polarized light that they show."""
    registered = capture.registered
    apart = closure_share(registered.intensities, registered.angles_deg, registered.mask)
    if not apart:
        return False
    light, *polarized = stokes_from_intensities(block_mean(registered.intensities, _BLOCK), registered.angles_deg)
    return apart**2 * float(np.mean(np.square(light))) > _APART**2 * float(np.square(polarized).sum(axis=0).mean())


def _found_polarized(scene: SceneParameters | None, estimate: SceneEstimate | None) -> bool:
    """Whether polarized light was found, not given."""
    return estimate is not None and scene is not None and scene.polarized


def _shift_is_doubtful(scene: SceneParameters | None, estimate: SceneEstimate | None, capture: Capture) -> bool:
    """Whether no double image of the reflection can be seen where it was given, or others are."""
    if scene is None or not scene.signal or scene.single_surface:
        return False
    if abs(scene.ghost_shift or 0.0) >= max(capture.shape[-2:]):
        return True
    # Other panes have other spectra.
    plain = scene.single_and_clear and not scene.varies and not scene.polarized
    return plain and estimate is not None and estimate.doubtful_shift


def _may_lie_across(scene: SceneParameters | None, estimate: SceneEstimate | None, capture: Capture) -> bool:
    """Whether one of two flat panes was taken in doubt; a rung above has more that tells them apart."""
    plain = scene is not None and not scene.varies and not scene.polarized
    if estimate is None or not plain:
        return False
    notable = NOTABLE_CHANCE if capture.cells is None else NOTABLE_CHANCE_OF_MOSAIC
    return estimate.better_left or estimate.axis_chance >= notable


def _of_geometry_and_noise(
    polarized: bool,
    reflection_unknown: float,
    noise_share: float,
    scene: SceneParameters | None,
    loses: bool,
    noise_hides: bool,
) -> dict[SeparationWarning, bool]:
    """Why the reflection, or the transmission, cannot be told: an incidence is no reason where both can."""
    incidence = None if scene is None or not polarized else scene.incidence_deg
    frontal = incidence is not None and incidence < _FRONTAL_DEG
    unseen, noisy = polarized and reflection_unknown > _UNKNOWN_REFLECTION, noise_share > _MUCH_NOISE
    # Where the pane is oblique enough noise alone can hide the reflection, or what a mosaic does not sample.
    hidden = (unseen and not frontal) or noisy
    return {
        SeparationWarning.NEAR_NORMAL: frontal and (unseen or noisy or loses),
        SeparationWarning.GRAZING: incidence is not None and incidence > _GRAZING_DEG and (noisy or loses),
        SeparationWarning.NOISE_TOO_HIGH: hidden and noise_hides,
        SeparationWarning.UNDERSAMPLED: hidden and not noise_hides,
    }


def _of_mistakes(mistakes: Mistakes) -> dict[SeparationWarning, bool]:
    return {
        SeparationWarning.ANGLES_SWAPPED: mistakes.swapped,
        SeparationWarning.MISALIGNED: mistakes.moved,
        SeparationWarning.GAMMA_ENCODED: mistakes.encoded,
    }


def _of_angles(mistake: AngleMistake | None) -> dict[SeparationWarning, bool]:
    return {
        SeparationWarning.ANGLES_REVERSED: mistake is AngleMistake.REVERSED,
        SeparationWarning.ANGLES_ROTATED: mistake is AngleMistake.ROTATED,
    }
