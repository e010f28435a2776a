"""Photographs moved onto each other, or both layers of them, and made as sharp as the sharpest.

At each frequency k photographs measure two or three numbers: the light, and what of it is polarized. These are found
from all photographs together, each weighed by how much of the frequency it still shows, and the photographs are what
ideal ones would show of them. What the others tell fills in what one has lost, so that nothing is amplified beyond it.
"""

from __future__ import annotations

from functools import cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.capture.capture import Capture
from polaropt.capture.matching.spectra import DetailSpectra, ring_of
from polaropt.capture.matching.transfer import Floats, LayerShifts, Spectrum, Transfer, pane_matrix, unmixing
from polaropt.capture.validity import MOST_NEGATIVE

Images = NDArray[np.float32]
Indices = NDArray[np.intp]
Mask = NDArray[np.bool_]

_TILE_PX, _PAD_PX = 512, 32
"""Side of the tiles that are restored at a time, and what is looked at around each; set by hand."""
_POLARIZED = 0.3
"""Standard deviation of the detail of polarized light, as a share of all light's, that is assumed where photographs
tell too little of it: behind glass; set by hand."""
_STIFFNESS = 0.1
"""Weight of what is assumed of the scene at frequencies that a photograph has lost; by trial."""
FOR_LAYERS, FOR_SCENE = 0.0, 10.0
"""Where such frequencies fade, in powers of light over noise: layers keep them, their solve deals with the noise, but
noise that light and polarized light share passes for double images. By trial."""
_SEED = 2026
"""Of the noise that is filled up."""
_MOST_NOISE = 10.0
"""Variance of the noise, over that of a photograph, up to which one that others tell is better than none; by hand."""


def restored(
    capture: Capture,
    transfer: Transfer,
    detail: DetailSpectra | None = None,
    fade: float = FOR_LAYERS,
    noise: float = 0.0,
) -> Capture:
    """The photographs with their shifts and blurs undone.

    Parameters
    ----------
    capture : Capture
        Photographs, no mosaic.
    transfer : Transfer
    detail : DetailSpectra, optional
        The scene's spectrum and the noise; needed where a photograph is blurred.
    fade : float
        Power of the light, over the noise's, at which half of a frequency that a photograph has lost is kept:
        `FOR_LAYERS` or `FOR_SCENE`.
    noise : float
        Standard deviation of one photograph's noise, where what has become less of it is to be filled up by chance, so
        that it is the same at all frequencies and in each photograph its own; where layers have made it more, all
        fades. 0: it is left as it is.

    Returns
    -------
    Capture
        Pixels that touch one that is not valid are not valid, nor are those beyond a photograph's edge.
    """
    images, (height, width) = capture.planes, capture.shape[-2:]
    of_angles = partial(_operator, angles_deg=capture.angles_deg)
    fill = _white_again if transfer.layers is not None else _missing_noise

    @cache
    def operator(shape: tuple[int, int]) -> tuple[Spectrum, Spectrum]:
        """What undoes a tile's transfer, and what makes of white noise that which it leaves too little of."""
        undone = of_angles(shape, transfer=transfer, detail=detail, fade=fade)
        return fill(undone) if noise else (undone, undone)

    # What blurs brought in over the edges would be spread over all photographs: there sharp ones are moved by
    # themselves, and tell the others.
    rim = _rim(transfer, (height, width)) if transfer.blurred else np.zeros((height, width), dtype=bool)
    shifts = Transfer(transfer.shifts_px, np.zeros_like(transfer.blurs_px2))
    alone = cache(partial(of_angles, transfer=shifts, detail=None, fade=fade))
    made, random = np.empty_like(images), np.random.default_rng(_SEED)
    for top in range(0, height, _TILE_PX):
        for left in range(0, width, _TILE_PX):
            rows, columns = _mirrored(top, height), _mirrored(left, width)
            part = np.s_[top : top + _TILE_PX, left : left + _TILE_PX]
            tile, shape = images[:, :, rows[:, None], columns], (rows.size, columns.size)
            undone, filled = operator(shape)
            made[:, :, *part] = _applied(undone, tile)
            if noise:
                chance = noise * random.standard_normal(tile.shape, dtype=np.float32)
                made[:, :, *part] += _applied(filled, chance)
            if rim[part].any():
                by_sharp = np.einsum(
                    "kl,lcyx->kcyx", _of_sharp(transfer, capture.angles_deg), _applied(alone(shape), tile)
                )
                np.copyto(made[:, :, *part], by_sharp, where=rim[part])
    np.clip(made, min(0.9 * MOST_NEGATIVE, float(images.min())), max(1.0, float(images.max())), out=made)
    valid = _untouched(capture, transfer)
    return capture.replace(intensities=made.reshape(capture.intensities.shape), valid=valid)


