"""Which of several panes before polarized light is taken: the likeliest, and the simplest that cannot be told from it.

References
----------
Q. H. Vuong, Likelihood ratio tests for model selection and non-nested hypotheses, Econometrica, 1989.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from polaropt.jackknife import jackknife_error, left_out
from polaropt.polarized_light import Candidate
from polaropt.polarized_likelihood import PolarizedLikelihood
from polaropt.polarized_search import Found, Search

_CLOSE, _MOST = 0.02, 3
"""Candidates whose rough scores differ by less are compared closely, so many at most."""
_SAME_PLACE = np.array([3.0, 3.0, 0.5])
_SURE = 2.5
"""Standard errors by which the less usual polarized light must explain more: behind the pane, and in both layers."""


def finalists(rough: Sequence[Found]) -> list[Candidate]:
    """Candidates that may be the best, without those that came to the same place as a better one of their kind.

    The best one with a single polarized layer is always among them, and the best one with each where both come close.
    """
    ranked = sorted(rough, key=lambda found: found.score)
    chosen: list[Candidate] = []
    for found in ranked:
        candidate = found.candidate
        alike = [other for other in chosen if _kind(other) == _kind(candidate)]
        new = all(np.any(np.abs(candidate.point - other.point)[:3] > _SAME_PLACE) for other in alike)
        close = found.score <= ranked[0].score + _CLOSE
        first = _single(candidate) and (not any(_single(other) for other in chosen) or (close and not alike))
        if first or (new and len(chosen) < _MOST and close):
            chosen.append(candidate)
    return chosen


def choose(search: Search, likelihood: PolarizedLikelihood, candidates: Sequence[Candidate]) -> Found:
    """The likeliest candidate, where spectra and edges put it, with polarized light in both layers if that is sure.

    Two polarized layers before unknown ghosts explain nearly anything a little better. How much better may be an
    accident of the spectra of these layers: then all of it comes from few of their directions and bands. So it may
    where a screen is a little likelier than a mirrored sky. A sky is mirrored more often than a screen is so weakly
    polarized as to look like one, and where a sky is taken for a screen another incidence makes up for its light.
    """
    fine = [search.finely(candidate) for candidate in candidates]
    single = _single_layer(search, likelihood, [found for found in fine if _single(found.candidate)])
    rivals = [found for found in fine if not _single(found.candidate)]
    both = min((*rivals, search.with_both_polarized(single)), key=_score)
    return search.finished(both if _surely_better(likelihood, both, single) else single)


def _single_layer(search: Search, likelihood: PolarizedLikelihood, fine: Sequence[Found]) -> Found:
    """The best one with a single polarized layer: the mirrored one's unless the other's is surely better."""
    best = search.beyond_brewster(min(fine, key=_score))
    skies = [found for found in fine if found.candidate.reflection]
    if best.candidate.reflection or not skies:
        return best
    sky = min(skies, key=_score)
    return best if _surely_better(likelihood, best, sky) else sky


def _surely_better(likelihood: PolarizedLikelihood, found: Found, simpler: Found) -> bool:
    """Whether a gain in score exceeds what it scatters over parts of the spectra."""
    gains = likelihood.sectors(simpler.candidate.point) - likelihood.sectors(found.candidate.point)
    return simpler.score - found.score > _SURE * jackknife_error(left_out(gains))


def _single(candidate: Candidate) -> bool:
    return not (candidate.transmission and candidate.reflection)


def _kind(candidate: Candidate) -> tuple[bool, bool]:
    return candidate.transmission, candidate.reflection


def _score(found: Found) -> float:
    return found.score
