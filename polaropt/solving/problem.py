"""A capture with all that its solve needs: the pane, the canvas, what is known beforehand, the objective."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import Capture, NoiseClasses, NoiseModel, noise_classes
from polaropt.inversion import (
    Canvas,
    ClosedForm,
    FourierPreconditioner,
    canvas_for,
    filled,
    filled_by_layers,
    filled_smoothly,
    mosaic_layers,
    most_likely_layers,
    natural_image_layers,
    worth_filling,
)
from polaropt.optics import PSE, SceneParameters, VaryingPSE, engine_for, vertical_reach
from polaropt.solving.local_spectra import REACH_PX, Expectation, SeenSpectra, believed_share, expected_layers
from polaropt.solving.mosaic_pattern import firmness, mosaic_pattern
from polaropt.solving.objective import (
    Misfit,
    Penalties,
    Term,
    Weights,
    WhitenedObjective,
    build_objective,
    default_penalties,
    on_device,
    plugged_penalties,
)
from polaropt.solving.varying_information import VaryingInformation

if TYPE_CHECKING:
    from polaropt.solving.compiled import MisfitInPlace


FILLINGS = 2
"""Times that the closed form is repeated; a third hardly changes it."""
SLOW_IS_TOLD_DEG = 30.0
"""Incidence from which on slow changes of what a flat pane mirrors are told. Known panes before photographs that no
figure is taken of (45 random windows): beyond it both layers gain 0.04 and 0.03 dB, below they lose 0.01 and 0.03."""


Images = NDArray[np.float32]

# Share of a mosaic's samples that is free at least, where the layers could follow nearly all of them. Set by hand.
_LEAST_FREE = 0.1
# Share of the noise's misfit by which layers may explain less than the closed form's, before they are taken for spoilt.
# Those of networks that help lie 0.01 to 0.06 above it, reflections that are two fifths too dark 0.2 to 17 (two pairs
# of training photographs, 40 to 70 degrees, noise 0.5 and 2 %).
_SPOILT = 0.1
# Share of other layers in those that the spectra of windows follow from; of a mosaic's samples, which leave more to
# gain, it is all of them. On captures of training photographs behind panes at 40, 60 and 75 degrees, with grain and
# without, all of them loses up to 0.3 dB of the reflection on one capture at a noise of 0.5 %, half of them up to 0.1;
# at 2 % half gains 0.13 and 0.17 dB, all 0.15 and 0.21.
_SHARE_OF_OTHERS = 0.6
# Share of the closed form in how much of a mosaic's detail is said to be open; the rest is windows', which are too sure
# where it is too unsure. Of 90 simulated mosaics of both sensors (training photographs, 12 to 78 degrees, noise 0.1 to
# 2 %) the closed form says 0.06 too much, windows 0.05 too little, both with an rms error of 0.09; their mean errs by
# 0.01, rms 0.065.
_OF_FORM = 0.5
# Double images of a layer that are strong beside the first: a pane mirrors two.
_STRONG_GHOSTS = 2
# Rows that are simulated at a time: bounds the memory, changes nothing.
_STRIP_ROWS = 128


class Coordinates(Protocol):
    """An objective of a flat vector, with the way from layers to the vector and back."""

    @property
    def misfit(self) -> float:
        """Raw misfit at the last evaluation; infinite before the first."""

    def coordinates(self, layers: Images) -> Any:
        """Coordinates of canvas layers."""

    def value_and_grad(self, z: Any) -> tuple[float, Any]:
        """Value and gradient at coordinates z."""

    def solution(self, z: Any) -> tuple[Images, dict[str, Term]]:
        """Canvas layers at coordinates z, and raw value and weight of every term."""


@dataclass(frozen=True)
class Memory:
    """What a frame of a film leaves to the next one, behind a pane that stands still.

    Attributes
    ----------
    noise : float
        Typical one of its photographs.
    pse : PSE
    known : ClosedForm
        Without its layers.
    seen : SeenSpectra
    """

    noise: float
    pse: PSE
    known: ClosedForm
    seen: SeenSpectra
    found: Images | None = None
    """What the solve added to the layers that were expected, (2, channel, H, W)."""


class Problem:
    """One separation to be solved.

    Parameters
    ----------
    capture : Capture
    scene : SceneParameters
        A complete scene.
    noise : float
    weights : Weights
    robust : bool
        Residuals beyond 3 sigma count linearly.
    center : (float, float), optional
        Column and row of the camera's principal point. Default: the middle of the frame.
    growth : NoiseModel, optional
        How the noise grows with the light. Default: it is the same everywhere.
    engine : PSE or VaryingPSE, optional
        What makes photographs of layers. Default: the engine that the scene needs.
    memory : Memory, optional
        Of a frame before, behind the same pane and of the same size.
    remember : bool
        Whether `memory` is to be told.
    """

    def __init__(
        self,
        capture: Capture,
        scene: SceneParameters,
        noise: float,
        weights: Weights,
        robust: bool = False,
        center: tuple[float, float] | None = None,
        *,
        growth: NoiseModel | None = None,
        engine: PSE | VaryingPSE | None = None,
        memory: Memory | None = None,
        remember: bool = False,
    ) -> None:
        classes = None if growth is None else noise_classes(capture, growth)
        self.noise = noise if classes is None else classes.typical
        self.remember = remember
        if memory is not None:
            # What was fitted is of its noise, and the typical one of a film hardly changes.
            self.noise, engine = memory.noise, memory.pse
        self._memory = memory
        self.mean_noise = noise
        self.pixel_noise: float | NoiseClasses = noise if classes is None else classes
        self.capture, self.scene = capture, scene
        # What is compared with the layers: of a mosaic the samples alone, once `known` was asked for without the light
        # that no pane explains, and the misfit that this has.
        self.observed, self._unexplained = capture.observed, 0.0
        self.weights, self.robust = weights, robust
        self.pse = engine or engine_for(scene, capture.angles_deg, self.noise, capture.shape[-2:], center)
        period = 1 if capture.samples is None else capture.samples.sampling.period
        self.canvas: Canvas = canvas_for(self.pse, capture.shape[-2], capture.shape[-1], period)

    @cached_property
    def known(self) -> ClosedForm:
        """The closed form, when first asked for; of a pane that varies with the layers that are most likely."""
        known = self.closed_form()
        if not isinstance(self.pse, PSE):
            told = self._told_of_stokes(self.pse)
            known = most_likely_layers(known, self.canvas, self.pse, told, partial(_slope, self._squares))
        return known if self.capture.samples is None else self._without_pattern(known)

    def _without_pattern(self, known: ClosedForm) -> ClosedForm:
        """What is known without detail that stands for light which no pane explains: it is taken out of the samples."""
        pattern = np.zeros_like(known.layers)
        self.canvas.crop(pattern)[...] = mosaic_pattern(self.canvas.crop(known.layers), self._alternations)
        light = self._photographed(pattern).reshape(self.observed.intensities.shape)
        self.observed = self.observed.replace(intensities=self.observed.intensities - light)
        self._unexplained = 0.5 * float(np.square(light / np.float32(self.noise)).sum(where=self.observed.valid))
        # Made of the samples as they were.
        for made in ("_misfit", "_squares"):
            self.__dict__.pop(made, None)
        return replace(known, layers=known.layers - pattern)

    @cached_property
    def expected(self) -> Expectation | None:
        """What the layers are expected to be in each place; None where windows cannot tell. From the closed form."""
        if not self.fits_windows:
            return None
        found = self._expected_layers()
        if found is None or isinstance(self.pse, PSE):
            return found
        # A pane may change much within a window, as near grazing incidence.
        return found if self._explained(found, self.known.layers) else None

    def best_known(self) -> Images:
        """Layers on the canvas (2, channel, H, W): what is expected of windows where these tell, else closed form."""
        return self.known.layers if self.expected is None else self.expected.in_colors(self.known.basis)

    def expect_around(self, layers: Images) -> None:
        """Let the spectra of windows follow from other layers at hand (2, channel, H, W).

        Of photographs the layers that were expected before count as well. Where windows tell nothing, or where what is
        expected then explains the photographs clearly less, nothing changes.
        """
        if self.expected is None:
            return
        if self.capture.samples is None:
            share = np.float32(_SHARE_OF_OTHERS)
            layers = share * layers + (1 - share) * self.best_known()
        around = self._expected_layers(layers)
        if around is not None and self._explained(around, self.expected.in_colors(self.known.basis)):
            self.expected = around

    def _explained(self, expected: Expectation, layers: Images) -> bool:
        """Whether what is expected explains the photographs not clearly less than canvas layers do."""
        enough = self._misfit_of(layers)
        if self.capture.samples is not None:
            # Two layers can follow nearly all samples, noise and all: the true ones leave more.
            enough = max(enough, self.misfit_of_noise)
        return self._misfit_of(expected.in_colors(self.known.basis)) <= enough + _SPOILT * self.misfit_of_noise

    def slope_of_misfit(self, layers: Images) -> Images:
        """Gradient of the photographs' misfit at canvas layers."""
        return _slope(self._misfit, layers)

    def _misfit_of(self, layers: Images) -> float:
        return self._misfit.value_and_grad(layers, np.empty_like(layers))

    @cached_property
    def penalties(self) -> Penalties:
        """The priors of the objective. Error maps, which solve nothing, do without them."""
        mosaic = self.capture.samples is not None
        # Windows of a mosaic's samples are too sure of what they expect to be left where they are.
        slope = None if mosaic or self.expected is None else self.slope_of_misfit(self.best_known())
        penalties = default_penalties(self.known, self.mean_noise, mosaic, self.expected, slope)
        others = {**penalties.others, **plugged_penalties(self.weights, self.known, self.mean_noise)}
        if mosaic:
            natural = penalties.natural_image
            stiffness = natural.stiffness * firmness(*self.canvas.shape, self._alternations)
            penalties = replace(penalties, natural_image=replace(natural, stiffness=stiffness))
        return replace(penalties, others=others)

    @property
    def memory(self) -> Memory | None:
        """What the next frame may begin with, before the closed form's layers are given up.

        None where nothing is expected of windows, and for samples of a mosaic, whose spectra are each frame's own.
        """
        seen = None if not self.remember or self.expected is None else self.expected.seen
        if seen is None or not isinstance(self.pse, PSE) or self.capture.samples is not None:
            return None
        known = replace(self.known, layers=np.empty(0, dtype=np.float32))
        return Memory(self.noise, self.pse, known, seen)

    @property
    def found_before(self) -> Images | None:
        """What the solve of the frame before added to what was expected, where this one shows the same."""
        still = self._memory is not None and self.expected is not None and self.expected.still
        return self._memory.found if still and self._memory is not None else None

    def derive_priors(self) -> None:
        """Derive what follows from the closed form's layers, before these are given up."""
        self.penalties = self.penalties

    def give_up_expected(self) -> None:
        """Give up the layers that were expected and the priors, which a compiled objective has taken over."""
        self.__dict__.pop("penalties", None)
        if self.expected is not None:
            nothing = np.empty(0, dtype=np.float32)
            self.expected = replace(self.expected, layers=nothing, variance=nothing)

    def closed_form(self) -> ClosedForm:
        """The closed form, of a pane that varies by filters of places: what scenes are compared by."""
        if not worth_filling(self.capture):
            return self._closed_form_of(self.capture)
        # From smooth values on: what a closed form finds of its own filling it hardly changes.
        smooth = filled_smoothly(self.capture) if self.capture.samples is not None else self._filled_by_layers()
        known = self._closed_form_of(smooth)
        for _ in range(FILLINGS):
            known = self._closed_form_of(filled(self.capture, self._photographed(known.layers)))
        return known

    def _filled_by_layers(self) -> Capture:
        """Photographs with what smooth layers behind the pane would give where their own cannot be trusted."""
        ones = np.ones((2, 1, *self.canvas.shape), np.float32)
        parts = [strip.components for strip in component_strips(self.pse, self.canvas, ones)]
        of_transmission, of_reflection = np.concatenate(parts, axis=-2)
        return filled_by_layers(self.capture, of_transmission, of_reflection, self.noise)

    @property
    def fits_windows(self) -> bool:
        """Whether layers can be expected of windows, and of photographs at all.

        Ghosts that lie farther apart than windows overlap look like other places.
        """
        shifts = (self.scene.ghost_shift, self.scene.transmission_ghost_shift, self.scene.gap_shift)
        near = all(abs(shift or 0.0) <= REACH_PX for shift in shifts)
        return near and self.weights.factor("misfit") > 0

    def _expected_layers(self, layers: Images | None = None) -> Expectation | None:
        of_noise = self._precision_of_noise()
        share = None if of_noise is None else believed_share(of_noise)

        def believed_slope(layers: Images) -> Images:
            slope = self.slope_of_misfit(layers)
            if share is not None:
                self.canvas.crop(slope)[...] *= share
            return slope

        return expected_layers(
            self.known,
            self.canvas,
            believed_slope,
            self._mean_precision(None if of_noise is None or share is None else of_noise * share),
            layers,
            sampled=self.capture.samples is not None,
            varying=self._varying_information(),
            fast_alone=self.slow_is_known,
            before=None if self._memory is None or layers is not None else self._memory.seen,
            remember=self.remember,
        )

    @property
    def slow_is_known(self) -> bool:
        """Whether the closed form tells what is slow so well that windows are shown what is fast alone.

        Not where much was filled in.
        """
        if not isinstance(self.pse, PSE):
            return True
        oblique = self.scene.values()[0] > SLOW_IS_TOLD_DEG
        return oblique and self.capture.samples is None and not worth_filling(self.capture)

    def _varying_information(self) -> VaryingInformation | None:
        if isinstance(self.pse, PSE):
            return None
        return VaryingInformation(self.pse, self.canvas, self._told_of_stokes(self.pse))

    def _told_of_stokes(self, pse: VaryingPSE) -> NDArray[np.float64]:
        """What a pixel tells of its Stokes vector: an inverse covariance (3, 3), of samples a mean."""
        return np.asarray(pse.analyzer.T @ pse.analyzer * (self._sampled_share / self.noise**2))

    @property
    def _alternations(self) -> tuple[tuple[float, float], ...]:
        """By which a mosaic samples polarized light alternately; none of photographs."""
        samples = self.capture.samples
        return () if samples is None else samples.sampling.alternations(self.capture.angles_deg)

    @property
    def _sampled_share(self) -> float:
        """Of a mosaic's values in a pixel the share that is sampled; all of photographs."""
        samples = self.capture.samples
        return 1.0 if samples is None else 1 / (len(self.capture.angles_deg) * samples.sampling.n_channels)

    def believed_share(self) -> Images | None:
        """Share of what pixels tell (channel, h, w) that windows are shown; None for all of it."""
        of_noise = self._precision_of_noise()
        return None if of_noise is None else believed_share(of_noise)

    def _precision_of_noise(self) -> Images | None:
        """What pixels tell (channel, h, w) beside what the closed form takes for it; None where it is that."""
        if not isinstance(self.pixel_noise, NoiseClasses):
            return None
        return np.asarray(np.square(np.float32(self.noise) / self.pixel_noise.images()))

    def _mean_precision(self, of_pixels: Images | None) -> Images:
        """What a pixel's photographs tell together, (h, w), given what each does (channel, h, w) where it is valid."""
        valid = self.observed.valid
        weight = valid.reshape(len(valid), -1, *valid.shape[-2:]).astype(np.float32)
        if of_pixels is not None:
            weight *= of_pixels
        # Of a mosaic each pixel has one of all values, which the closed form knows.
        told = np.asarray(weight.mean(axis=(0, 1)) / np.float32(self._sampled_share))
        return told if valid.all() else self._told_by_ghosts(told)

    def _told_by_ghosts(self, told: Images) -> Images:
        """The same (h, w), no less than where a strong double image of a pixel is seen.

        Where a pixel itself is not, steps that took it for untold would overshoot, the more with each turn.
        """
        from scipy.ndimage import shift

        height, width = told.shape
        pse = self.pse
        places = pse.displacements if isinstance(pse, PSE) else pse.displacements(height, width)
        most = told
        steps = {(-round(down), -round(across)) for across, down in places[1 : 1 + _STRONG_GHOSTS]}
        for step in steps - {(0, 0)}:
            most = np.maximum(most, shift(told, step, order=0, mode="nearest", prefilter=False))
        return most

    def _photographed(self, layers: Images) -> Images:
        """Photographs (k, channel, h, w) of canvas layers."""
        return np.asarray(self.canvas.crop(self._on_canvas().forward(layers)))

    def _closed_form_of(self, capture: Capture) -> ClosedForm:
        if isinstance(self.pse, PSE):
            if capture.samples is not None:
                return mosaic_layers(capture, self.pse, self.canvas, self.noise)
            before = None if self._memory is None else self._memory.known
            return natural_image_layers(capture, self.pse, self.canvas, self.noise, before)
        from polaropt.inversion import ghost_layers, varying_layers

        varying = ghost_layers if self.scene.has_ghosts else varying_layers
        known = varying(capture, self.pse, self.canvas, self.noise)
        if capture.samples is None:
            return known
        # Of photographs interpolated between the samples: a start, of which the samples alone are told.
        return known.thinned(1 / (len(capture.angles_deg) * capture.samples.sampling.n_channels))

    def compiled(self, start: Images) -> Coordinates:
        """The objective in compiled passes, in coordinates made for `start` (2, channel, H, W)."""
        from polaropt.solving.compiled import FusedObjective

        return FusedObjective(self._misfit, self.penalties, self.weights, self.known, self.canvas, start)

    @cached_property
    def _misfit(self) -> MisfitInPlace:
        """The misfit in compiled passes."""
        from polaropt.solving.compiled import ReadableMisfit

        if self.robust:
            return ReadableMisfit(Misfit(self.observed, self._on_canvas(), self.canvas, self.pixel_noise, robust=True))
        return self._squares

    @cached_property
    def _squares(self) -> MisfitInPlace:
        """The same of residuals that all count by their squares, as closed forms have it."""
        from polaropt.solving.compiled import FusedGhostMisfit, FusedMisfit, FusedVaryingMisfit

        if isinstance(self.pse, PSE):
            return FusedMisfit(self.observed, self.pse, self.canvas, self.pixel_noise)
        varying = FusedGhostMisfit if self.scene.has_ghosts else FusedVaryingMisfit
        return varying(self.observed, self.pse, self.canvas, self.pixel_noise)

    def _on_canvas(self) -> PSE | VaryingPSE:
        """The engine for images of the canvas's size."""
        if isinstance(self.pse, PSE):
            return self.pse
        canvas = self.canvas
        return self.pse.moved(canvas.left, canvas.top, canvas.height, canvas.width)

    def readable(self, start: Images, device: str | None = None) -> Coordinates:
        """The same in its readable form, on numpy arrays or on torch tensors of a device."""
        from polaropt.solving.compiled import FusedPenalties, assumed_hessian

        place = np.asarray if device is None else on_device(device)
        misfit = Misfit(self.observed, self._on_canvas(), self.canvas, self.pixel_noise, self.robust, place)
        objective = build_objective(misfit, self.penalties.placed(place), self.canvas, self.weights)
        known, natural = self.known, self.penalties.natural_image
        local = FusedPenalties(self.penalties, self.canvas, start.shape[1])
        hessian = assumed_hessian(local, natural, self.weights, known, start)
        whitened = FourierPreconditioner(hessian, natural.mean, known.basis, self.canvas.shape[1], place)
        return WhitenedObjective(objective, whitened, place)

    @property
    def n_bounces(self) -> int | None:
        """Bounces that the engine keeps apart; None where all lie on each other."""
        if not self.scene.has_ghosts:
            return None
        if self.scene.n_bounces is not None:
            return self.scene.n_bounces
        return self.pse.n_ghosts if isinstance(self.pse, PSE) else self.pse.n_ghosts(*self.capture.shape[-2:])

    def unknown_detail(self) -> float:
        """Share of the reflection's detail, what is finer than about 5 px, that remains open, 0..1."""
        if self.expected is None:
            return self._unknown_by_form()
        layers = self.expected.in_colors(self.known.basis)
        by_windows = self.expected.unknown_detail(self.canvas.crop(layers[1]), self.canvas.shape[1])
        if self.capture.samples is None:
            return by_windows
        return _OF_FORM * self._unknown_by_form() + (1 - _OF_FORM) * by_windows

    def _unknown_by_form(self) -> float:
        """The same as the closed form has it."""
        return self.known.sampled.unknown_detail(self.canvas.crop(self.known.layers[1]))

    @property
    def misfit_of_noise(self) -> float:
        """Misfit that the true layers have: half of one per trusted value."""
        return 0.5 * float(np.count_nonzero(self.observed.valid))

    def misfit_ratio(self, misfit: float) -> float:
        """Mean squared residual in units of the noise, less what the unknowns take up."""
        k, n = len(self.capture.angles_deg), np.count_nonzero(self.observed.valid)
        if self.capture.samples is None:
            return 2 * misfit / max(1.0, n * (k - 2) / k)
        # Two layers have more values than a mosaic has samples: what counts is what these tell of them.
        told = self.known.sampled.told_share()
        free = max(1.0, _LEAST_FREE * n, n - told * self.canvas.height * self.canvas.width)
        return 2 * (misfit + self._unexplained) / free


