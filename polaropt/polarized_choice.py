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
"""Standard errors by which polarized light in both layers must explain more than in one."""


def finalists(rough: Sequence[Found]) -> list[Candidate]:
    """Candidates that may be the best, without those that came to the same place as a better one.

    The best one with a single polarized layer is always among them.
    """
    ranked = sorted(rough, key=lambda found: found.score)
    chosen: list[Candidate] = []
    for found in ranked:
        candidate = found.candidate
        new = all(np.any(np.abs(candidate.point - other.point)[:3] > _SAME_PLACE) for other in chosen)
        first = _single(candidate) and not any(_single(other) for other in chosen)
        if first or (new and len(chosen) < _MOST and found.score <= ranked[0].score + _CLOSE):
            chosen.append(candidate)
    return chosen


def choose(search: Search, likelihood: PolarizedLikelihood, candidates: Sequence[Candidate]) -> Found:
    """The likeliest candidate, where spectra and edges put it, with polarized light in both layers if that is sure.

    Two polarized layers before unknown ghosts explain nearly anything a little better. How much better may be an
    accident of the spectra of these layers: then all of it comes from few of their directions and bands.
    """
    fine = [search.finely(candidate) for candidate in candidates]
    single = search.beyond_brewster(min((found for found in fine if _single(found.candidate)), key=_score))
    rivals = [found for found in fine if not _single(found.candidate)]
    both = min((*rivals, search.with_both_polarized(single)), key=_score)
    return search.finished(both if _surely_better(likelihood, both, single) else single)


def _surely_better(likelihood: PolarizedLikelihood, found: Found, simpler: Found) -> bool:
    """Whether a gain in score exceeds what it scatters over parts of the spectra."""
    gains = likelihood.sectors(simpler.candidate.point) - likelihood.sectors(found.candidate.point)
    return simpler.score - found.score > _SURE * jackknife_error(left_out(gains))


def _single(candidate: Candidate) -> bool:
    return not (candidate.transmission and candidate.reflection)


def _score(found: Found) -> float:
    return found.score
