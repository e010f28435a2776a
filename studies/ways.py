"""The ways to separate that studies compare: one list.

`Way` is polaropt with its settings, or another method by its name; it is plain values, so that a job can hold it.
Around the `DEFAULT` of `separate`, read from its signature, stand every rung of the scene model, solver, start and
tolerance (`RUNGS`, `one_at_a_time`, `crossed`). `METHODS` are all others, from the plain intensity to published ones,
each given what suits it best, and what that is; `MOSAIC_METHODS` are what others do with a raw mosaic, which is to
interpolate it first. `PARTS` are polaropt without one of its parts.
"""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from inspect import signature
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.capture import ANGLES_DEG, Capture, Origin, noise_level
from polaropt.estimation import find_scene, model_names
from polaropt.optics import PSE, SceneParameters, engine_for
from polaropt.separation import Separation, separate
from polaropt.solving import (
    Coordinates,
    Misfit,
    Problem,
    Weights,
    build_objective,
    check_start,
    initializers,
    start_names,
    take_start,
)
from solvers.base import SolverResult, StoppingRule
from solvers.registry import get_solver, solver_names
from studies.camera import Sample, read_again
from studies.mosaic.demosaicking import LENS_BLUR_PX, bilinear, trained
from studies.peers import single_image
from studies.peers.multiscale import separate_in_scales
from studies.peers.semireflector import correlation, mutual_information, separate_by
from studies.photographs import SHIPPED
from studies.scenes import BLIND
from studies.scores import fitted

Images = NDArray[np.float32]
Layers = tuple[Images, Images | None]
"""Transmission and reflection (channel, h, w); None is not shown."""

FULL, CLOSED_FORM, NETWORKS = "full solve", "closed form alone", "PolarNet and FusionNet alone"
PLAIN, MINIMUM, COMPONENTS = "plain intensity", "minimum over angles", "FastICA"
NOTHING = "nothing"
"""What a method is given of the truth."""
KNOWN = "the scene told"
"""In the place of a rung: the true scene is given. No photographer has it."""
COLD, LEARNED = "cold", "learned"
CLOSED_FORM_START = "closed-form"
SMALL_ONLY = ("casadi",)
"""Solvers that take at most 100 000 unknowns, and a minute for them."""
TOLERANCE_FACTORS = (1.0, 10.0, 0.1)
SENSOR, CELL, BILINEAR, LMMSE = "sensor", "cell", "bilinear", "LMMSE"
"""How a raw mosaic is read: at a resolution of `read_capture`, or interpolated to four full photographs."""
GPU = "cuda"
"""Device of the solver torch."""


class NotRun(Exception):
    """A method that is not there; says why."""


@dataclass(frozen=True)
class Way:
    """One way to separate.

    Attributes
    ----------
    method : str
        The full solve, which the other fields describe, or a name of `METHODS`.
    solver, start, rung : str
        As `separate` takes them (`solver`, `init`, `model`); `KNOWN` in the place of a rung.
    relative_change : float
        Of the stopping rule.
    max_evaluations : int
        Of the stopping rule; 1: the start alone.
    resolution : str
        How a raw mosaic is read; without meaning for four photographs.
    device : str
        Of the solver torch; empty: the processor.
    """

    method: str = FULL
    solver: str = ""
    start: str = ""
    rung: str = ""
    relative_change: float = 0.0
    max_evaluations: int = 0
    resolution: str = ""
    device: str = ""

    @property
    def ours(self) -> bool:
        """Whether it is the full solve."""
        return self.method == FULL

    @property
    def stopping(self) -> StoppingRule:
        """The default stopping rule at this tolerance and with so many evaluations."""
        return replace(_STOPPING, relative_change=self.relative_change, max_evaluations=self.max_evaluations)

    @property
    def blind(self) -> bool:
        """Whether nothing of the truth is given."""
        return self.rung != KNOWN if self.ours else method_of(self).given == NOTHING

    @property
    def factor(self) -> str:
        """The one setting that is not the default; empty for the default, and for several."""
        changed = self._changed()
        return "method" if not self.ours else changed[0] if len(changed) == 1 else ""

    @property
    def label(self) -> str:
        """In a few words, what is not as by default."""
        if not self.ours:
            return self.method
        words = {name: str(getattr(self, name)) for name in ("solver", "start", "rung", "resolution", "device")}
        words["tolerance"] = f"{self.relative_change:.0e}".replace("e-0", "e-")
        return (
            ", ".join(KNOWN if words[name] == KNOWN else f"{name} {words[name]}" for name in self._changed())
            or "default"
        )

    def _changed(self) -> list[str]:
        names = {"relative_change": "tolerance"}
        settings = ("solver", "start", "rung", "relative_change", "resolution", "device")
        return [names.get(name, name) for name in settings if getattr(self, name) != getattr(DEFAULT, name)]

    def separation(self, sample: Sample) -> Separation:
        """All that the full solve gives, as a user has it, of what was read at its resolution."""
        known = self.rung == KNOWN
        return separate(
            sample.capture,
            sample.scene if known else sample.hint,
            self.solver,
            self.start,
            stopping=self.stopping,
            model=DEFAULT.rung if known else self.rung,
            device=self.device or None,
        )

    def layers(self, sample: Sample) -> Layers:
        """Both layers, as far as it shows them; raises `NotRun` where the method is not there."""
        if not self.ours:
            return method_of(self).run(sample)
        transmission, reflection = self.separation(sample).layers
        return transmission, reflection


