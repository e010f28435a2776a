"""HEIF (HEIC, HIF): what telephones and newer cameras save in the place of JPEG, some for bright screens.

References
----------
ISO/IEC 23008-12: the format. ITU-T H.273: numbers of transfer characteristics and primaries.
ITU-R BT.2100: perceptual quantization (PQ) and hybrid log-gamma (HLG).
"""

from __future__ import annotations

import io
import re
from importlib.util import find_spec
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polaropt.capture.capture import EncodingHint, FileContent
from polaropt.capture.files.child import decoded_in_child
from polaropt.capture.files.colors import ColorProfile, color_profile, colors_of_primaries, encodes
from polaropt.capture.files.exif import facts_of_exif
from polaropt.capture.files.focal_length import focal_from_exif
from polaropt.capture.files.formats.pictures import without_alpha
from polaropt.capture.files.jpeg import JpegFacts
from polaropt.capture.files.limits import Declared
from polaropt.errors import InputError

Floats = NDArray[np.float32]

HEIF = (".heic", ".heif", ".hif")
"""Names that such files end in."""
_BOXES = range(16, 68, 4)
"""Bytes of the first box of a file, which names its kinds."""
_KINDS = (b"heic", b"heix", b"hevc", b"hevx", b"heim", b"heis", b"mif1", b"msf1")
FIRST_BYTES = tuple(size.to_bytes(4, "big") + b"ftyp" + kind for size, kind in product(_BOXES, _KINDS))
_BYTES_PER_PIXEL = 16
"""That decoding takes: three channels of 16 bits, and as planes before."""
_HALVED = (420, 422)
"""Samplings whose colours have fewer pixels than the brightness."""
_PQ, _HLG, _LINEAR = 16, 18, 8
"""Transfer characteristics."""
_PRIMARIES = {9: "BT.2020", 12: "Display P3"}
_FULL = np.float32(65535)


def declared_heif(data: bytes) -> Declared:
    """What the boxes of the extent (ispe) say of the largest picture, which tiles may make up."""
    corners = (match.end() for match in re.finditer(b"ispe", data))
    sides = ((int.from_bytes(data[at + k : at + k + 4], "big") for k in (4, 8)) for at in corners)
    pixels = max((width * height for width, height in sides), default=0)
    return Declared(pixels, pixels * _BYTES_PER_PIXEL)


def decode_heif(data: bytes) -> FileContent:
    """The main picture, upright; its library works in a process with limits.

    Values for bright screens (PQ, HLG) become linear here, the brightest that they can tell as white.
    """
    if find_spec("pillow_heif") is None:
        raise InputError("HEIC files need the package pillow-heif; install it with: pip install 'polaropt[heif]'")
    found = decoded_in_child(f"{__name__}:main_picture", data, {}, declared_heif(data).n_bytes)
    pixels, (chroma, transfer, kind) = found["pixels"], map(int, found["told"])
    icc = found["icc"].tobytes()
    colors = color_profile(icc) if icc else _colors_of(kind, found["chromaticities"])
    exif, camera = facts_of_exif(found["exif"].tobytes(), colors)
    height, width = pixels.shape[:2]
    hint = EncodingHint.PROFILE if encodes(colors) else EncodingHint.HEIF
    if transfer in (_PQ, _HLG, _LINEAR) and not icc:
        pixels, hint = _linear(pixels, transfer), EncodingHint.NONE
    return FileContent(
        pixels,
        encoding_hint=hint,
        focal_px=focal_from_exif(exif, (width, height)),
        camera=camera,
        jpeg=JpegFacts(None, chroma in _HALVED, 0.0),
    )


def main_picture(data: bytes) -> dict[str, NDArray[Any]]:
    """Its pixels, its EXIF tags and colour profile, and what its header tells of colours."""
    import pillow_heif

    picture = pillow_heif.open_heif(io.BytesIO(data), convert_hdr_to_8bit=False)
    pixels = without_alpha(np.asarray(picture))
    info, nclx = picture.info, picture.info.get("nclx_profile") or {}
    corners = [nclx.get(f"color_primary_{name}_{axis}", 0.0) for name in ("red", "green", "blue") for axis in "xy"]
    told = (info.get("chroma", 0), nclx.get("transfer_characteristics", 0), nclx.get("color_primaries", 0))
    return {
        "pixels": pixels,
        "exif": np.frombuffer(info.get("exif") or b"", np.uint8),
        "icc": np.frombuffer(info.get("icc_profile") or b"", np.uint8),
        "chromaticities": np.array(corners, dtype=np.float64),
        "told": np.array(told, dtype=np.int64),
    }


def _colors_of(kind: int, chromaticities: NDArray[np.float64]) -> ColorProfile:
    """Of the primaries that the header tells."""
    if kind not in _PRIMARIES:
        return ColorProfile()
    return colors_of_primaries(_PRIMARIES[kind], [(float(x), float(y)) for x, y in chromaticities.reshape(3, 2)])


def _linear(values: NDArray[Any], transfer: int) -> Floats:
    """Light, the brightest that can be told as 1, from integers."""
    encoded = values.astype(np.float32) / (_FULL if values.dtype == np.uint16 else np.float32(255))
    if transfer == _PQ:
        m1, m2, c1, c2, c3 = 2610 / 16384, 2523 / 32, 3424 / 4096, 2413 / 128, 2392 / 128
        power = encoded ** np.float32(1 / m2)
        return np.asarray((np.maximum(power - c1, 0) / (c2 - c3 * power)) ** (1 / m1), np.float32)
    if transfer == _HLG:
        a, b, c = 0.17883277, 0.28466892, 0.55991073
        return np.where(encoded <= 0.5, encoded**2 / 3, (np.exp((encoded - c) / a) + b) / 12).astype(np.float32)
    return encoded
