"""The few numbers that say how the glass stands before the camera."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any, Literal

from polaropt.errors import InputError, check_flags, check_numbers
from polaropt.optics.fresnel import refraction_angle

SEARCHED = ("incidence_deg", "azimuth_deg", "ghost_shift")

GLASS_INDEX = 1.5
"""Refractive index of window glass for visible light; soda-lime glass has 1.52."""
WATER_INDEX = 1.33
"""The same of water."""
HIGHEST_INDEX = 10.0
"""Nothing that light passes has a higher one: germanium has 4, lead telluride 6. Set by hand."""
FARTHEST_SHIFT_PX = 1e5
"""Ghost shift beyond which all ghosts lie outside any photograph. Set by hand."""
FOCAL_RANGE_PX = (0.01, 1e10)
"""Focal lengths: from one that sees half a turn in a pixel to rays that are parallel for any frame. Set by hand."""
MOST_PANES = 8
"""Panes of a window; glazing is sold with four at most. Set by hand."""
DARKEST_TINT = 1e-3
"""Share of the light that a pane passes at least. Set by hand."""
# Where a scene's numbers are looked for and worked with; what they may be at all is checked by `SceneParameters`. All
# set by hand.
INCIDENCE_SEARCH_DEG = (0.5, 88.0)
"""Incidences among which that of a pane is searched. At 0.5 degrees glass polarizes 1e-5 of the light that
it passes and 1e-4 of what it mirrors, less than any noise; from 88 on it passes less than a tenth."""
INCIDENCE_LIMITS_DEG = (0.5, 89.5)
"""Incidences at which one that is given or extrapolated is worked with. Frontally and at grazing incidence both
polarizations are reflected alike, and what polarized light takes off the intensity diverges."""
GHOST_SHIFT_SEARCH_PX = 24.0
"""Largest ghost shift that is searched, either way."""
_SHIFTS_PER_FRAME = 6.0
"""A frame is at least so many shifts wide: farther ghosts would be told by few edges."""

_SHIFTS = ("ghost_shift", "transmission_ghost_shift", "gap_shift")
_LENGTHS = (*_SHIFTS, "focal_px")
"""Fields in pixels."""
_NUMBERS = (*SEARCHED, *_LENGTHS[1:], "gap_azimuth_deg", "refractive_index", "n_bounces", "n_panes", "absorption")

GHOST_STEPS = ("paper", "plate")
"""Formulas of the distance between ghosts, see `ghost_step`."""

Rung = Literal["none", "pixelwise", "ghosts", "perspective", "curved", "polarized"]


@dataclass(frozen=True)
class SceneParameters:
    """Geometry and material of the pane, and the polarization of the light that meets it.

    Parameters
    ----------
    incidence_deg : float or None
        Angle of incidence, 0 <= incidence_deg < 90. None: to be estimated.
    azimuth_deg : float or None
        Direction of the trace of the plane of incidence in the image, counter-clockwise from x (right).
        Adding 180 flips the sign of `ghost_shift`. None: to be estimated.
    ghost_shift : float or None
        Distance from one ghost to the next in pixels along the azimuth, signed. None: to be estimated.
    refractive_index : float or None
        Index of the pane, from 1 to `HIGHEST_INDEX`. None: to be found, as far as the photographs tell it.
    n_bounces : int or None
        The direct path and ghosts 1..n_bounces. None: all of them.
    single_surface : bool
        No back face (water).
    transmission_polarization, reflection_polarization : (float, float)
        Degree (0..1) and angle (degrees) of linear polarization of the light from behind the pane, and of the
        mirrored scene as an ideal mirror would show it.
    literal_eq3 : bool
        The paper's Eq. (3) as printed, with the reflection's first ghost unshifted, instead of physics.
    transmission_ghost_shift : float or None
        The transmission's own distance from one ghost to the next, as far and near scenes differ; `ghost_shift` is then
        the reflection's. None: `ghost_shift` holds for both.
    focal_px : float or None
        Focal length of a pinhole camera in pixels, its axis through the middle of the frame: incidence and azimuth
        vary over the frame, and those above are the ones at its middle. The azimuth is then the direction to which
        the pane's normal (towards the scene) leans, and adding 180 is another pane. Ghosts lie along it, at the same
        distance in all of the frame, and are as bright as each pixel's own incidence makes them.
        None: the pane is seen from far, and both are the same everywhere unless it is bent.
    bend_deg_per_px : (float, float, float)
        How a bent pane's normal changes from pixel to pixel, in degrees: (b_xx, b_xy, b_yy) of a symmetric matrix. At
        (x, y) from the middle of the frame, x to the right and y up, the normal's part across the camera's axis has
        changed by (b_xx x + b_xy y, b_xy x + b_yy y). Zeros: flat.
    signal : bool
        Whether there is polarization at all; without, the numbers above mean nothing and the rung is "none".
    n_panes : int or None
        Parallel panes, one behind another, each with its own double images. None: to be found.
    gap_shift : float or None
        Distance in pixels from the image that the back of one pane makes to that of the next pane's front, signed; the
        same for both layers. None: to be found.
    gap_azimuth_deg : float or None
        Direction of that distance in the image, counter-clockwise from x: panes are neither parallel nor flat. None:
        along the azimuth.
    absorption : float or None
        Minus the logarithm of the share of light that tinted glass leaves in one pass. The transmission is what is seen
        through the tint, ``exp(-n_panes absorption)`` of the light: its scale cannot be told. None: to be found.

    Raises
    ------
    InputError
        A value outside its range.

    Examples
    --------
    A pane at 60 degrees whose double images lie 4 px apart, and the rung of the ladder that this is:

    >>> from polaropt import SceneParameters
    >>> pane = SceneParameters(60.0, 20.0, 4.0)
    >>> pane.rung, pane.complete
    ('ghosts', True)

    The incidence is known, the rest is to be estimated:

    >>> asked = SceneParameters(60.0, None, None)
    >>> asked.complete
    False

    Water, and a screen behind the pane whose light is polarized to 60 % at 70 degrees:

    >>> SceneParameters(50.0, 90.0, 0.0, refractive_index=1.33, single_surface=True).rung
    'pixelwise'
    >>> pane.replace(transmission_polarization=(0.6, 70.0)).rung
    'polarized'
    """

    incidence_deg: float | None = 60.0
    azimuth_deg: float | None = 0.0
    ghost_shift: float | None = 6.3
    refractive_index: float | None = GLASS_INDEX
    n_bounces: int | None = None
    single_surface: bool = False
    transmission_polarization: tuple[float, float] = (0.0, 0.0)
    reflection_polarization: tuple[float, float] = (0.0, 0.0)
    literal_eq3: bool = False
    transmission_ghost_shift: float | None = None
    focal_px: float | None = None
    bend_deg_per_px: tuple[float, float, float] = (0.0, 0.0, 0.0)
    signal: bool = True
    n_panes: int | None = 1
    gap_shift: float | None = 0.0
    gap_azimuth_deg: float | None = None
    absorption: float | None = 0.0

    def __post_init__(self) -> None:
        check_numbers((name, getattr(self, name)) for name in _NUMBERS)
        check_flags((name, getattr(self, name)) for name in ("single_surface", "literal_eq3", "signal"))
        _check_incidence(self.incidence_deg)
        if self.refractive_index is not None:
            _check_index(self.refractive_index)
        for name in ("azimuth_deg", "gap_azimuth_deg", *_SHIFTS):
            value = getattr(self, name)
            if value is not None and not math.isfinite(value):
                raise InputError(f"{name} is {value}; give a finite number")
        for name in _SHIFTS:
            if abs(getattr(self, name) or 0.0) > FARTHEST_SHIFT_PX:
                raise InputError(f"{name} is {getattr(self, name)} px; it must be {FARTHEST_SHIFT_PX:g} or less")
        shortest, longest = FOCAL_RANGE_PX
        if self.focal_px is not None and not (shortest <= self.focal_px <= longest):
            raise InputError(
                f"the focal length is {self.focal_px} px; it must be more than 0: {shortest:g} to {longest:g}"
            )
        if not all(math.isfinite(part) for part in _parts("bend_deg_per_px", self.bend_deg_per_px, 3)):
            raise InputError(f"bend_deg_per_px is {self.bend_deg_per_px}; give three finite numbers, zeros for flat")
        if self.n_bounces is not None and not (self.n_bounces >= 0 and self.n_bounces % 1 == 0):
            raise InputError(
                f"n_bounces is {self.n_bounces}; give a whole number from 0 on, or leave it out for all bounces"
            )
        for name in ("transmission_polarization", "reflection_polarization"):
            dolp, aolp_deg = _parts(name, getattr(self, name), 2)
            if not 0 <= dolp <= 1:
                raise InputError(f"{name} has degree {dolp}; a degree of polarization lies in [0, 1]")
            if not math.isfinite(aolp_deg):
                raise InputError(f"{name} has angle {aolp_deg}; give degrees")
        self._check_window()
        for name in ("bend_deg_per_px", "transmission_polarization", "reflection_polarization"):
            # Lists, as of JSON: a scene is equal to one like it, and can be a key.
            if isinstance(getattr(self, name), list):
                object.__setattr__(self, name, tuple(getattr(self, name)))
        for name in ("n_bounces", "n_panes"):
            # Whole numbers that came as others.
            if isinstance(getattr(self, name), float):
                object.__setattr__(self, name, int(getattr(self, name)))

    def _check_window(self) -> None:
        """InputError where panes and tint are outside their ranges or contradict the other numbers."""
        n, absorption = self.n_panes, self.absorption
        if n is not None and not (1 <= n <= MOST_PANES and n % 1 == 0):
            raise InputError(f"n_panes is {n}; give a whole number from 1 to {MOST_PANES}")
        # Up to the last digit that is written of it.
        darkest = math.ceil(-1e3 * math.log(DARKEST_TINT)) / 1e3
        if absorption is not None and not 0 <= absorption <= darkest:
            raise InputError(f"the absorption is {absorption}; it must lie between 0 and {darkest:g}")
        if self.single_surface and ((n or 1) > 1 or absorption):
            raise InputError("a single surface is no window of panes, and has no tint; leave them or it out")
        if (n or 1) > 1 and (self.n_bounces is not None or self.literal_eq3):
            raise InputError("n_bounces and literal_eq3 are for a single pane; leave them out, or n_panes")

    @property
    def complete(self) -> bool:
        """Whether nothing is left to estimate."""
        window_known = None not in (self.n_panes, self.absorption) and (self.n_panes == 1 or self.gap_shift is not None)
        return window_known and all(getattr(self, name) is not None for name in (*SEARCHED, "refractive_index"))

    @property
    def index(self) -> float:
        """The refractive index of a scene of which it is known."""
        if self.refractive_index is None:
            raise InputError("the scene lacks refractive_index; estimate (`find_scene`) or set it first")
        return self.refractive_index

    @property
    def plainest(self) -> SceneParameters:
        """The same with one clear pane where panes or tint are to be found."""
        panes = 1 if self.n_panes is None else self.n_panes
        gap = 0.0 if self.gap_shift is None and panes == 1 else self.gap_shift
        return self.replace(n_panes=panes, gap_shift=gap, absorption=self.absorption or 0.0)

    @property
    def n_faces(self) -> int:
        """Faces that the light meets one after the other, at the fewest; two a pane."""
        return 1 if self.single_surface else 2 * (self.n_panes or 1)

    @property
    def sheets(self) -> tuple[bool, int, float]:
        """What of faces and glass decides how the whole reflects: single surface, number of panes, absorption."""
        return self.single_surface, self.n_panes or 1, self.absorption or 0.0

    @property
    def tint(self) -> float:
        """Share of the light from behind that tinted panes leave, each passed once."""
        return math.exp(-(self.n_panes or 1) * (self.absorption or 0.0))

    @property
    def stacked(self) -> bool:
        """Whether there is more than one pane."""
        return self.n_faces > 2

    @property
    def single_and_clear(self) -> bool:
        """Whether there is one pane, or one surface, and no tint."""
        return not self.stacked and not self.absorption

    @property
    def rung(self) -> Rung:
        """The simplest model of the ladder that these numbers are: what varies, shifts or arrives polarized."""
        if not self.signal:
            return "none"
        if self.polarized:
            return "polarized"
        if self.bent:
            return "curved"
        if self.focal_px is not None:
            return "perspective"
        return "ghosts" if self.has_ghosts else "pixelwise"

    @property
    def bent(self) -> bool:
        """Whether the pane's normal changes over the frame."""
        return any(self.bend_deg_per_px)

    @property
    def varies(self) -> bool:
        """Whether incidence and azimuth change over the frame."""
        return self.focal_px is not None or self.bent

    @property
    def has_ghosts(self) -> bool:
        """Whether either layer's bounces lie beside each other."""
        beside = self.ghost_shift or self.transmission_ghost_shift or (self.stacked and self.gap_shift)
        return bool(beside) and not self.single_surface

    @property
    def polarized(self) -> bool:
        """Whether either layer's light arrives polarized."""
        return self.transmission_polarization[0] > 0 or self.reflection_polarization[0] > 0

    def values(self) -> tuple[float, float, float]:
        """Incidence, azimuth and ghost shift of a complete scene."""
        if self.incidence_deg is None or self.azimuth_deg is None or self.ghost_shift is None:
            missing = [name for name in SEARCHED if getattr(self, name) is None]
            raise InputError(f"the scene lacks {', '.join(missing)}; estimate or set it first")
        return self.incidence_deg, self.azimuth_deg, self.ghost_shift

    def scaled(self, factor: float) -> SceneParameters:
        """The same scene in photographs with so many times the pixels a side."""
        check_numbers([("factor", factor)], none=False)
        if not 0 < factor < math.inf:
            raise InputError(f"factor is {factor}; give more than 0")
        changes: dict[str, object] = {
            name: None if getattr(self, name) is None else factor * getattr(self, name) for name in _LENGTHS
        }
        changes["bend_deg_per_px"] = tuple(bend / factor for bend in self.bend_deg_per_px)
        return self if factor == 1 else self.replace(**changes)

    def opposite(self) -> SceneParameters:
        """The same pane with all its double images on the other side."""
        shifts = {name: getattr(self, name) for name in ("ghost_shift", "transmission_ghost_shift", "gap_shift")}
        return self.replace(**{name: -shift for name, shift in shifts.items() if shift})

    def replace(self, **changes: object) -> SceneParameters:
        """Copy with some fields changed (names as in the constructor)."""
        return dataclasses.replace(self, **changes)  # type: ignore[arg-type]


