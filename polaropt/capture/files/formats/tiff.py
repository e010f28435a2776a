"""TIFF: one page, or several."""

from __future__ import annotations

import io
import math
import struct
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from polaropt.capture.capture import EncodingHint, FileContent
from polaropt.capture.files.child import decoded_in_child
from polaropt.capture.files.colors import color_profile
from polaropt.capture.files.exif import FACTS, facts_of_tags
from polaropt.capture.files.focal_length import exif_of_names, focal_from_exif
from polaropt.capture.files.formats.pictures import stronger_hint, without_alpha
from polaropt.capture.files.jpeg import jpeg_traces
from polaropt.capture.files.limits import MAX_PIXELS, Declared, check_declared, complaints
from polaropt.capture.files.opening import AnyPath
from polaropt.errors import InputError, one_line

Pixels = NDArray[Any]


_BOUNDED = (1, 5, 8, 32773, 32946)
"""Compressions that are undone here, as their decoders make no more than they are asked for: none, LZW, deflate,
PackBits. The libraries of all others work in a process with limits."""
_OF_LIGHT = (1, 2, 32803, 34892)
"""What values may stand for (tag PhotometricInterpretation): grey from black up, red, green and blue, a mosaic of
colours, and what a sensor measured."""
_OTHERS = {
    0: "grey from white down",
    3: "numbers of a palette's colours",
    5: "inks (CMYK)",
    6: "luma and colour differences (YCbCr)",
    8: "CIE L*a*b* colours",
    9: "ICC L*a*b* colours",
    10: "ITU L*a*b* colours",
    32844: "CIE log2(L) light",
    32845: "CIE log2(L) light and colour",
}
_YCBCR, _JPEG = 6, (6, 7, 33007)
"""Luma and colour differences, and compressions whose decoders make red, green and blue of them."""
_MOST_PAGES = 65536
"""Pages of a file; set by hand."""
_LONGEST_TAG = 2**24
"""Bytes of a camera's tag or a colour profile; set by hand."""
_MOST_TAGS, _LONGEST_VALUE = 4096, 8
"""Tags of a directory that are read, and bytes of the longest kind of value."""
_UNDERSTOOD = ("shaped", "imagej", "uniform")
"""Ways to arrange pages that are read as such; those of microscopes and slide scanners are pages one after another.
The description of an OME-TIFF, for one, may ask for any number of planes, and for files elsewhere."""


@contextmanager
def opened_tiff(file: BinaryIO | AnyPath) -> Iterator[Any]:
    """A `tifffile.TiffFile` of which the pages count."""
    import tifffile

    others: Any = {f"is_{kind}": False for kind in tifffile.TIFF.FILE_FLAGS if kind not in _UNDERSTOOD}
    with tifffile.TiffFile(file, _multifile=False, **others) as tiff:
        yield tiff


def _pages_of(tiff: Any) -> Any:
    """All pages, which are looked for one after another; InputError for too many."""
    if len(tiff.pages) > _MOST_PAGES:
        raise InputError(f"holds {len(tiff.pages)} pages, more than {_MOST_PAGES}; give fewer at a time")
    return tiff.pages


def _goes_on(tiff: Any) -> bool:
    """Whether the last page that there is names a next one."""
    tiff.filehandle.seek(tiff.pages.next_page_offset)
    return any(tiff.filehandle.read(tiff.tiff.offsetsize))


def _series_of(tiff: Any) -> list[Any]:
    """What is to be read: small copies of other pages are not."""
    _pages_of(tiff)
    series = list(tiff.series)
    return [one for one in series if not one.keyframe.is_reduced] or series


def declared_tiff(data: bytes) -> Declared:
    """What the headers of a TIFF say."""
    with complaints(), opened_tiff(io.BytesIO(data)) as tiff:
        return _declared(_series_of(tiff))


def _declared(series: list[Any]) -> Declared:
    pixels = n_bytes = 0
    for one in series:
        of_page = _declared_page(one.keyframe)
        pixels += one.size // max(1, one.keyframe.samplesperpixel)
        n_bytes += max(one.nbytes, of_page.n_bytes)
    return Declared(pixels, n_bytes)


