"""PNG and JPEG: one picture a file."""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from polaropt.capture.capture import EncodingHint, FileContent
from polaropt.capture.files.colors import ColorProfile, encodes
from polaropt.capture.files.exif import facts_of_picture
from polaropt.capture.files.focal_length import exif_of_picture, focal_from_exif
from polaropt.capture.files.jpeg import FRAMES, JpegFacts, jpeg_facts, jpeg_scan, jpeg_segments, jpeg_traces
from polaropt.capture.files.limits import Declared
from polaropt.errors import InputError

Pixels = NDArray[Any]

_JPEG_END = b"\xff\xd9"
_MOST_SCANS = 100
"""Scans of a progressive JPEG, each of which is decoded over the whole picture; usual are 10. Set by hand."""
_PNG_CHANNELS = {0: 1, 2: 3, 3: 3, 4: 2, 6: 4}
"""Channels that a PNG's colour types become; a chunk of transparency adds one."""


def _picture(pixels: Pixels, data: bytes, hint: EncodingHint) -> FileContent:
    pixels = without_alpha(pixels)
    focal = focal_from_exif(exif_of_picture(data), (pixels.shape[1], pixels.shape[0]))
    jpeg = jpeg_facts(data) if hint is EncodingHint.JPEG else jpeg_traces(pixels)
    camera = facts_of_picture(data)
    if not hint.decides:
        hint = stronger_hint(hint, camera.colors, jpeg)
    return FileContent(pixels, encoding_hint=hint, focal_px=focal, camera=camera, jpeg=jpeg)


def stronger_hint(hint: EncodingHint, colors: ColorProfile, jpeg: JpegFacts | None) -> EncodingHint:
    """What a colour profile, or what is left of a JPEG, says of the encoding, where the format does not."""
    if encodes(colors):
        return EncodingHint.PROFILE
    return hint if jpeg is None else EncodingHint.JPEG


def without_alpha(pixels: Pixels) -> Pixels:
    """Drop the last of 2 or 4 channels (..., channel); a single channel becomes none."""
    if pixels.ndim < 3:
        return pixels
    channels = pixels.shape[-1]
    if channels in (2, 4):
        pixels = pixels[..., : channels - 1]
    return pixels[..., 0] if pixels.shape[-1] == 1 else pixels


def _png_hint(data: bytes) -> EncodingHint:
    head = data[:4096]
    if b"sRGB" in head:
        return EncodingHint.SRGB_PNG
    return EncodingHint.SHALLOW_PNG if data[24:25] == b"\x08" else EncodingHint.NONE


def decode_png(data: bytes) -> FileContent:
    import imagecodecs

    return _picture(imagecodecs.png_decode(data), data, _png_hint(data))


def decode_jpeg(data: bytes) -> FileContent:
    import imagecodecs

    if _JPEG_END not in data[jpeg_scan(data) :]:
        raise InputError("the JPEG ends too early; it is incomplete, copy it again")
    return _picture(imagecodecs.jpeg8_decode(data), data, EncodingHint.JPEG)


def declared_png(data: bytes) -> Declared:
    """What the header of a PNG says."""
    width, height = (int.from_bytes(data[at : at + 4], "big") for at in (16, 20))
    depth, kind = data[24], data[25]
    channels = _PNG_CHANNELS.get(kind, 4) + (b"tRNS" in data)
    return Declared(height * width, height * width * channels * (2 if depth == 16 else 1))


def declared_jpeg(data: bytes) -> Declared:
    """What the headers of a JPEG say; InputError where it has too many scans."""
    if data.count(b"\xff\xda") > _MOST_SCANS:
        raise InputError(f"the JPEG has more than {_MOST_SCANS} scans; save it again")
    for kind, segment in jpeg_segments(data):
        if kind in FRAMES and len(segment) >= 6:
            height, width = (int.from_bytes(segment[at : at + 2], "big") for at in (1, 3))
            return Declared(height * width, height * width * segment[5])
    return Declared(0, 0)