# Relative difference of two ratios of sides that are the same but for whole pixels; set by hand.
_SAME_SHAPE = 0.01


def scale_between(size: tuple[int, ...], shape: tuple[int, ...]) -> float | None:
    """Pixels a side of photographs for each of others of one view; None where their sides are in other proportions.

    Parameters
    ----------
    size, shape : (int, int)
        Height and width in pixels of the others, and of the photographs.
    """
    down, along = shape[0] / size[0], shape[1] / size[1]
    return along if abs(down / along - 1) <= _SAME_SHAPE else None


_COUNTS = {2: "two", 3: "three"}


def _parts(name: str, parts: object, n: int) -> tuple[float, ...]:
    """InputError for what is not so many numbers."""
    if not isinstance(parts, tuple | list) or len(parts) != n:
        raise InputError(f"{name} is {parts!r}; give {_COUNTS[n]} finite numbers")
    check_numbers((name, part) for part in parts)
    return tuple(parts)


def _check_incidence(incidence_deg: float | None) -> None:
    if incidence_deg is not None and not 0 <= incidence_deg < 90:
        raise InputError(f"incidence is {incidence_deg} degrees; it must lie in [0, 90)")


def _check_index(refractive_index: float) -> None:
    if not 1 <= refractive_index <= HIGHEST_INDEX:
        raise InputError(
            f"the refractive index is {refractive_index}; it must be 1 or more, and {HIGHEST_INDEX:g} at most"
        )