_SEPARATE = {name: parameter.default for name, parameter in signature(separate).parameters.items()}
_STOPPING: StoppingRule = _SEPARATE["stopping"]
DEFAULT = Way(
    FULL,
    _SEPARATE["solver"],
    _SEPARATE["init"],
    _SEPARATE["model"],
    _STOPPING.relative_change,
    _STOPPING.max_evaluations,
    SENSOR,
)
"""What `separate` does when it is asked for nothing."""
WITH_SCENE = replace(DEFAULT, rung=KNOWN)
"""The same with the true scene given."""
AT_CELLS = replace(DEFAULT, resolution=CELL)
"""The same with one pixel for each pattern of a raw mosaic."""
RUNGS = {name: replace(DEFAULT, rung=name) for name in model_names() if name != "none"}
"""Every scene model, "auto" at their head; its "none" is the plain intensity, a method of its own."""


def alone(way: Way) -> Way:
    """A way's start, before any solve."""
    return replace(way, max_evaluations=1)


def starts() -> tuple[str, ...]:
    """Starts that are installed and know of double images."""
    return tuple(start.name for start in initializers() if start.installed and start.name != "per-pixel")


def weights_digest() -> str:
    """First digits of the digest of the learned start's weights: rows of other weights are no rows of this run."""
    if LEARNED not in starts():
        return "none"
    from priors.learned import WEIGHTS

    record = json.loads((WEIGHTS / "conditioned.json").read_text(encoding="utf-8"))
    return str(record["sha256"])[:12]


def seen_in_training(photos: str | None, data: str | None = None) -> str:
    """Why networks are not judged on a folder's photographs (None: those inside scikit-image), or nothing.

    `data` is what their record says they were trained on; default: that of the learned start.
    """
    from priors.learned import WEIGHTS

    if data is None:
        data = str(json.loads((WEIGHTS / "conditioned.json").read_text(encoding="utf-8"))["data"])
    seen = [name for name in SHIPPED if name in data] if photos is None else []
    return f"its networks were trained on {', '.join(seen)}; name others with --photos" if seen else ""


def judged_starts(photos: str | None) -> tuple[str, ...]:
    """`starts` less the learned one, where its networks were trained on these photographs."""
    return tuple(start for start in starts() if start != LEARNED or not seen_in_training(photos))


def tolerances() -> tuple[float, ...]:
    """The default relative change, a coarser and a finer one."""
    return tuple(float(f"{factor * DEFAULT.relative_change:.3g}") for factor in TOLERANCE_FACTORS)


def one_at_a_time(mosaic: bool = False) -> tuple[Way, ...]:
    """The default, and all ways that differ from it in one setting, of a raw mosaic in its resolution, too."""
    ways = [
        DEFAULT,
        *(replace(DEFAULT, solver=name) for name in solver_names()),
        *(replace(DEFAULT, start=name) for name in start_names()),
        *(*RUNGS.values(), WITH_SCENE),
        *(replace(DEFAULT, relative_change=value) for value in tolerances()),
        *((AT_CELLS,) if mosaic else ()),
    ]
    return tuple(dict.fromkeys(ways))


def solves(mosaic: bool = False) -> tuple[Way, ...]:
    """The default and all other solves of the scene that it finds, and what there is before any: for large images."""
    named = [way for way in one_at_a_time(mosaic) if way.factor != "rung" and way.solver not in SMALL_ONLY]
    return (*named, Way(NETWORKS), Way(CLOSED_FORM))


def solvers(mosaic: bool = False) -> tuple[Way, ...]:
    """Of these the default, its start and the other solvers: for the largest images."""
    return tuple(
        way for way in solves(mosaic) if way.factor in ("", "solver", "resolution") or way.method == CLOSED_FORM
    )


