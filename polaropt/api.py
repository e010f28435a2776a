"""What `polaropt` offers by name: separate, inspect and estimate, with results that show themselves.

The steps themselves are in the wings below; the command line and the studies use these.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, fields
from inspect import signature
from itertools import chain
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from polaropt import batch, separation, sequence
from polaropt.batch import SHARED
from polaropt.capture import ANGLES_DEG, Capture, check_capture, result_folder
from polaropt.errors import InputError, check_flags
from polaropt.estimation import LadderResult
from polaropt.optics import GLASS_INDEX, SceneErrors, SceneParameters
from polaropt.progress import Progress
from polaropt.reporting import (
    RESULT_FILES,
    Inspection,
    estimate_sentences,
    inspect_capture,
    inspection_sentences,
    plot_layers,
    result_html,
    result_lines,
    scene_of_report,
    write_separation,
)
from polaropt.sequence import EVERY, FIRST
from polaropt.solving import Weights
from solvers.base import StoppingRule

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SceneLike = SceneParameters | str | PathLike[str]


@dataclass(frozen=True, repr=False, eq=False)
class Separation(separation.Separation):
    """Two layers and how they were found; shows itself as a table, in notebooks with pictures.

    `transmission` and `reflection` are float32 arrays (h, w) or (h, w, channel), linear; `scene` with `errors` is the
    pane, `diagnostics.warnings` what speaks against the result, `uncertainty` the standard error in every pixel.
    `layers`, `tried`, `terms`, `solver`, `seconds` and all other attributes are those of
    `polaropt.separation.Separation`.

    Attributes
    ----------
    capture : Capture
        What was separated.

    Examples
    --------
    >>> from skimage.data import astronaut, coffee
    >>> from polaropt import SceneParameters, separate, simulate
    >>> pane = SceneParameters(60.0, 20.0, 4.0)
    >>> capture = simulate(coffee()[120:248, 200:328], astronaut()[30:158, 160:288], pane)
    >>> result = separate(capture, pane)
    >>> result.reflection.shape, result.layers.shape, result.uncertainty.shape, result.reflection_known.shape
    ((128, 128, 3), (2, 3, 128, 128), (2, 3, 128, 128), (128, 128))
    >>> sorted(name for name, term in result.terms.items() if term.weight)
    ['edge_independence', 'gradient_sparsity', 'misfit', 'natural_image', 'nonnegativity']
    """

    capture: Capture = field(repr=False, kw_only=True)

    def __repr__(self) -> str:
        return "\n".join(result_lines(self))

    def _repr_html_(self) -> str:
        return result_html(self, self.capture)

    def plot(self) -> Figure:
        """Photograph, transmission and reflection side by side, each with an exposure of its own.

        Raises
        ------
        InputError
            matplotlib is not installed.
        """
        return plot_layers(self, self.capture)

    def save(self, folder: str | PathLike[str], *, uncertainty: bool = True, layers_only: bool = False) -> Path:
        """Write the files that ``polaropt separate`` writes.

        Parameters
        ----------
        folder : path
            Made if it does not exist; files of an earlier result in it are replaced as a whole.
        uncertainty : bool
            Whether the layers' standard errors are found and written.
        layers_only : bool
            Whether the layers and ``report.json`` are all that is written.

        Returns
        -------
        Path
            The folder.

        Raises
        ------
        InputError
            It cannot be written.
        """
        if not isinstance(folder, str | PathLike):
            raise InputError(f"{folder!r} is no path; give the folder for the results")
        if not str(folder):
            raise InputError("the folder has no name; give one, or '.' for the folder that you are in")
        check_flags([("uncertainty", uncertainty), ("layers_only", layers_only)])
        target = Path(folder)
        with result_folder(target, RESULT_FILES) as work:
            write_separation(work, self, self.capture, uncertainty=uncertainty, layers_only=layers_only)
        return target


def separate(
    capture: Capture,
    scene: SceneLike | LadderResult | Separation | None = None,
    solver: str = "lbfgs",
    init: str = "closed-form",
    refractive_index: float | None = GLASS_INDEX,
    single_surface: bool = False,
    weights: Weights = Weights(),  # noqa: B008 (frozen)
    stopping: StoppingRule = StoppingRule(),  # noqa: B008 (frozen)
    *,
    model: str = "auto",
    thickness_px: float | None = None,
    thickness_kind: Literal["paper", "plate"] = "paper",
    keep_start: float = 0.0,
    robust: bool = False,
    device: str | None = None,
    scene_errors: SceneErrors | None = None,
    start: NDArray[np.float32] | None = None,
    progress: Progress | None = None,
    index_known: bool = False,
    match_photographs: bool = True,
    leave_out_unglazed: bool = True,
) -> Separation:
    """Separate the transmitted from the reflected scene.

    Parameters
    ----------
    capture : Capture
    scene : SceneParameters, path, or what `estimate` or `separate` returns, optional
        Fields that are None are estimated, the others stay fixed; or the ``report.json`` of an earlier separation,
        whose scene is taken as it was found, or an estimate or a result, with its errors. Default: all is found blind,
        with the two parameters below.
    solver : str
        Name of a minimizer, see `solvers.registry.solver_names`.
    init : str
        Where the solve starts: "closed-form" (per frequency, with all ghosts), "learned" (networks that improve it),
        "per-pixel" or "cold" (the plain intensity); see `initializers`. The layers are those where the solve ends.
    refractive_index : float or None
        Index of the pane, where no scene is given. None: it is found, as far as the photographs tell it. A scene of
        another index is refused, as with the next two.
    single_surface : bool
        No back face (water), where no scene is given.
    weights : Weights
        Factors on the terms of the objective.
    stopping : StoppingRule
    model : str
        Rung of the ladder of scene models, where the scene is not given: "auto" takes the lowest one that explains
        the capture, "none" returns the intensity; all names: `polaropt.estimation.ladder.model_names`.
    thickness_px : float, optional
        Thickness of the pane in pixels: ties the ghost shift to the incidence.
    thickness_kind : {"paper", "plate"}
        Formula of the ghost step, see `ghost_step`.
    keep_start : float
        Pull the layers so far back to the start once the solve has ended, 0 (not at all) to 1 (all the way): a mean of
        two estimates, which no longer minimizes the objective.
    robust : bool
        Residuals of the photographs beyond three sigma count linearly.
    device : str, optional
        Where torch works out closed form, objective and solve, as it names it: "cuda", or "cpu"; for the solvers
        "lbfgs" and "torch". Default: compiled passes on the processor. The scene is estimated on the processor all the
        same, and so is the closed form of a mosaic's samples, and behind a pane that varies over the frame.
    scene_errors : SceneErrors, optional
        Standard errors of a scene that is given complete and was estimated elsewhere: reported, and part of the
        layers' own.
    start : ndarray, shape (2, [channel,] h, w), optional
        Layers to start from instead of those that `init` names, such as those of the frame before.
    progress : callable, optional
        Called with what is being done and the fraction done, 0..1.
    index_known : bool
        Whether an index of 1.5 is known. Otherwise it is what glass usually has, and where one clear pane of another
        index explains the photographs clearly better, that is taken. Any other index is kept as it is.
    match_photographs : bool
        Photographs taken one after the other that are shifted, turned or scaled against each other, by up to a quarter
        of the frame's shorter side (shifts by up to 128 pixels), are moved onto the first one, of four and more both
        layers by themselves where a camera held by hand has moved these by up to eight pixels, and those that are less
        sharp are made as sharp as the sharpest, before anything else; exposures that differ by some per cent, of all
        colours alike or of each, are found and divided out of four at steps of 45 degrees. So are gains of a mosaic's
        analyzers. `Separation.matching` tells of it.
    leave_out_unglazed : bool
        Where the frame shows no glass, as window frames and walls do, it is left out when the scene is estimated and in
        the solve; the transmission is the light there, the reflection nothing. `Separation.unglazed` tells where.

    Returns
    -------
    Separation

    Raises
    ------
    ValueError
        Unknown solver or start (the message lists the names), a solver that cannot take so large an image, or a
        parameter outside its range or of another type (`InputError`).

    Warns
    -----
    ResultWarning
        The result is not to be trusted as it is: `Separation.diagnostics` tells why.

    Examples
    --------
    >>> from skimage.data import astronaut, coffee
    >>> from polaropt import SceneParameters, separate, simulate
    >>> pane = SceneParameters(60.0, 20.0, 4.0)
    >>> capture = simulate(coffee()[120:248, 200:328], astronaut()[30:158, 160:288], pane)
    >>> result = separate(capture)
    >>> result.transmission.shape, abs(result.scene.incidence_deg - 60) < 2
    ((128, 128, 3), True)
    """
    asked, known = _given(scene, check_capture(capture).shape)
    _check_agreeing(asked, refractive_index, single_surface, model)
    check_flags([("index_known", index_known)])
    found = separation.separate(
        capture,
        asked,
        solver,
        init,
        refractive_index,
        single_surface,
        weights,
        stopping,
        model=model,
        thickness_px=thickness_px,
        thickness_kind=thickness_kind,
        keep_start=keep_start,
        robust=robust,
        device=device,
        progress=_called(progress),
        scene_errors=known if scene_errors is None else scene_errors,
        start=start,
        index_known=index_known,
        match_photographs=match_photographs,
        leave_out_unglazed=leave_out_unglazed,
    )
    found.diagnostics.warn(stacklevel=2)
    return _with_capture(found, capture)


def separate_many(
    captures: Iterable[Capture] | Any,
    scene: SceneLike | LadderResult | Separation | Literal["shared"] | None = None,
    *,
    client: Any = None,
    angles_deg: Sequence[float] = ANGLES_DEG,
    **options: Any,
) -> Any:
    """Separate many captures.

    Parameters
    ----------
    captures : iterable of Capture, or dask.array.Array
        An array is photographs along time, (time, angle, height, width) or (time, angle, height, width, 3), white = 1.
    scene : SceneParameters, path, what `estimate` or `separate` returns, or "shared", optional
        As of `separate`, the same for all; captures behind that of a report have one size. "shared": the pane stands
        still against the camera, and one scene is estimated from all captures together.
    client : distributed.Client, optional
        Whose workers separate; captures and results go to and from them directly. Default: this process. Arrays are
        computed by whoever computes the result.
    angles_deg : sequence of float
        Polarizer angles of an array.
    **options
        As of `separate`. With a device, captures of one shape that follow each other are solved together there, as many
        as make 2**24 values of layers, 32 at most.

    Returns
    -------
    iterator of Separation, or dask.array.Array
        In the order of the captures, made one by one as they are asked for, or some at a time on a device. Of an array:
        both layers along time, (time, 2, height, width[, 3]) in its chunks of time, [:, 0] the transmission.

    Raises
    ------
    InputError
        As `separate`; an array of another shape.

    Warns
    -----
    ResultWarning
        As `separate`, of each result as it is made; of an array from whoever computes it.

    Examples
    --------
    Two captures behind one pane that stands still, estimated from all of them:

    >>> from skimage.data import astronaut, coffee
    >>> from polaropt import SceneParameters, separate_many, simulate
    >>> behind, before = coffee()[120:216, 200:296], astronaut()[30:126, 160:256]
    >>> pane = SceneParameters(60.0, 20.0, 4.0)
    >>> captures = [simulate(behind, before, pane, noise=0.005, seed=seed) for seed in range(2)]
    >>> for result in separate_many(captures, scene="shared"):
    ...     print(result.transmission.shape, round(result.scene.incidence_deg / 5) * 5)
    (96, 96, 3) 60
    (96, 96, 3) 60
    """
    _check_options(options)
    _check_several(captures)
    if hasattr(captures, "dask"):
        array: Any = captures
        asked: Any = scene
        known = None
        if scene != SHARED:
            asked, known = _given(scene, array.shape[2:4])
            _check_agreeing(asked, **_told_beside(options))
        return batch.separate_many(array, asked, angles_deg=angles_deg, **_with_errors(options, known))
    return _many(captures, scene, client, options)


def _many(captures: Iterable[Capture], scene: Any, client: Any, options: dict[str, Any]) -> Iterator[Separation]:
    taken: deque[Capture] = deque()
    noted, known = _noted(captures, taken), None
    if scene != SHARED:
        noted, scene, known = _with_scene(noted, scene)
        _check_agreeing(scene, **_told_beside(options))
    yield from _shown(batch.separate_many(noted, scene, client=client, **_with_errors(options, known)), taken)


def separate_sequence(
    captures: Iterable[Capture],
    scene: SceneLike | LadderResult | Separation | None = None,
    *,
    pane: Literal["follow", "still"] = "follow",
    first: int = FIRST,
    every: int = EVERY,
    ahead: bool = True,
    **options: Any,
) -> Iterator[Separation]:
    """Separate frames one after another, as they come.

    The pane is found from the first frames together and followed: now and then a frame tells it again, and what it says
    is weighed against what is known by the standard errors of both. Where a frame shows what the one before did, what
    was found there helps its solve.

    Parameters
    ----------
    captures : iterable of Capture
        Such as frames that a camera gives; no more of them is taken than `first`, and one ahead, before the first
        result comes.
    scene : SceneParameters, path, or what `estimate` or `separate` returns, optional
        As of `separate`. A complete one is not looked for, nor followed.
    pane : {"follow", "still"}
        Whether the pane may move against the camera.
    first : int
        Frames that the pane is found from.
    every : int
        Frames after which one that is followed is looked at again; sooner while it moves.
    ahead : bool
        Whether another thread takes the next capture while one is separated, so that it is read meanwhile. The time of
        a separation's stages then holds some of that.
    **options
        As of `separate`, without layers to start from: a frame starts from what the one before has left.

    Yields
    ------
    Separation
        Of each capture, in their order. Frames before the first one that is polarized have the intensity as
        transmission.

    Raises
    ------
    InputError
        As `separate`.

    Warns
    -----
    ResultWarning
        As `separate`, of each result as it comes.

    Examples
    --------
    >>> from skimage.data import astronaut, coffee
    >>> from polaropt import SceneParameters, separate_sequence, simulate
    >>> behind, before = coffee()[120:216, 200:296], astronaut()[30:126, 160:256]
    >>> pane = SceneParameters(60.0, 20.0, 4.0)
    >>> frames = (simulate(behind, before, pane, noise=0.005, seed=seed) for seed in range(3))
    >>> results = separate_sequence(frames, first=2)
    >>> next(results).transmission.shape, len(list(results))
    ((96, 96, 3), 2)
    """
    _check_options(options)
    _check_several(captures)
    return _sequence(captures, scene, {"pane": pane, "first": first, "every": every, "ahead": ahead}, options)


def _sequence(
    captures: Iterable[Capture], scene: Any, how: dict[str, Any], options: dict[str, Any]
) -> Iterator[Separation]:
    taken: deque[Capture] = deque()
    noted, asked, known = _with_scene(_noted(captures, taken), scene)
    _check_agreeing(asked, **_told_beside(options))
    found = sequence.separate_sequence(noted, asked, **how, **_with_errors(options, known))
    yield from _shown(found, taken)


def _check_several(captures: Any) -> None:
    """InputError where captures are one, or nothing that holds some."""
    if not hasattr(captures, "__iter__") and not hasattr(captures, "__getitem__"):
        what = (
            "give several in a list, or call separate" if isinstance(captures, Capture) else "give a list of captures"
        )
        raise InputError(f"captures is a {type(captures).__name__}; {what}")


def _noted(captures: Iterable[Capture], taken: deque[Capture]) -> Iterator[Capture]:
    """Captures, noted as they are taken."""
    for capture in captures:
        taken.append(check_capture(capture))
        yield capture


def _shown(results: Iterable[separation.Separation], taken: deque[Capture]) -> Iterator[Separation]:
    """Results that show themselves, in the order of the captures that were taken."""
    for result in results:
        # Who asks for the next one stands above this generator and the one that it is part of.
        result.diagnostics.warn(stacklevel=3)
        yield _with_capture(result, taken.popleft())


def _with_capture(result: separation.Separation, capture: Capture) -> Separation:
    parts = {of.name: getattr(result, of.name) for of in fields(separation.Separation)}
    return Separation(**parts, capture=capture)


@dataclass(frozen=True, repr=False)
class _Facts(Inspection):
    """What a capture is, shown in sentences."""

    def __repr__(self) -> str:
        return "\n".join(inspection_sentences(self))


@dataclass(frozen=True, repr=False)
class _FoundScene(LadderResult):
    """How the pane stands, shown line by line."""

    asked: SceneParameters = field(kw_only=True)
    from_thickness: bool = field(kw_only=True)

    def __repr__(self) -> str:
        return "\n".join(estimate_sentences(self, self.asked, from_thickness=self.from_thickness))


def inspect(capture: Capture) -> Inspection:
    """Tell what a capture is, before anything is solved: size, noise, gain, polarization, signs of mistakes.

    Parameters
    ----------
    capture : Capture

    Returns
    -------
    Inspection
        Shows itself in sentences.

    Raises
    ------
    InputError
        It is no capture.

    Examples
    --------
    >>> from skimage.data import astronaut, coffee
    >>> from polaropt import SceneParameters, inspect, simulate
    >>> pane = SceneParameters(60.0, 20.0, 4.0)
    >>> capture = simulate(coffee()[120:248, 200:328], astronaut()[30:158, 160:288], pane)
    >>> inspect(capture).looks_encoded, 0.002 < inspect(capture).noise < 0.008
    (False, True)
    """
    return _Facts(**vars(inspect_capture(check_capture(capture))))


def estimate(
    capture: Capture,
    scene: SceneLike | LadderResult | Separation | None = None,
    *,
    refractive_index: float | None = GLASS_INDEX,
    single_surface: bool = False,
    model: str = "auto",
    thickness_px: float | None = None,
    thickness_kind: Literal["paper", "plate"] = "paper",
    index_known: bool = False,
    match_photographs: bool = True,
    leave_out_unglazed: bool = True,
    progress: Progress | None = None,
) -> LadderResult:
    """Estimate how the pane stands, without separating.

    Parameters
    ----------
    capture : Capture
    scene : SceneParameters, path, or what `estimate` or `separate` returns, optional
        As for `separate`. Default: a pane of glass of which nothing else is known.
    refractive_index, single_surface, model, thickness_px, thickness_kind, index_known, match_photographs,
    leave_out_unglazed, progress
        As for `separate`.

    Returns
    -------
    LadderResult
        Its `scene` is complete, `errors` are the standard errors of what was estimated. Shows itself line by line.

    Raises
    ------
    InputError
        It is no capture, or a parameter is outside its range.

    Examples
    --------
    >>> from skimage.data import astronaut, coffee
    >>> from polaropt import SceneParameters, estimate, simulate
    >>> pane = SceneParameters(60.0, 20.0, 4.0)
    >>> capture = simulate(coffee()[120:248, 200:328], astronaut()[30:158, 160:288], pane)
    >>> found = estimate(capture)
    >>> found.scene.rung, abs(found.scene.azimuth_deg - 20) < 1
    ('ghosts', True)
    """
    asked, _ = _given(scene, check_capture(capture).shape)
    _check_agreeing(asked, refractive_index, single_surface, model)
    check_flags([("index_known", index_known)])
    case = separation.scene_case(
        capture,
        asked,
        refractive_index=refractive_index,
        single_surface=single_surface,
        model=model,
        thickness_px=thickness_px,
        thickness_kind=thickness_kind,
        index_known=index_known,
        match_photographs=match_photographs,
        leave_out_unglazed=leave_out_unglazed,
        progress=_called(progress),
    )
    return _FoundScene(**vars(case.found), asked=case.asked, from_thickness=thickness_px is not None)


def _given(scene: Any, shape: tuple[int, ...]) -> tuple[SceneParameters | None, SceneErrors | None]:
    """A scene as it is given, from an earlier report, or as it was found, with its errors, for photographs' shape."""
    if scene is None or isinstance(scene, SceneParameters):
        return scene, None
    if isinstance(scene, LadderResult | separation.Separation):
        return scene.scene, scene.errors
    if isinstance(scene, str | PathLike):
        if not str(scene):
            raise InputError("scene is empty; give the report.json of a separation, or leave it out")
        return scene_of_report(Path(scene), shape[-2:]), None
    raise InputError(f"scene is a {type(scene).__name__}; give SceneParameters, or the report.json of a separation")