def _declared_page(page: Any) -> Declared:
    if page.dtype is None:
        raise InputError("holds values of a type that is not known; save it again")
    # A part of a page, such as a tile, is decoded as a whole.
    values = max(page.size, math.prod(page.chunks))
    return Declared(page.size // max(1, page.samplesperpixel), values * page.dtype.itemsize)


def decode_tiff(data: bytes) -> FileContent:
    """Pages of one size, or one page."""
    with complaints() as told, opened_tiff(io.BytesIO(data)) as tiff:
        series = _series_of(tiff)
        _check_photometric(series)
        if all(one.keyframe.compression in _BOUNDED for one in series):
            arrays = pixels_of(series)
        else:
            found = decoded_in_child(f"{__name__}:decoded", data, {}, _declared(series).n_bytes)
            arrays = [_channels_last(found[str(i)], one.axes) for i, one in enumerate(series)]
        metadata: dict[str, Any] = (tiff.shaped_metadata or ({},))[0]
        tags = {tag.code: tag.value for tag in tiff.pages.first.tags if _is_wanted(tag, data, tiff.tiff)}
        profile = tags.get(_TIFF_PROFILE)
        named = tags.get(_TIFF_EXIF)
        exif = exif_of_names(named)
        colors = color_profile(profile if isinstance(profile, bytes) else None)
        camera = facts_of_tags(tags, named if isinstance(named, dict) else None, colors)
    if not arrays or any("page offset" in text or "first page" in text or "corrupted" in text for text in told):
        raise InputError("the TIFF ends too early; it is incomplete, copy it again")
    angles = metadata.get("angles_deg")
    angles_deg = tuple(float(angle) for angle in angles) if angles else None
    pages = [page for array, stack in arrays for page in (array if stack else array[None])]
    if len({page.shape for page in pages}) > 1:
        sizes = ", ".join(sorted({f"{page.shape[1]}x{page.shape[0]}" for page in pages}))
        raise InputError(f"its pages differ in size ({sizes}); all photographs must have the same")
    jpeg = jpeg_traces(pages[0])
    hint = stronger_hint(EncodingHint.NONE, colors, jpeg)
    focal = focal_from_exif(exif, (pages[0].shape[1], pages[0].shape[0]))
    stack = len(pages) > 1
    return FileContent(
        np.stack(pages) if stack else pages[0],
        stack=stack,
        angles_deg=angles_deg,
        focal_px=focal,
        camera=camera,
        encoding_hint=hint,
        jpeg=jpeg,
    )


def _check_photometric(series: list[Any]) -> None:
    """InputError for values that are not proportional to light, however they are encoded."""
    for page in (one.keyframe for one in series):
        kind = int(page.photometric) if page.photometric is not None else _OF_LIGHT[0]
        converted = kind == _YCBCR and page.compression in _JPEG
        if kind not in _OF_LIGHT and not converted:
            what = _OTHERS.get(kind, f"of kind {kind}")
            raise InputError(f"its values are {what}, no grey or RGB; save it again as one of these")


def pixels_of(series: list[Any]) -> list[tuple[Pixels, bool]]:
    """Of each series its pages, and whether there are several."""
    return [_channels_last(one.asarray(), one.axes) for one in series]


def decoded(data: bytes) -> dict[str, Pixels]:
    """Of each series its pages as stored, by its place."""
    with opened_tiff(io.BytesIO(data)) as tiff:
        return {str(i): one.asarray() for i, one in enumerate(_series_of(tiff))}


def tiff_frames(path: AnyPath, max_pixels: int = MAX_PIXELS) -> tuple[int, Callable[[int], Pixels]]:
    """Grey pages of one size, one after another.

    Returns
    -------
    int
        Number of pages.
    callable
        From the place of a page to its pixels (h, w).

    Raises
    ------
    InputError
        It cannot be read, its pages differ, or one has more pixels than allowed.
    """
    try:
        size = Path(path).stat().st_size
        with complaints(), opened_tiff(path) as tiff:
            pages = [(page.shape, page.dtype, page.compression) for page in _pages_of(tiff)]
            if _goes_on(tiff):
                raise InputError(f"is cut off, and {len(pages)} of its frames are listed; copy it again")
            one = tiff.pages.first
            if len(set(pages)) != 1 or len(pages[0][0]) != 2 or one.compression not in _BOUNDED:
                raise InputError("its pages are no mosaics of one size; give one grey page a frame")
            check_declared(_declared_page(one), size, max_pixels)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    except Exception as error:  # whatever damaged data make of it
        raise InputError(f"{path}: cannot be read ({one_line(error)}); copy it again") from None

    def read(i: int) -> Pixels:
        try:
            with complaints(), opened_tiff(path) as tiff:
                return np.asarray(tiff.pages[i].asarray())
        except Exception as error:
            raise InputError(f"{path}: frame {i} cannot be read ({one_line(error)}); copy it again") from None

    return len(pages), read


_TIFF_EXIF, _TIFF_PROFILE = 0x8769, 0x8773
"""Tags of TIFF: the directory of EXIF's tags, and the colour profile."""


def _is_wanted(tag: Any, data: bytes, kind: Any) -> bool:
    """Whether a tag tells something of the camera or its colours; the others, of any size, are not read."""
    if tag.code == _TIFF_EXIF:
        # Of a tag that is a directory tifffile tells where that begins, not where this stands.
        return _directory_bytes(data, tag.valueoffset, kind) <= _LONGEST_TAG
    return bool((tag.code in FACTS or tag.code == _TIFF_PROFILE) and tag.valuebytecount <= _LONGEST_TAG)


def _directory_bytes(data: bytes, start: int, kind: Any) -> float:
    """Bytes that the values of a directory's tags can have, by their counts; infinite where it cannot be read."""
    try:
        (number,) = struct.unpack_from(kind.tagnoformat, data, start)
        entries = start + kind.tagnosize + kind.tagsize * np.arange(min(number, _MOST_TAGS))
        # Behind code and type of value, of two bytes each, stands the count.
        counts = (int(struct.unpack_from(kind.tagformat2[:2], data, entry + 4)[0]) for entry in entries)
        return _LONGEST_VALUE * sum(counts)
    except struct.error:
        return math.inf


def _channels_last(pixels: Pixels, axes: str) -> tuple[Pixels, bool]:
    """Pages (k, h, w[, channel]) or one page (h, w[, channel]); and whether there is a page axis."""
    if "S" in axes:
        pixels = without_alpha(np.moveaxis(pixels, axes.index("S"), -1))
    leading = [axis for axis in axes if axis not in "YXS"]
    if not leading:
        return pixels, False
    height_at = len(leading)
    return pixels.reshape(-1, *pixels.shape[height_at:]), True
