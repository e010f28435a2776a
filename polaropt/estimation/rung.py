"""What a rung of the ladder has to go by, and what it makes of it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from polaropt.capture import Capture, StokesImages, closure_share
from polaropt.estimation.flat.estimate import SceneEstimate
from polaropt.estimation.flat.samples.ghosts import is_told_by_samples
from polaropt.estimation.flat.samples.light import PolarizedPane, polarized_pane
from polaropt.estimation.flat.samples.single import REACH_PX
from polaropt.estimation.flat.samples.tiles import SampledTiles
from polaropt.estimation.polarized.mixing import OBLIQUE_DEG
from polaropt.estimation.wide.blocks import SCATTERS, PolarizedBlocks
from polaropt.optics import Rival, SceneErrors, SceneParameters

# Mean square, in units of the noise, up to which polarized light counts as explained, beside its own scatter. Set
# by hand.
_TOLERANCE = 0.1
# The same of a mosaic's cells: fine detail aliases to more than its noise is measured to be. By trial, on simulated
# mosaics sharper than lenses make them; a real capture before a lens that must be seen leaves 7.
MOST_OF_ALIASES = 2.5
# Larger blocks of a mosaic's cells, along the longer side, at most, in which there is less of what aliases, and the
# same of these. Of 384 random mosaics (`studies.random_windows`, mono and color, even seeds from 9620000 and 9990000)
# one of 216 of flat panes before unpolarized light leaves more there, 77 of 92 before polarized light do, and 41 of 48
# of wide lenses and bent panes; in small blocks it was one, 61 and 34.
_LARGE_BLOCKS, _MOST_IN_LARGE = 24, 2.2
# Share of what the plain pane leaves that a higher rung must explain. Set by hand.
LEAST_EXPLAINED = 0.5
# How many times the share of the light that does not add up may be polarized at 45 degrees to the plane of incidence
# for wrong gains. Gains of equal spread leave sqrt(2) times as much there, and of what is told by one number Student's
# distribution has 85 % below 4.2. Of ten random windows to fit on with wrong gains nine stay below 1.3, one has 4.7.
_OF_GAINS = 6.0
# Chance that light is polarized that tiles of a mosaic surely tell, and its cells do not. Set by hand: where it is not
# something else is mostly wrong, as the index.
_CHANCE_OF_LIGHT = 0.5
# What the plain pane counts as leaving at least, beyond noise of 1, where shares are taken of it. Set by hand.
_LEAST_LEFT = 1e-9


@dataclass(frozen=True)
class Evidence:
    """What an attempt has to go by.

    Attributes
    ----------
    capture : Capture
    noise : float
    stokes : StokesImages
    blocks : PolarizedBlocks
    asked : SceneParameters
        Fields that are None are to be found.
    estimate : SceneEstimate
        The plain pane that explains the capture best.
    misfit : float
        Polarized light that it leaves: mean square over `blocks`, in units of the noise.
    wanted : str
        Name of the rung that was asked for, or "auto".
    mosaic : SampledTiles, optional
        Tiles of the mosaic that the capture is the cells of, where there are enough.
    """

    capture: Capture
    noise: float
    stokes: StokesImages
    blocks: PolarizedBlocks
    asked: SceneParameters
    estimate: SceneEstimate
    misfit: float
    wanted: str
    mosaic: SampledTiles | None = None

    @property
    def focal_px(self) -> float | None:
        """Focal length, where it was asked for or the camera told it."""
        return self.asked.focal_px or self.capture.focal_px

    @property
    def scatter(self) -> float:
        """Standard deviation of a misfit that is nothing but noise."""
        return math.sqrt(2 / self.blocks.n)

    @property
    def polarized_share(self) -> float:
        """What the plain pane leaves polarized beyond the noise, as a share of the light; root mean squares."""
        light = float(np.mean(np.square(self.blocks.stokes[0])))
        return math.sqrt(max(self.misfit - 1, 0.0) / light) if light > 0 else 0.0

    @property
    def explained(self) -> bool:
        """Whether the plain pane leaves nothing but noise, and what aliases."""
        return self.misfit <= self.most_unexplained and self._misfit_of_large <= _MOST_IN_LARGE

    @property
    def is_oblique(self) -> bool:
        """Whether the plain pane is so far from frontal that the directions of both layers' light can be told."""
        return self.estimate.scene.values()[0] > OBLIQUE_DEG

    @property
    def most_shown(self) -> float:
        """The misfit, or that of large blocks of a mosaic's cells, where these show more."""
        return max(self.misfit, self._misfit_of_large)

    @cached_property
    def _misfit_of_large(self) -> float:
        """What large blocks of a mosaic's cells show that the plain pane leaves, looked at once; 0 of photographs.

        So it is of frontal glass, which polarizes so little that other explanations of it tell nothing.
        """
        if not self.stokes.aliased or not self.is_oblique:
            return 0.0
        return PolarizedBlocks(self.stokes, _LARGE_BLOCKS).constant_misfit(self.estimate.scene.values()[1])

    @property
    def most_unexplained(self) -> float:
        """Misfit up to which nothing is left but noise, and what aliases."""
        return MOST_OF_ALIASES if self.stokes.aliased else noise_misfit(self.blocks.n)

    @property
    def light_is_open(self) -> bool:
        """Whether polarized light is for us to find: what a wrong azimuth leaves it explains, and makes worse."""
        asked = self.asked
        return not asked.polarized and asked.focal_px is None and asked.azimuth_deg is None

    @property
    def gains_explain(self) -> bool:
        """Whether photographs that do not add up tell of gains that leave as much as the plain pane does.

        Wrong gains tilt the plane of the Stokes vectors just as polarized light does.
        """
        return self.apart > 0 and self.polarized_share <= _OF_GAINS * self.apart

    @cached_property
    def apart(self) -> float:
        """Share of the light by which photographs do not add up, see `closure_share`: of all pixels, looked at once."""
        capture = self.capture
        return closure_share(capture.intensities, capture.angles_deg, capture.mask)

    @property
    def tiles_tell_light(self) -> bool:
        """Whether tiles of a mosaic can tell that light arrives polarized: of a single clear pane, ghosts near by."""
        scene, mosaic = self.estimate.scene, self.mosaic
        if mosaic is None or scene.absorption or not is_told_by_samples(scene):
            return False
        return abs(mosaic.period * scene.values()[2]) <= REACH_PX

    @cached_property
    def light_of_tiles(self) -> PolarizedPane | None:
        """The pane before polarized light that tiles of the mosaic tell, in pixels of the sensor; looked for once."""
        mosaic = self.mosaic
        if mosaic is None or not self.tiles_tell_light:
            return None
        return polarized_pane(mosaic, self.estimate.scene.scaled(mosaic.period), self.asked)

    @property
    def polarized_rivals(self) -> tuple[Rival, ...]:
        """A pane before polarized light that may be the true one, where the cells of a mosaic tell a plain pane."""
        mosaic, light = self.mosaic, self.light_of_tiles
        if mosaic is None or light is None or not light.is_possible:
            return ()
        return (Rival(light.scene.scaled(1 / mosaic.period), _CHANCE_OF_LIGHT),)

    def shown(self, misfit: float) -> bool:
        """Whether a rung that leaves this much polarized light explains more than chance would."""
        return self.misfit - misfit > SCATTERS * self.scatter

    def share_explained(self, misfit: float) -> float:
        """Part of what the plain pane leaves that a rung explains that leaves this much polarized light."""
        return (self.misfit - misfit) / max(self.misfit - 1, _LEAST_LEFT)


