"""Pane, ghosts and the polarization of both layers' light, found blind.

The directions of the two Stokes vectors (`polarized_mixing`) leave a handful of panes that show them in place
(`polarized_light`); of these, each with its likeliest ghosts, the one is taken that explains the capture best, with
the least polarized light that does (`polarized_search`).
"""

from __future__ import annotations

from dataclasses import dataclass

from polaropt.plate_frame import StokesImages
from polaropt.polarized_choice import choose, finalists
from polaropt.polarized_light import candidates, scene_at
from polaropt.polarized_likelihood import PolarizedLikelihood
from polaropt.polarized_mixing import Mixture
from polaropt.polarized_search import Search
from polaropt.scene import SceneParameters
from polaropt.scene_errors import SceneErrors


@dataclass(frozen=True)
class PolarizedFit:
    """A pane before polarized light.

    Attributes
    ----------
    scene : SceneParameters
        Complete.
    misfit : float
        Mean square of coarse light that no two layers make behind this pane, in units of the noise: 1 where the model
        holds.
    n : int
        How many numbers it is the mean of.
    errors : SceneErrors
    gain : float
        How much more likely the polarized light makes the capture, per frequency and colour, doubt deducted: the plain
        pane's score less this one's.
    """

    scene: SceneParameters
    misfit: float
    n: int
    errors: SceneErrors
    gain: float


def fit_polarized(stokes: StokesImages, asked: SceneParameters, plain: SceneParameters) -> PolarizedFit | None:
    """Fit a pane whose layers' light may arrive polarized, a constant degree and angle each.

    Parameters
    ----------
    stokes : StokesImages
    asked : SceneParameters
        Fields that are None are estimated; index and surfaces are used. Polarization of the layers' light is estimated.
    plain : SceneParameters
        The pane that explains the capture best with unpolarized layers, to be compared with.

    Returns
    -------
    PolarizedFit or None
        None where no pane shows what the capture shows.
    """
    likelihood = PolarizedLikelihood(stokes, asked)
    mixture = Mixture(stokes)
    search = Search(likelihood, mixture, asked)
    rough = search.rough(candidates(mixture.vectors(), asked))
    if not rough:
        return None
    best = choose(search, likelihood, finalists(rough))
    point, gain = best.candidate.point, search.unpolarized(plain) - best.score
    return PolarizedFit(scene_at(point, asked), *likelihood.leftover(point), search.errors(best.candidate), gain)
