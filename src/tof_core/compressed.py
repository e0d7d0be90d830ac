# SPDX-License-Identifier: Apache-2.0
"""Images as image_transport compresses them: compressedDepth (PNG or RVL), and compressed (JPEG or PNG)."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from tof_core.encode import ENCODINGS
from tof_core.errors import DecodeError
from tof_core.png import SIGNATURE, check_raster, decode_png, png_size

if TYPE_CHECKING:
    from numpy.typing import NDArray

DEPTH_TRANSPORT = "compressedDepth"
_CONFIG = struct.Struct("<iff")
"""Header of a compressedDepth image: format (not used, the text contains it), and the two parameters of an inverse depth."""
JPEG = b"\xff\xd8\xff"
READ = "compressedDepth with PNG or RVL, compressed with JPEG or PNG"


class Format(NamedTuple):
    """Content of `CompressedImage.format`: encoding of the raw image (empty if absent), and whether it is compressedDepth, as RVL."""

    encoding: str
    depth: bool
    rvl: bool


def format_of(text: str) -> Format:
    """The parts of texts such as `16UC1; compressedDepth rvl`, `rgb8; jpeg compressed bgr8`, `png`."""
    encoding, semicolon, transport = text.partition(";")
    encoding = encoding.strip()
    known = encoding if semicolon and encoding in ENCODINGS else ""
    return Format(known, DEPTH_TRANSPORT.lower() in text.lower(), "rvl" in transport.lower())


def stated_encoding(text: str) -> str:
    """The raw image's encoding stated in a `CompressedImage.format`, or the usual encoding of its kind."""
    kind = format_of(text)
    return kind.encoding or ("16UC1" if kind.depth else "bgr8")


def size_of(msg: Any, where: str = "") -> tuple[int, int]:
    """Height and width in pixels, from the headers alone.

    Raises:
        DecodeError: another format, or too large.
    """
    kind, data = format_of(msg.format), bytes(msg.data)
    if kind.depth:
        data = data[_CONFIG.size :]
    if kind.rvl:
        from tof_core.rvl import rvl_size

        width, height = rvl_size(data, where)
    elif data.startswith(SIGNATURE):
        width, height = png_size(data, where)
    elif data.startswith(JPEG) and not kind.depth:
        width, height = _jpeg_size(data, where)
    else:
        raise DecodeError(f"format '{msg.format[:60]}' is not read", where=where, todo=f"publish {READ}, or the raw topic")
    return height, width


def unpacked(msg: Any, where: str = "") -> tuple[NDArray[Any], str]:
    """The raster (H, W) or (H, W, 3) of a `sensor_msgs/CompressedImage`, and its encoding.

    32FC1 depth is stored as inverse depth: count = a / metres + b, with 0 for no depth (compressed_depth_image_transport).

    Raises:
        DecodeError: another format, too large, or damaged.
    """
    size_of(msg, where)
    kind, data = format_of(msg.format), bytes(msg.data)
    if not kind.depth:
        raster = decode_png(data, where) if data.startswith(SIGNATURE) else _decode_jpeg(data, where)
        return raster, _encoding_of(raster, kind.encoding, where)
    _, a, b = _CONFIG.unpack_from(data)
    if kind.rvl:
        from tof_core.rvl import decode_rvl

        counts: NDArray[Any] = decode_rvl(data[_CONFIG.size :], where)
    else:
        counts = decode_png(data[_CONFIG.size :], where)
    if counts.dtype != np.uint16 or counts.ndim != 2:
        raise DecodeError(f"holds {counts.dtype} of shape {counts.shape}, not one 16-bit count a pixel", where=where)
    if kind.encoding != "32FC1":
        return counts, kind.encoding or "16UC1"
    if not (np.isfinite((a, b)).all() and a > 0):
        raise DecodeError(f"has no parameters of its inverse depth ({a:g}, {b:g})", where=where)
    with np.errstate(divide="ignore", invalid="ignore"):
        metres = np.float32(a) / (counts.astype(np.float32) - np.float32(b))
    return np.where((counts > 0) & (metres > 0) & np.isfinite(metres), metres, np.float32(np.nan)), "32FC1"


QUANTIZATION, FARTHEST_M = 100.0, 10.0
"""Parameters of the inverse depth, the defaults of compressed_depth_image_transport: a step of z^2 / 10100 per count (0.1 mm at 1 m), up to 10 m."""
DEPTH_CODES = ("png", "rvl")
"""Codes of compressedDepth; both are lossless for counts."""
QUICK = 1
"""Level of zlib: higher levels make depth images little smaller and take several times as long."""


def packed_depth(depth: NDArray[np.float32], code: str = "png") -> tuple[bytes, str]:
    """Depth in metres (H, W) as compressedDepth: data and format of a `sensor_msgs/CompressedImage`; NaN and depth out of range become 0.

    count = a / metres + b with a = q (q + 1), b = 1 - a / farthest (compressed_depth_image_transport, 32FC1). `code` is one of `DEPTH_CODES`.
    """
    a = QUANTIZATION * (QUANTIZATION + 1.0)
    b = 1.0 - a / FARTHEST_M
    with np.errstate(divide="ignore", invalid="ignore"):
        counts = np.rint(a / np.asarray(depth, np.float64) + b)
    inside = np.isfinite(counts) & (depth > 0) & (counts >= 1) & (counts <= 65535)
    raster = np.where(inside, counts, 0).astype(np.uint16)
    return _CONFIG.pack(0, a, b) + _coded(raster, code), f"32FC1; {DEPTH_TRANSPORT} {code}"


def _coded(raster: NDArray[np.uint16], code: str) -> bytes:
    if code == "rvl":
        from tof_core.rvl import encode_rvl

        return encode_rvl(raster)
    import cv2

    _, png = cv2.imencode(".png", raster, [cv2.IMWRITE_PNG_COMPRESSION, QUICK])
    return png.tobytes()


def _encoding_of(raster: NDArray[Any], stated: str, where: str) -> str:
    """The encoding of a decoded JPEG or PNG: colour in the order blue, green, red; for grey images the stated encoding, where it fits."""
    channels = raster.shape[2] if raster.ndim == 3 else 1
    fits = {("u1", 1): "mono8", ("u2", 1): "16UC1", ("u1", 3): "bgr8", ("u1", 4): "bgra8"}
    element = f"{raster.dtype.kind}{raster.dtype.itemsize}"
    if (found := fits.get((element, channels))) is None:
        raise DecodeError(f"holds {channels} channels of {raster.dtype}", where=where, todo=f"publish {READ}, or the raw topic")
    return stated if channels == 1 and stated and ENCODINGS[stated] == (element, 1) else found


def _jpeg_size(data: bytes, where: str) -> tuple[int, int]:
    """Width and height by the first frame header (SOF) of a JPEG."""
    at = 2
    while at + 9 <= len(data) and data[at] == 0xFF:
        marker, length = data[at + 1], int.from_bytes(data[at + 2 : at + 4], "big")
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            height, width = struct.unpack_from(">HH", data, at + 5)
            check_raster(width, height, where)
            return width, height
        at += 2 + max(length, 2)
    raise DecodeError("is a damaged JPEG", where=where)


def _decode_jpeg(data: bytes, where: str) -> NDArray[Any]:
    """The raster (H, W) or (H, W, 3) uint8 in the order blue, green, red."""
    import cv2

    try:
        raster = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise DecodeError(f"is a damaged JPEG ({error.err})", where=where) from None
    if raster is None:
        raise DecodeError("is a damaged JPEG", where=where)
    return np.asarray(raster)