def ghost_step(
    incidence_deg: float,
    refractive_index: float,
    thickness_px: float,
    kind: Literal["paper", "plate"] = "paper",
) -> float:
    """Distance between neighbouring ghosts of a plane-parallel pane.

    Parameters
    ----------
    incidence_deg : float
        Angle of incidence in degrees, in [0, 90).
    refractive_index : float
        Index of the pane, >= 1.
    thickness_px : float
        Thickness of the pane in pixels of the image.
    kind : {"paper", "plate"}
        "paper": ``2 d tan(theta_t) sin(theta_t)`` (Eq. (3) of the source paper);
        "plate": ``2 d tan(theta_t) cos(theta)``, the exact perpendicular offset.

    Returns
    -------
    float
        The step in pixels.

    Raises
    ------
    InputError
        An angle, index, thickness or kind outside its range.

    Examples
    --------
    >>> from polaropt import ghost_step
    >>> round(ghost_step(60.0, 1.5, thickness_px=10.0), 1)
    8.2
    >>> round(ghost_step(60.0, 1.5, thickness_px=10.0, kind="plate"), 1)
    7.1
    """
    numbers = {"incidence_deg": incidence_deg, "refractive_index": refractive_index, "thickness_px": thickness_px}
    check_numbers(numbers.items(), none=False)
    _check_incidence(incidence_deg)
    _check_index(refractive_index)
    if not 0 <= thickness_px < math.inf:
        raise InputError(f"the thickness is {thickness_px} px; it must be 0 or more")
    refracted = refraction_angle(incidence_deg, refractive_index)
    if kind == "paper":
        return 2 * thickness_px * math.tan(refracted) * math.sin(refracted)
    if kind == "plate":
        return 2 * thickness_px * math.tan(refracted) * math.cos(math.radians(incidence_deg))
    raise InputError(f"unknown kind of ghost step {kind!r}; there are: {', '.join(GHOST_STEPS)}")


