"""``report.html``: one separation as a page of its own, for people."""

from __future__ import annotations

import base64
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from polaropt.capture import Capture, encode_srgb, planes_last
from polaropt.numerics import block_mean
from polaropt.optics import Component
from polaropt.reporting.pictures import (
    AOLP_TICKS,
    DOLP_TICKS,
    MISFIT_WHITE,
    Image,
    Picture,
    UncertaintyPanels,
    aolp_colors,
    dolp_colors,
    marked_picture,
    polarization_panels,
    reduced_intensity,
    viewing_exposure,
)
from polaropt.reporting.words import (
    explained_attention,
    motion_sentences,
    shown_fields,
    solver_sentence,
    source_of,
    time_sentence,
)

if TYPE_CHECKING:
    from jinja2 import Template

    from polaropt.separation import Separation


# Longest side in pixels of a picture in the page, and JPEG quality. Set by hand.
_LONG_SIDE = 1000
_QUALITY = 88
# Colours along the gradient of a key.
_STOPS = 13
_GREYS = "linear-gradient(to right, #000, #fff)"


@dataclass(frozen=True)
class Key:
    """What the colours of a picture mean: a gradient as CSS has it, and the values along it."""

    gradient: str
    ticks: tuple[str, ...]


@dataclass(frozen=True)
class PagePicture:
    """A picture in a page.

    Attributes
    ----------
    name : str
        Of its element.
    title, caption : str
    alt : str
        What there is to see, for who does not see it.
    uri : str
        The picture itself.
    width, height : int
    key : Key or None
    comparable : bool
        Whether it shows the scene as a photograph does, so that two of them can be laid over each other.
    """

    name: str
    title: str
    caption: str
    alt: str
    uri: str
    width: int
    height: int
    key: Key | None = None
    comparable: bool = False


def page_pictures(
    result: Separation,
    capture: Capture,
    exposures: Mapping[str, float],
    errors: UncertaintyPanels | None,
    misfit: Image | None = None,
) -> list[PagePicture]:
    """Photograph and layers, what moves, their errors, polarization and misfit, in the order of the page.

    Parameters
    ----------
    result : Separation
    capture : Capture
    exposures : mapping of str to float
        What "transmission" and "reflection" are multiplied by.
    errors : UncertaintyPanels or None
        None where they were not asked for.
    misfit : ndarray, shape (h, w), optional
        Standard deviations of the noise.
    """
    last = [] if misfit is None else [_misfit(misfit)]
    return [
        *_layers(result, capture, exposures),
        *_marked(result, capture),
        *([] if errors is None else _errors(errors)),
        *_polarization(capture),
        *last,
    ]


def _marked(result: Separation, capture: Capture) -> list[PagePicture]:
    """Where something moves, and where no glass is seen."""
    of_motion = "the estimation, and of the layers where but one photograph saw it; else shown as one saw it."
    of_light = "estimation and solve; the transmission is what is seen there."
    moves, unglazed = "What moves between the photographs, in red.", "Where the picture shows no glass, in red."
    marks = (
        ("moving", "What moves", of_motion, moves, result.moving),
        ("unglazed", "What shows no glass", of_light, unglazed, result.unglazed),
    )
    pictures = []
    for name, title, left_out_of, alt, where in marks:
        if where is not None:
            caption = f"In red, {100 * where.mean():.2g} % of the picture: left out of {left_out_of}"
            pixels = marked_picture(capture, where, _reduction(capture.shape))
            pictures.append(_picture(name, title, caption, alt, pixels))
    return pictures


