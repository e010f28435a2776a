"""Any number of plane faces, one behind another: what the whole passes and mirrors, by the star product.

With rho the reflection and tau the transmission entry of a face, and z what a passage there and back does to its light,
a face before a system (T, R) makes a system again, all bounces between the two summed:

    mirrored  ``rho + tau^2 z R / (1 - rho z R)``
    passed    ``tau T / (1 - rho z R)``

(R. Redheffer, On a certain linear fractional transformation, Journal of Mathematics and Physics 39, 1960; for one face,
which reflects alike from both sides). It holds for each of the three diagonal Mueller entries and for every frequency.
The light is incoherent; what is passed is referred to the straight view and to one passage of everything.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray


class System(NamedTuple):
    """Faces as one: entries of the light that they pass, and of that which they mirror to the front."""

    passed: Any
    mirrored: Any


def before(rho: Any, tau: Any, z: Any, system: System) -> System:
    """A face before a system."""
    return _joined(rho, tau, z, system, 1 - rho * z * system.mirrored)


def _joined(rho: Any, tau: Any, z: Any, system: System, left: Any) -> System:
    once = tau / left
    return System(once * system.passed, rho + tau * z * system.mirrored * once)


def before_in_place(rho: Any, tau: Any, passed_twice: Any, system: System) -> System:
    """The same where no image is shifted, so that a passage only absorbs: precise at grazing incidence, too."""
    left = 1 - rho * passed_twice * system.mirrored
    # What leaves, written in what is passed, does not cancel; what is absorbed, and what differs in phase, adds to it.
    return _joined(rho, tau, passed_twice, system, np.maximum(left, tau + system.passed - tau * system.passed))


def faces(rho: Any, tau: Any, passages: list[Any], join: Any = before) -> System:
    """A row of equal faces.

    Parameters
    ----------
    rho, tau : array
        Entries of one.
    passages : list
        What there and back between neighbours does, from the last two to the first two.
    join : callable
        `before` or `before_in_place`.
    """
    system = System(tau, rho)
    for z in passages:
        system = join(rho, tau, z, system)
    return system


def passages(n_faces: int, pane: Any, gap: Any) -> list[Any]:
    """Passages of panes and of the gaps between them, in turns."""
    return [gap if k % 2 else pane for k in range(n_faces - 1)]


Weights = NDArray[np.float64]

# Images on a side of the square of orders that is looked at, and the most; light in the outer half that may fold back.
_SIDE, _LARGEST_SIDE, _FOLDED = 16, 256, 1e-9
FACES_OF_A_PANE = 2


def image_weights(rho: Any, tau: Any, n_faces: int, passed_twice: Any, side: int | None = None) -> Weights:
    """How bright each image is that lies i shifts of a pane and j shifts of a gap from the direct one.

    The coefficients of a power series in both passages, from its values on the unit circles.

    Parameters
    ----------
    rho, tau : ndarray, shape (entries,)
    n_faces : int
    passed_twice : float or ndarray, shape (entries,)
        What of the light is left after a pane there and back.
    side : int, optional
        Orders of either kind. Default: as many as carry light.

    Returns
    -------
    ndarray, shape (2, i, j, entries)
        [0] transmission, [1] reflection.
    """
    trial = side or _SIDE
    while True:
        z = np.exp(-2j * np.pi * np.arange(trial) / trial)[:, None]
        system = faces(rho, tau, passages(n_faces, passed_twice * z[:, None], z))
        # A single pane has no gap.
        of_gaps = trial if n_faces > FACES_OF_A_PANE else 1
        values = np.stack([np.broadcast_to(part, (trial, of_gaps, len(rho))) for part in system])
        weights: Weights = np.zeros((2, trial, trial, len(rho)))
        weights[:, :, :of_gaps] = np.fft.ifft2(values, axes=(1, 2)).real
        if side or trial >= _LARGEST_SIDE:
            return weights
        half = trial // 2
        if max(np.abs(weights[:, half:]).sum(), np.abs(weights[:, :, half:]).sum()) < _FOLDED:
            return weights
        trial *= 2