def _of_sharp(transfer: Transfer, angles_deg: tuple[float, ...]) -> NDArray[np.float32]:
    """What makes photographs (k) of sharp ones alone, in place, (k, k); where these do not tell one, it stays."""
    made = np.eye(len(angles_deg))
    blurred = transfer.blurs_px2.any(axis=(1, 2))
    of_pane = pane_matrix(angles_deg, transfer.azimuth_deg or 0.0)
    told = of_pane @ np.linalg.pinv(of_pane[~blurred])
    for k in np.flatnonzero(blurred & (np.square(told).sum(axis=1) < _MOST_NOISE)):
        made[k] = 0
        made[k, ~blurred] = told[k]
    return made.astype(np.float32)


def _mirrored(start: int, length: int) -> Indices:
    """Indices of a tile and what lies around it, mirrored beyond both ends."""
    stop = min(start + _TILE_PX, length)
    around = np.arange(start - _PAD_PX, stop + _PAD_PX) % (2 * length)
    return np.minimum(around, 2 * length - 1 - around)


def _applied(operator: Spectrum, tile: Images) -> Images:
    """A tile on which an operator has worked, without what lies around it."""
    from scipy.fft import irfft2, rfft2

    spectra = np.einsum("klyx,lcyx->kcyx", operator, rfft2(tile))
    made = irfft2(spectra, s=tile.shape[-2:])
    return np.asarray(made[..., _PAD_PX:-_PAD_PX, _PAD_PX:-_PAD_PX], dtype=np.float32)


def _operator(
    shape: tuple[int, int],
    transfer: Transfer,
    detail: DetailSpectra | None,
    angles_deg: tuple[float, ...],
    fade: float,
) -> Spectrum:
    """What makes spectra of ideal photographs of those of a tile, (k, k, h, w)."""
    rows, columns = np.fft.fftfreq(shape[0])[:, None], np.fft.rfftfreq(shape[1]).astype(np.float64)
    seen = transfer.at(rows, columns)
    turned = np.exp(-1j * np.angle(seen))
    if transfer.layers is not None:
        return _layers_in_place(rows, columns, transfer.layers, turned, angles_deg)
    if detail is None or transfer.azimuth_deg is None:
        # Shifts alone: each photograph by itself.
        identity: Any = np.eye(len(seen))[:, :, None, None]
        return np.asarray(identity * turned, dtype=np.complex64)
    of_pane = pane_matrix(angles_deg, transfer.azimuth_deg)
    share = np.square(np.abs(seen))
    known = np.einsum("ka,kyx,kb->yxab", of_pane, share, of_pane)
    light = _light(rows, columns, detail, int(np.argmin(transfer.blurs_px)))
    # Nothing is assumed where all photographs are sharp.
    lost = _STIFFNESS * (1 - share.min(axis=0)) / light
    known[..., 0, 0] += lost
    known[..., 1, 1] += lost / _POLARIZED**2
    told = np.einsum("yxab,kb,kyx->yxak", np.linalg.inv(known), of_pane, seen.conj())
    # What a pane does not explain stays as it is, so that it can be seen, and noise be measured.
    beside = np.eye(len(seen)) - of_pane @ np.linalg.pinv(of_pane)
    explained = np.einsum("kyx,ka,yxal->klyx", seen, of_pane, told)
    unexplained = np.eye(len(seen))[:, :, None, None] - explained
    made = np.einsum("ka,yxal->klyx", of_pane, told) + np.einsum("km,myx,mlyx->klyx", beside, turned, unexplained)
    # Light and polarized light fade together, or the pane would look another.
    fading = 1 / (1 + fade * (1 - share.min(axis=0)) / light)
    return np.asarray(fading * made, dtype=np.complex64)