def crossed(relative_changes: Sequence[float]) -> tuple[Way, ...]:
    """Every solver that takes photographs of 256x256 pixels with every start, rung and these tolerances."""
    solvers = (name for name in solver_names() if name not in SMALL_ONLY)
    return tuple(
        replace(DEFAULT, solver=solver, start=start, rung=rung, relative_change=change)
        for solver, start, rung, change in product(solvers, start_names(), RUNGS, relative_changes)
    )


def other_methods(mosaic: bool = False) -> tuple[Way, ...]:
    """What is not the full solve, from the plain intensity to the closed form alone; of a raw mosaic what suits it."""
    names = (*MOSAIC_METHODS, NETWORKS, CLOSED_FORM) if mosaic else METHODS
    return tuple(Way(name) for name in names if name != FULL)


def method_of(way: Way) -> Method:
    """What is not the full solve, by its name."""
    return METHODS.get(way.method) or MOSAIC_METHODS[way.method]


# Methods.


@dataclass(frozen=True)
class Method:
    """A method, the full solve among them.

    Attributes
    ----------
    name : str
    run : callable
        From a sample to layers; raises `NotRun`.
    given : str
        What of the truth it is given.
    source : str
        Where it was published.
    ours : bool
        Whether it is a part of this project.
    scaleless : bool
        Whether its layers have no scale of their own, so that they are given the best.
    resolution : str
        How a raw mosaic is read for it.
    way : Way or None
        The full solve that it is, cut short or of other photographs.
    """

    name: str
    run: Callable[[Sample], Layers] = field(repr=False)
    given: str = NOTHING
    source: str = ""
    ours: bool = False
    scaleless: bool = False
    resolution: str = SENSOR
    way: Way | None = None


def plain_intensity(sample: Sample) -> Layers:
    """The intensity as transmission, and no reflection: what doing nothing shows."""
    return sample.capture.stokes[0], None


def minimum_over_angles(sample: Sample) -> Layers:
    """Twice the darkest that any polarizer angle would show, and what is brighter as reflection."""
    s0, s1, s2 = sample.capture.stokes
    polarized = np.hypot(s1, s2)
    return s0 - polarized, 2 * polarized


def independent_components(sample: Sample) -> Layers:
    """Two independent components of the photographs, all colours together.

    As these know neither their order nor sign, scale and offset, all four are taken from the true layers, which is more
    than any method could know.
    """
    from sklearn.decomposition import FastICA

    capture = sample.capture
    samples = capture.intensities.reshape(len(capture.angles_deg), -1).T.astype(np.float64)
    with warnings.catch_warnings():
        # Where it does not converge its last step is what it has to say.
        warnings.simplefilter("ignore")
        sources = FastICA(2, whiten="unit-variance", random_state=0, max_iter=200).fit_transform(samples)
    components = np.asarray(sources.T, dtype=np.float32).reshape(2, *capture.shape)
    fits = [np.stack([_on_line(part, layer) for layer, part in zip(sample.layers, order, strict=True)])
            for order in (components, components[::-1])]  # fmt: skip
    best = min(fits, key=lambda layers: float(np.square(layers - sample.layers).mean()))
    return best[0], best[1]


def _on_line(component: Images, layer: Images) -> Images:
    slope, offset = np.polyfit(component.ravel(), layer.ravel(), 1)
    return np.asarray(slope * component + offset, dtype=np.float32)


def _by(criterion: Callable[[Images, Images], float], sample: Sample) -> Layers:
    _, azimuth, _ = sample.scene.values()
    transmission, reflection = separate_by(criterion, sample.capture, azimuth, sample.scene.index)
    return transmission, reflection


def _in_scales(sample: Sample) -> Layers:
    _, azimuth, _ = sample.scene.values()
    transmission, reflection = separate_in_scales(sample.capture, azimuth, sample.scene.index)
    return transmission, reflection


def _single_image(sample: Sample) -> Layers:
    """The strength and scale that suit the true transmission best."""
    if not single_image.built():
        raise NotRun("run `make peers` first")
    truth = sample.layers[0]
    tried = [fitted(transmission, truth) for transmission in single_image.suppressed(sample.capture)]
    return min(tried, key=lambda image: float(np.square(image - truth).mean())), None


def _networks(sample: Sample) -> Layers:
    """What the learned start gives, before any solve."""
    if LEARNED not in start_names():
        raise NotRun("there are no trained weights yet")
    return alone(replace(DEFAULT, start=LEARNED)).layers(replace(sample, hint=BLIND))