def noise_misfit(n: int) -> float:
    """Largest misfit of n blocks that counts as noise."""
    return 1 + _TOLERANCE + SCATTERS * math.sqrt(2 / n)


@dataclass(frozen=True)
class RungFit:
    """What a rung makes of the evidence.

    Attributes
    ----------
    scene : SceneParameters
        Complete.
    misfit : float
        Polarized light that it leaves, as `Evidence.misfit`.
    n_parameters : int
        Numbers fitted to the blocks.
    known : bool
        Whether the capture tells these numbers well enough to rely on them.
    remark : str
        A sentence for `RungReport.reason`: why they are not known, or what else is to be said. May be empty.
    errors : SceneErrors
        Standard errors of those numbers.
    agreed_misfit : float or None
        What the misfit would be if the blocks that disagree, as their own scene is polarized, did not count; rungs are
        compared by this one where there is one.
    told_by_edges : bool
        Whether edges and spectra tell these numbers, even where the plain pane leaves no polarized light.
    second_choice : bool
        Whether it is to be taken where no other rung explains what the plain pane leaves: edges speak against it.
    rivals : tuple of Rival
        Other scenes that explain the capture about as well.
    """

    scene: SceneParameters
    misfit: float
    n_parameters: int
    known: bool
    remark: str = ""
    errors: SceneErrors = SceneErrors()  # noqa: RUF009 (frozen)
    agreed_misfit: float | None = None
    told_by_edges: bool = False
    second_choice: bool = False
    rivals: tuple[Rival, ...] = ()

    @property
    def compared(self) -> float:
        """The misfit that rungs are compared by."""
        return self.misfit if self.agreed_misfit is None else self.agreed_misfit


@dataclass(frozen=True)
class Rung:
    """A name, when the rung can help, and the attempt."""

    name: str
    may_help: Callable[[Evidence], bool]
    attempt: Callable[[Evidence], RungFit]