def _layers_in_place(
    rows: Floats, columns: Floats, layers: LayerShifts, turned: Spectrum, angles_deg: tuple[float, ...]
) -> Spectrum:
    """What makes photographs of which both layers lie in place of such where they do not, (k, k, h, w).

    What no two layers explain is moved with the first.
    """
    mixing = layers.at(rows, columns, angles_deg)
    unmixed = unmixing(mixing)
    beside = np.moveaxis(turned, 0, -1)[..., None] * (np.eye(len(angles_deg)) - mixing @ unmixed)
    made = layers.in_place(angles_deg) @ unmixed + beside
    return np.asarray(np.moveaxis(made, (-2, -1), (0, 1)), dtype=np.complex64)


def _missing_noise(operator: Spectrum) -> tuple[Spectrum, Spectrum]:
    """An operator (k, k, h, w), and what makes of white noise that of which it leaves too little."""
    left = np.square(np.abs(operator)).sum(axis=1)
    each: Any = np.eye(len(operator))[:, :, None, None]
    return operator, np.asarray(each * np.sqrt(np.maximum(1 - left, 0)), dtype=np.complex64)


def _white_again(operator: Spectrum) -> tuple[Spectrum, Spectrum]:
    """An operator (k, k, h, w) that fades where it makes noise more, and what makes noise the same everywhere again.

    All photographs fade alike, so that the pane looks the same; their noise is then as it was, each photograph's its
    own. Otherwise what layers that moved by themselves leave of it, which repeats at their distance, would pass for
    double images.
    """
    mixing = np.moveaxis(operator, (0, 1), (-2, -1))
    variance, axes = np.linalg.eigh(mixing @ mixing.conj().swapaxes(-1, -2))
    share = 1 / np.maximum(variance[..., -1:], 1)
    missing = (axes * np.sqrt(np.maximum(1 - share * variance, 0))[..., None, :]) @ axes.conj().swapaxes(-1, -2)
    return operator * np.sqrt(share[..., 0]), np.moveaxis(missing, (-2, -1), (0, 1)).astype(np.complex64)


def _light(rows: Floats, columns: Floats, detail: DetailSpectra, sharpest: int) -> Floats:
    """Power of the light (twice a photograph's amplitude) at frequencies, in units of a photograph's noise."""
    return np.asarray(4 * np.maximum(detail.power[sharpest] - 1, 1e-3)[ring_of(rows, columns)])


def _untouched(capture: Capture, transfer: Transfer) -> Mask:
    """Valid pixels that no pixel around them spoils which is not valid, and that each photograph shows."""
    from scipy.ndimage import binary_erosion

    valid = capture.valid
    if transfer.mixes and not valid.all():
        valid = np.broadcast_to(valid.all(axis=0), valid.shape)
    square = np.ones((1,) * (valid.ndim - 3) + (2 * transfer.reach_px + 1,) * 2, dtype=bool)
    kept = np.stack([one if one.all() else binary_erosion(one, square, border_value=1) for one in valid])
    if transfer.layers is not None:
        return kept & ~_rim(transfer, valid.shape[-2:])
    for one, shift in zip(kept, transfer.shifts_px, strict=True):
        one &= _within(shift, valid.shape[-2:])
    return kept


def _rim(transfer: Transfer, shape: tuple[int, ...]) -> Mask:
    """Pixels (h, w) that may have been mixed with what lies beyond the frame."""
    reach = transfer.reach_px
    rim = np.ones(shape, dtype=bool)
    rim[reach:-reach, reach:-reach] = False
    return rim


def _within(shift: Floats, shape: tuple[int, ...]) -> Mask:
    """Pixels (h, w) whose place in a shifted photograph lies within its frame, to half a pixel."""
    rows, columns = (
        np.abs(np.arange(side) + offset - (side - 1) / 2) <= side / 2
        for side, offset in zip(shape, shift.tolist(), strict=True)
    )
    return np.asarray(rows[:, None] & columns)