def _check_agreeing(
    scene: SceneParameters | None,
    refractive_index: float | None = GLASS_INDEX,
    single_surface: bool = False,
    model: str = "auto",
) -> None:
    """InputError where a scene is given, and beside it what it says otherwise and would be left out in silence."""
    if scene is None:
        return
    if refractive_index not in (GLASS_INDEX, scene.refractive_index):
        raise InputError(
            f"refractive_index is {refractive_index}, that of the scene {scene.refractive_index}; give it in the scene"
        )
    if single_surface and not scene.single_surface:
        raise InputError("single_surface is asked for, and the scene is a pane; give it in the scene")
    if scene.complete and model not in ("auto", scene.rung):
        raise InputError(
            f"the model {model!r} is asked for, and the scene is given as a whole, as {scene.rung!r}; leave one out"
        )


def _told_beside(options: dict[str, Any]) -> dict[str, Any]:
    """What options say that a scene says, too."""
    return {name: options[name] for name in ("refractive_index", "single_surface", "model") if name in options}


def _with_scene(
    captures: Iterator[Capture], scene: Any
) -> tuple[Iterator[Capture], SceneParameters | None, SceneErrors | None]:
    """Captures with a scene that is given, of an earlier report for photographs of the first one's size."""
    if not isinstance(scene, str | PathLike):
        return captures, *_given(scene, ())
    first = next(captures, None)
    if first is None:
        return captures, None, None
    shape = first.shape[-2:]

    def alike() -> Iterator[Capture]:
        for capture in chain([first], captures):
            if capture.shape[-2:] != shape:
                raise InputError(
                    f"a capture has {capture.shape[-1]}x{capture.shape[-2]} px, the first {shape[1]}x{shape[0]}: "
                    "give a report with captures of one size"
                )
            yield capture

    return alike(), *_given(scene, shape)


def _with_errors(options: dict[str, Any], known: SceneErrors | None) -> dict[str, Any]:
    """Options with the standard errors of an estimate that was given as the scene."""
    return options if known is None else {"scene_errors": known, **options}


def _check_options(options: dict[str, Any]) -> None:
    """TypeError for an option that `separate` does not have, as Python has it; InputError for a wrong progress."""
    for name in options:
        if name not in _OPTIONS:
            raise TypeError(f"unexpected option {name!r}; `separate` has: {', '.join(_OPTIONS)}")
    _called(options.get("progress"))


_OPTIONS = tuple(signature(separate).parameters)[2:]


def _called(progress: Progress | None) -> Progress | None:
    """InputError for a progress that cannot be called."""
    if progress is not None and not callable(progress):
        raise InputError(f"progress is a {type(progress).__name__}; give a function of a stage and the fraction done")
    return progress