def largest_search_shift(side: float) -> float:
    """Largest ghost shift that is searched in a frame whose shorter side has so many pixels."""
    return min(GHOST_SHIFT_SEARCH_PX, side / _SHIFTS_PER_FRAME)


@dataclass(frozen=True)
class SceneErrors:
    """Standard errors of those fields of `SceneParameters` that were estimated; None for all others.

    Attributes
    ----------
    incidence_deg, azimuth_deg, ghost_shift, transmission_ghost_shift, focal_px : float or None
    gap_shift, gap_azimuth_deg, absorption, refractive_index : float or None
    n_panes : None
        A whole number, found or not, has no standard error.
    bend_deg_per_px : (float, float, float) or None
    transmission_polarization, reflection_polarization : (float, float) or None
        Of degree and angle (degrees).
    """

    incidence_deg: float | None = None
    azimuth_deg: float | None = None
    ghost_shift: float | None = None
    transmission_ghost_shift: float | None = None
    focal_px: float | None = None
    bend_deg_per_px: tuple[float, float, float] | None = None
    transmission_polarization: tuple[float, float] | None = None
    reflection_polarization: tuple[float, float] | None = None
    n_panes: None = None
    gap_shift: float | None = None
    gap_azimuth_deg: float | None = None
    absorption: float | None = None
    refractive_index: float | None = None

    def __post_init__(self) -> None:
        for error in dataclasses.fields(self):
            value = getattr(self, error.name)
            parts = value if isinstance(value, tuple | list) else (value,)
            check_numbers((error.name, part) for part in parts)
            if any(part is not None and part < 0 for part in parts):
                raise InputError(f"the standard error of {error.name} is {value}; give 0 or more")

    def scaled(self, factor: float) -> SceneErrors:
        """Those of the same scene in photographs with so many times the pixels a side."""
        changes: dict[str, Any] = {
            name: None if getattr(self, name) is None else factor * getattr(self, name) for name in _LENGTHS
        }
        if self.bend_deg_per_px is not None:
            changes["bend_deg_per_px"] = tuple(bend / factor for bend in self.bend_deg_per_px)
        return dataclasses.replace(self, **changes)