def _blind(way: Way, sample: Sample) -> Layers:
    """Nothing is given, whatever the scene would give."""
    return way.layers(replace(sample, hint=BLIND))


_METHODS: Sequence[Method] = (
    Method(PLAIN, plain_intensity),
    Method(MINIMUM, minimum_over_angles),
    Method(
        COMPONENTS,
        independent_components,
        given="order, sign, gain and offset of its components",
        source="Farid & Adelson, CVPR 1999; FastICA of scikit-learn on the four photographs",
        scaleless=True,
    ),
    Method(
        "least correlation",
        partial(_by, correlation),
        given="azimuth, refractive index",
        source="Schechner, Shamir, Kiryati, Optics Letters 1999",
    ),
    Method(
        "least mutual information",
        partial(_by, mutual_information),
        given="azimuth, refractive index",
        source="Schechner, Shamir, Kiryati, JOSA A 2000",
    ),
    Method(
        "multiscale physical",
        _in_scales,
        given="azimuth to 45 degrees, refractive index",
        source="Kong, Tai, Shin, IEEE TPAMI 2014, written anew (studies/peers/multiscale.py says what is not known)",
    ),
    Method(
        "single image",
        _single_image,
        given="the best of four strengths, gain and offset",
        source="Yang et al., CVPR 2019; package fast-reflection-removal",
        scaleless=True,
    ),
    Method(NETWORKS, _networks, ours=True, way=alone(replace(DEFAULT, start=LEARNED))),
    Method(CLOSED_FORM, partial(_blind, alone(DEFAULT)), ours=True, way=alone(DEFAULT)),
    Method(FULL, partial(_blind, DEFAULT), ours=True),
)
METHODS = {method.name: method for method in _METHODS}
"""From the plain intensity to the full solve."""


# Raw mosaics, interpolated first.


def read_mosaic(sample: Sample, resolution: str) -> Sample:
    """A raw mosaic as it is read, or interpolated to four full photographs; these are as they are."""
    samples, origin = sample.capture.samples, sample.capture.origin
    if resolution not in (BILINEAR, LMMSE) or samples is None or origin is None:
        return read_again(sample, resolution)
    color = sample.capture.color
    if resolution == BILINEAR:
        return replace(sample, capture=Capture.of_planes(bilinear(samples.values, color), ANGLES_DEG))
    # Beside edges they swing below black. They are Stokes vectors, so that nothing in them tells the noise.
    photographs = np.maximum(trained(color, LENS_BLUR_PX).interpolate(samples.values, origin.raw_noise or 0), 0)
    told = Origin(raw_noise=origin.raw_noise)
    return replace(sample, capture=Capture.of_planes(photographs, ANGLES_DEG, origin=told))


def _mosaic_methods() -> Iterator[Method]:
    for name in (PLAIN, MINIMUM, "least correlation", "least mutual information"):
        yield replace(METHODS[name], name=f"{BILINEAR}, {name}", resolution=BILINEAR)
    per_pixel = alone(replace(DEFAULT, start="per-pixel"))
    for resolution in (BILINEAR, LMMSE):
        for name, way in (("per pixel", per_pixel), ("full solve", DEFAULT)):
            way = replace(way, resolution=resolution)
            yield Method(f"{resolution}, {name}", way.layers, resolution=resolution, way=way)


MOSAIC_METHODS = {method.name: method for method in _mosaic_methods()}
"""What there is without a model of the mosaic; "per pixel" finds the scene as polaropt does and inverts each pixel.

LMMSE is trained on the photographs inside scikit-image, and is to be judged on others.
"""
TRAINED_ON_SHIPPED = tuple(name for name in MOSAIC_METHODS if name.startswith(LMMSE))


# Parts left out.

WHOLE = "nothing"
FIXED_NOISE = 0.01
"""Where the noise is not measured, this is taken for it: twice what the protocol has (white = 1)."""
_TO_THE_END = StoppingRule(max_evaluations=500)


@dataclass(frozen=True)
class Solved:
    """Layers on the frame (2, channel, h, w), and how the solver ended."""

    layers: Images
    solver: SolverResult