def _layers(result: Separation, capture: Capture, exposures: Mapping[str, float]) -> list[PagePicture]:
    shown = (
        ("photograph", "Photograph", "light of all polarizations, as without a filter", _intensity(capture)),
        ("transmission", "Transmission", "what is behind the glass", _reduced(result.layers[0])),
        ("reflection", "Reflection", "what the glass mirrors", _reduced(result.layers[1])),
    )
    pictures = []
    for name, title, what, image in shown:
        exposure = exposures.get(name) or viewing_exposure(image)
        caption = f"{what[0].upper()}{what[1:]}; {exposure:.3g} times the linear values, in sRGB."
        pixels = np.round(255 * encode_srgb(image * np.float32(exposure), capture.camera)).astype(np.uint8)
        pictures.append(_picture(name, title, caption, f"{title}: {what}.", pixels, comparable=True))
    return pictures


def _errors(panels: UncertaintyPanels) -> list[PagePicture]:
    pictures = []
    for name, error in panels.errors.items():
        white = panels.white[name]
        pixels = np.round(255 * np.clip(error / np.float32(white), 0, 1)).astype(np.uint8)
        title = f"Standard error of the {name}"
        key = Key(_GREYS, ("0", f"{white / 2:.2g}", f"{white:.2g}"))
        caption = f"How far each pixel of the {name} may be from the truth (one standard deviation), in linear values."
        pictures.append(_picture(f"{name}-error", title, caption, f"{title}, bright where it is large.", pixels, key))
    pixels = np.round(255 * np.clip(panels.known, 0, 1)).astype(np.uint8)
    caption = f"Share of the reflection's detail that the photographs tell; red below {panels.faded:g}: it fades there."
    alt = "Where the reflection is known: bright where it is, red where it is not."
    pictures.append(_picture("known", "Where the reflection is known", caption, alt, pixels))
    return pictures


def _misfit(misfit: Image) -> PagePicture:
    pixels = np.round(255 * np.clip(_reduced(misfit) / MISFIT_WHITE, 0, 1)).astype(np.uint8)
    key = Key(_GREYS, ("0", f"{MISFIT_WHITE / 2:g}", f"{MISFIT_WHITE:g}"))
    caption = "Where the pane does not explain the photographs, in standard deviations of the noise."
    return _picture("misfit", "Misfit", caption, "Misfit of the photographs, bright where it is large.", pixels, key)


def _polarization(capture: Capture) -> list[PagePicture]:
    panels = polarization_panels(capture)
    steps = np.linspace(0, 1, _STOPS)
    degree = Key(_gradient(dolp_colors(steps)), DOLP_TICKS)
    angle = Key(_gradient(aolp_colors(180 * steps, np.ones(_STOPS))), AOLP_TICKS)
    about = (
        "Direction in which it is polarized, counter-clockwise from the right; black where unpolarized, full colour "
        f"from a degree of {panels.full:.2f}."
    )
    return [
        _picture(
            "dolp", "Degree of polarization", "How strongly the photographs' light is polarized; grey where saturated.",
            "Degree of linear polarization.", panels.dolp, degree,
        ),
        _picture("aolp", "Angle of polarization", about, "Angle of linear polarization as hue.", panels.aolp, angle),
    ]  # fmt: skip


def _picture(
    name: str, title: str, caption: str, alt: str, pixels: Picture, key: Key | None = None, *, comparable: bool = False
) -> PagePicture:
    from imagecodecs import jpeg_encode

    data = jpeg_encode(np.ascontiguousarray(pixels), level=_QUALITY)
    uri = "data:image/jpeg;base64," + base64.b64encode(data).decode("ascii")
    return PagePicture(name, title, caption, alt, uri, pixels.shape[1], pixels.shape[0], key, comparable)


def _reduced(planes: Image) -> Image:
    """Planes ([channel,] h, w) to an image of at most about a thousand pixels along its long side."""
    return planes_last(np.asarray(block_mean(planes, _reduction(planes.shape)), dtype=np.float32))


def _intensity(capture: Capture) -> Image:
    """The photograph as without a filter, of that size."""
    return planes_last(reduced_intensity(capture, _reduction(capture.shape)))


