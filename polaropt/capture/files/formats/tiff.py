"""TIFF: one page, or several."""

from __future__ import annotations

import io
import logging
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.capture.capture import FileContent
from polaropt.capture.files.exif import facts_of_tags, profile_name
from polaropt.capture.files.focal_length import exif_of_names, focal_from_exif
from polaropt.capture.files.formats.pictures import without_alpha
from polaropt.errors import InputError

Pixels = NDArray[Any]


def decode_tiff(data: bytes) -> FileContent:
    import tifffile

    with _complaints_of_tifffile() as complaints, tifffile.TiffFile(io.BytesIO(data)) as tiff:
        series = [s for s in tiff.series if not s.keyframe.is_reduced] or list(tiff.series)
        arrays = [_channels_last(one.asarray(), one.axes) for one in series]
        metadata = (tiff.shaped_metadata or ({},))[0]
        tags = {tag.code: tag.value for tag in tiff.pages.first.tags}
        profile = tags.get(_TIFF_PROFILE)
        named = tags.get(_TIFF_EXIF)
        exif = exif_of_names(named)
        colors = profile_name(profile if isinstance(profile, bytes) else None)
        camera = facts_of_tags(tags, named if isinstance(named, dict) else None, colors)
    if not arrays or any("page offset" in text or "first page" in text or "corrupted" in text for text in complaints):
        raise InputError("the TIFF ends too early; it is incomplete, copy it again")
    angles = metadata.get("angles_deg")
    angles_deg = tuple(float(angle) for angle in angles) if angles else None
    pages = [page for array, stack in arrays for page in (array if stack else array[None])]
    if len({page.shape for page in pages}) > 1:
        sizes = ", ".join(sorted({f"{page.shape[1]}x{page.shape[0]}" for page in pages}))
        raise InputError(f"its pages differ in size ({sizes}); all photographs must have the same")
    focal = focal_from_exif(exif, (pages[0].shape[1], pages[0].shape[0]))
    if len(pages) == 1:
        return FileContent(pages[0], angles_deg=angles_deg, focal_px=focal, camera=camera)
    return FileContent(np.stack(pages), stack=True, angles_deg=angles_deg, focal_px=focal, camera=camera)


_TIFF_EXIF, _TIFF_PROFILE = 0x8769, 0x8773
"""Tags of TIFF: the directory of EXIF's tags, and the colour profile."""


def _channels_last(pixels: Pixels, axes: str) -> tuple[Pixels, bool]:
    """Pages (k, h, w[, channel]) or one page (h, w[, channel]); and whether there is a page axis."""
    if "S" in axes:
        pixels = without_alpha(np.moveaxis(pixels, axes.index("S"), -1))
    leading = [axis for axis in axes if axis not in "YXS"]
    if not leading:
        return pixels, False
    height_at = len(leading)
    return pixels.reshape(-1, *pixels.shape[height_at:]), True


@contextmanager
def _complaints_of_tifffile() -> Iterator[list[str]]:
    """Collect what tifffile would print about a damaged file."""
    logger = logging.getLogger("tifffile")
    complaints: list[str] = []

    class Collector(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            complaints.append(record.getMessage())

    collector, propagated = Collector(), logger.propagate
    others = list(logger.handlers)
    logger.handlers, logger.propagate = [collector], False
    try:
        yield complaints
    finally:
        logger.handlers, logger.propagate = others, propagated