@dataclass(frozen=True)
class Part:
    """One part left out, or one put in that is not there by default.

    Attributes
    ----------
    name : str
        What is left out, or put in.
    instead : str
        What stands in its place, or what it stands for.
    weights : Weights
    scene : callable
        From the scene that was estimated and the true one to the one that is solved with.
    hint : SceneParameters
        What is given of the scene before it is estimated.
    noise : float or None
        Taken for the noise; None: measured.
    init : str
    prepared : callable
        From capture, scene, noise and weights to the problem.
    coordinates : callable
        From problem, weights and start to the objective.
    added : bool
        Whether the part is put in.
    """

    name: str
    instead: str
    weights: Weights = Weights()  # noqa: RUF009 (frozen)
    scene: Callable[[SceneParameters, SceneParameters], SceneParameters] = lambda estimate, true: estimate
    hint: SceneParameters = BLIND
    noise: float | None = None
    init: str = CLOSED_FORM_START
    prepared: Callable[..., Problem] = Problem
    coordinates: Callable[[Problem, Weights, Images], Coordinates] = lambda problem, weights, start: problem.compiled(
        start
    )
    added: bool = False

    @property
    def change(self) -> str:
        """In a few words, what was done."""
        if self.name == WHOLE:
            return "the whole"
        return f"{'with' if self.added else 'without'} {self.name}"

    def estimate(self, capture: Capture, noise: float) -> SceneParameters:
        """The scene as it is estimated."""
        return find_scene(capture, self.hint, noise).scene

    def solved(self, capture: Capture, estimate: SceneParameters, true: SceneParameters) -> Solved:
        """Layers of a capture whose scene was estimated; InputError where the start lacks a package."""
        check_start(self.init)
        noise = noise_level(capture) if self.noise is None else self.noise
        problem = self.prepared(capture, self.scene(estimate, true), noise, self.weights)
        start = take_start(problem, self.init)
        objective = self.coordinates(problem, self.weights, start)
        z = objective.coordinates(start)
        result = get_solver(DEFAULT.solver).minimize(objective.value_and_grad, z, _TO_THE_END)
        layers, _ = objective.solution(result.x)
        return Solved(np.ascontiguousarray(problem.canvas.crop(layers)), replace(result, x=z[:0]))


def _unpolarized(capture: Capture, scene: SceneParameters, noise: float, weights: Weights) -> Problem:
    """A problem that knows the intensity alone: every photograph as if taken without a polarizer."""
    engine = engine_for(scene, capture.angles_deg, noise, capture.shape[-2:])
    assert isinstance(engine, PSE)
    engine.mixing[:] = engine.mixing.mean(axis=0)
    mean = np.broadcast_to(capture.intensities.mean(axis=0), capture.intensities.shape)
    averaged = Capture.of_planes(mean, capture.angles_deg, capture.valid)
    return Problem(averaged, scene, noise, weights, engine=engine)


class _Pixels:
    """The objective in the layers' own pixels, without a preconditioner."""

    def __init__(self, problem: Problem, weights: Weights, start: Images) -> None:
        misfit = Misfit(problem.capture, problem.pse, problem.canvas, problem.noise)
        self._objective = build_objective(misfit, problem.penalties, problem.canvas, weights)
        self._shape = start.shape

    def coordinates(self, layers: Images) -> Images:
        """The pixels, flat."""
        return layers.reshape(-1)

    def value_and_grad(self, z: Images) -> tuple[float, Images]:
        """Value and gradient at pixels z."""
        value, gradient = self._objective.value_and_grad(z.reshape(self._shape))
        return value, gradient.reshape(-1)

    def solution(self, z: Images) -> tuple[Images, dict[str, Any]]:
        """Layers, and no terms."""
        return z.reshape(self._shape), {}


def _in_place(estimate: SceneParameters, true: SceneParameters) -> SceneParameters:
    return estimate.replace(ghost_shift=0.0, transmission_ghost_shift=None)


PARTS = (
    Part(WHOLE, ""),
    Part("misfit", "start and regularizers alone", Weights(misfit=0)),
    Part("polarization", "the intensity alone", prepared=_unpolarized),
    Part("multi-bounce", "a single bounce", hint=BLIND.replace(n_bounces=1)),
    Part("ghosts", "all bounces in place", scene=_in_place),
    Part("edge independence", "", Weights(edge_independence=0)),
    Part("gradient sparsity", "", Weights(gradient_sparsity=0)),
    Part("nonnegativity", "", Weights(nonnegativity=0)),
    Part("natural-image prior", "", Weights(natural_image=0)),
    Part("closed-form start", "from the plain intensity", init=COLD),
    Part("learned start", "in the place of the closed form", init=LEARNED, added=True),
    Part("blind estimation", "the scene known", scene=lambda estimate, true: true),
    Part("weights from the noise", f"those of a noise of {FIXED_NOISE:g}", noise=FIXED_NOISE),
    Part("preconditioner", "L-BFGS on the pixels", coordinates=_Pixels),
)