def _reduction(shape: tuple[int, ...]) -> int:
    return -(-max(shape[-2:]) // _LONG_SIDE)


def _gradient(colors: Picture) -> str:
    stops = ", ".join("rgb({}, {}, {})".format(*(int(part) for part in color)) for color in colors)
    return f"linear-gradient(to right, {stops})"


# Of the chart, in the units of its drawing.
_WIDTH, _HEIGHT = 640, 260
_LEFT, _RIGHT, _TOP, _BOTTOM = 84, 16, 14, 44
# Evaluations up to which each has a dot; more run into one another.
_MOST_DOTS = 60
_TICKS = 5
# Largest value over least from which the axis is logarithmic; set by hand.
_WIDE = 20.0


@dataclass(frozen=True)
class Tick:
    """Where on the chart, and what it says there."""

    place: float
    text: str


@dataclass(frozen=True)
class Chart:
    """Values over evaluations, in the coordinates of a drawing of `width` by `height`.

    Attributes
    ----------
    points : tuple of (float, float)
        x and y of each evaluation.
    across, up : tuple of Tick
        The first and last of each are the ends of what is drawn.
    logarithmic : bool
    """

    points: tuple[tuple[float, float], ...]
    across: tuple[Tick, ...]
    up: tuple[Tick, ...]
    logarithmic: bool
    width: int = _WIDTH
    height: int = _HEIGHT
    left: int = _LEFT
    right: int = _WIDTH - _RIGHT
    top: int = _TOP
    bottom: int = _HEIGHT - _BOTTOM

    @property
    def line(self) -> str:
        """The points as SVG wants them."""
        return " ".join(f"{x:.1f},{y:.1f}" for x, y in self.points)

    @property
    def dots(self) -> tuple[tuple[float, float], ...]:
        """Points to mark: all where they are few."""
        return self.points if len(self.points) <= _MOST_DOTS else ()


def convergence_chart(values: Sequence[float]) -> Chart | None:
    """Chart of the objective's values, one per evaluation; None for fewer than two.

    Parameters
    ----------
    values : sequence of float
        Finite.
    """
    if len(values) < 2:
        return None
    heights = np.asarray(values, dtype=np.float64)
    logarithmic = bool(heights.min() > 0 and heights.max() > _WIDE * heights.min())
    heights = np.log(heights) if logarithmic else heights
    low, high = float(heights.min()), float(heights.max())

    def x(count: float) -> float:
        return _LEFT + (_WIDTH - _LEFT - _RIGHT) * (count - 1) / (len(values) - 1)

    def y(height: float) -> float:
        return _HEIGHT - _BOTTOM - (_HEIGHT - _BOTTOM - _TOP) * (height - low) / ((high - low) or 1.0)

    # From the least to the largest value itself, which rounded ticks would leave to be guessed.
    levels = np.unique(np.linspace(low, high, _TICKS))
    counts = np.unique(np.linspace(1, len(values), _TICKS).round())
    return Chart(
        points=tuple((x(count), y(height)) for count, height in enumerate(heights.tolist(), 1)),
        across=tuple(Tick(x(count), f"{count:g}") for count in counts.tolist()),
        up=tuple(Tick(y(level), _label(math.exp(level) if logarithmic else level)) for level in levels.tolist()),
        logarithmic=logarithmic,
    )


def _label(value: float) -> str:
    return f"{value:,.0f}" if 1000 <= abs(value) < 1e8 else f"{value:.4g}"


_HERE, _TEMPLATE = "polaropt.reporting", "report_template.html"
_PIECES = ("look.css", "warnings.html", "compare.html", "compare.css", "compare.js")
_RUNGS = {
    "none": "no polarization: nothing to separate by",
    "pixelwise": "a flat pane seen from afar, all bounces in place",
    "ghosts": "a flat pane seen from afar, with double images",
    "perspective": "a flat pane before a wide lens",
    "curved": "a bent pane before a wide lens",
    "polarized": "a flat pane, light that arrives polarized",
}


_PANES = {2: "two", 3: "three"}


def _pane(scene: Mapping[str, Any]) -> str:
    """What was found, in words: the model, and of how many panes."""
    count = scene.get("n_panes") or 1
    words = _RUNGS.get(scene["rung"], str(scene["rung"]))
    return words if count == 1 else words.replace("a flat pane", f"{_PANES.get(count, count)} flat panes")


@dataclass(frozen=True)
class Parameter:
    """One line of the page's table of the pane: name, value with unit, standard error, how it is known."""

    name: str
    value: str
    error: str
    how: str


def write_html_report(
    path: Path,
    result: Separation,
    report: dict[str, Any],
    pictures: Sequence[PagePicture],
) -> None:
    """Write a page that needs nothing beside it: pictures, pane, course of the solve, warnings.

    Parameters
    ----------
    path : Path
    result : Separation
    report : dict
        As in ``report.json``.
    pictures : sequence of PagePicture
    """
    names = [Path(name).name for name in report["input"].get("files", ())]
    page = page_template(_HERE, _TEMPLATE).render(
        title=_title(names),
        names=names,
        report=report,
        pane=_pane(report["scene"]),
        warnings=explained_attention(report),
        unseen=motion_sentences(report),
        pictures=pictures,
        comparable=[picture for picture in pictures if picture.comparable],
        full_width=report["input"]["width"],
        parameters=parameters(report),
        chart=convergence_chart([point.value for point in result.solver.trace]),
        solver=solver_sentence(report["solver"]),
        time=time_sentence(report["seconds"]),
    )
    # Names of files may be bytes in no encoding.
    path.write_text(page, encoding="utf-8", errors="backslashreplace")


def _title(names: list[str]) -> str:
    if len(names) < 2:
        return f"Separation of {names[0]}" if names else "Separation"
    return f"Separation of {names[0]} and {len(names) - 1} more"


def parameters(report: dict[str, Any]) -> list[Parameter]:
    """The pane's numbers with their standard errors, where these are stated, as in ``report.json``."""
    scene = report["scene"]
    if not scene["signal"]:
        return []
    rows = [
        Parameter(
            field.words[0].upper() + field.words[1:],
            ", ".join(map(_number, field.components, _as_list(scene[field.name]))),
            ", ".join(map(_error, field.components, _as_list(report["errors"].get(field.name)))),
            source_of(field.name, report["estimated"]),
        )
        for field in shown_fields(scene)
    ]
    return [*rows, Parameter("Back face", "none", "", "given")] if scene["single_surface"] else rows


def _as_list(value: Any) -> list[float]:
    if value is None:
        return []
    return list(value) if isinstance(value, list | tuple) else [value]


def _number(component: Component, value: float) -> str:
    return " ".join(filter(None, (component.words, f"{value:.{component.digits}f}", component.unit)))


def _error(component: Component, error: float) -> str:
    return f"± {error:.2g} {component.unit}".rstrip()


@lru_cache(maxsize=4)
def page_template(package: str, name: str) -> Template:
    """Template of a page in a package; it may include the pieces that all pages share.

    Parameters
    ----------
    package, name : str
        Where it is: a package of polaropt and the name of a file in it. The pieces are ``look.css``, ``warnings.html``,
        and ``compare.html``, ``compare.css`` and ``compare.js``, two pictures under a slider.
    """
    from jinja2 import Environment, FunctionLoader, StrictUndefined

    def source(wanted: str) -> str:
        place = files(_HERE if wanted in _PIECES else package)
        return place.joinpath(wanted).read_text(encoding="utf-8")

    # File names and sentences are text, not markup.
    pages = Environment(
        loader=FunctionLoader(source), autoescape=True, trim_blocks=True, lstrip_blocks=True, undefined=StrictUndefined
    )
    return pages.get_template(name)