@dataclass(frozen=True)
class Component:
    """One number of a field.

    Attributes
    ----------
    unit : str
        Empty for a plain number.
    digits : int
        Decimals that say as much as is ever known of it.
    words : str
        What it is in a field of several numbers, such as "degree"; empty in a field of one.
    period : float or None
        Values so far apart are the same; None where it is no angle that comes round.
    """

    unit: str
    digits: int
    words: str = ""
    period: float | None = None


@dataclass(frozen=True)
class Field:
    """One field of `SceneParameters` that holds a physical quantity: how it is called, shown and compared.

    Attributes
    ----------
    name : str
        Of the attribute of `SceneParameters`, and of its standard error in `SceneErrors` where it can be estimated.
    words : str
        As a sentence or the head of a table says it, without a capital.
    label : str
        The same in a word or two, where all around speaks of the pane.
    components : tuple of Component
        One for each of its numbers.
    """

    name: str
    words: str
    label: str
    components: tuple[Component, ...]

    @property
    def component(self) -> Component:
        """The only one of a field that holds a single number."""
        (only,) = self.components
        return only

    @property
    def estimable(self) -> bool:
        """Whether it can be estimated, and has a standard error then."""
        return self.name in SceneErrors.__dataclass_fields__


_SHIFT_PX = (Component("px", 2),)
_BEND = tuple(Component("deg/px", 4, part) for part in ("xx", "xy", "yy"))
# A direction of polarization is an axis: it comes round after half a turn.
_POLARIZATION = (Component("", 2, "degree"), Component("deg", 0, "angle", period=180.0))