def _slope(misfit: MisfitInPlace, layers: Images) -> Images:
    """Gradient of a misfit at canvas layers."""
    slope = np.empty_like(layers)
    misfit.value_and_grad(layers, slope)
    return slope


@dataclass(frozen=True)
class ComponentStrip:
    """Some rows of the frame, and what each layer adds to the photographs there, (2, k, channel, rows, w)."""

    rows: slice
    components: Images


def component_strips(pse: PSE | VaryingPSE, canvas: Canvas, layers: Images) -> Iterator[ComponentStrip]:
    """The parts of the photographs that come from each layer of the canvas, some rows at a time.

    The engine holds several times its input, and the weights of all ghosts in every pixel are much memory.
    """
    height, width = canvas.shape
    varying = pse.moved(canvas.left, canvas.top, height, width) if isinstance(pse, VaryingPSE) else None
    reach = vertical_reach(pse, height, width)
    step = max(_STRIP_ROWS, reach)
    for top in range(0, height, step):
        first, stop = max(canvas.top, top), min(canvas.top + canvas.height, top + step)
        if first >= stop:
            continue
        above, below = max(0, top - reach), min(height, top + step + reach)
        engine = pse if varying is None else varying.moved(0, -above, height, width)
        part = engine.components(layers[..., above:below, :])
        inside = part[..., first - above : stop - above, canvas.left : canvas.left + canvas.width]
        yield ComponentStrip(slice(first - canvas.top, stop - canvas.top), inside)