# How many bounces are modelled, and how, is no quantity of the pane and not among them.
FIELDS = (
    Field("incidence_deg", "angle of incidence", "incidence", (Component("deg", 2),)),
    # Half a turn is the same pane with the opposite sign of its shifts; before a lens only a whole turn is the same.
    Field("azimuth_deg", "azimuth of the plane of incidence", "azimuth", (Component("deg", 2, period=180.0),)),
    Field("ghost_shift", "ghost shift", "ghost shift", _SHIFT_PX),
    Field("transmission_ghost_shift", "ghost shift of the transmission", "shift of the transmission", _SHIFT_PX),
    Field("n_panes", "number of panes", "panes", (Component("", 0),)),
    Field("gap_shift", "shift from pane to pane", "shift between panes", _SHIFT_PX),
    Field(
        "gap_azimuth_deg",
        "direction from pane to pane",
        "direction between panes",
        (Component("deg", 1, period=360.0),),
    ),
    Field("absorption", "absorption of one pass", "absorption", (Component("", 3),)),
    Field("focal_px", "focal length", "focal length", (Component("px", 0),)),
    Field("bend_deg_per_px", "bend of the pane", "bend", _BEND),
    Field("refractive_index", "refractive index", "refractive index", (Component("", 3),)),
    Field("transmission_polarization", "polarization of the light from behind", "light from behind", _POLARIZATION),
    Field("reflection_polarization", "polarization of the mirrored light", "mirrored light", _POLARIZATION),
)
"""The quantities of a scene in the order in which they are shown."""
