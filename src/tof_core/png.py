# SPDX-License-Identifier: Apache-2.0
"""PNG images from outside: the size is checked against the header before the raster is decoded."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Any

from tof_core.bounds import LARGEST_RASTER
from tof_core.errors import DecodeError

if TYPE_CHECKING:
    from numpy.typing import NDArray

SIGNATURE = b"\x89PNG\r\n\x1a\n"
_HEADER = struct.Struct(">8sI4sII")  # signature, length and name of the first chunk (IHDR), width, height

_CHUNK = struct.Struct(">I4s")  # length of a chunk's content, and its name


def check_raster(width: int, height: int, where: object = "") -> None:
    """Refuse an image of no pixels or of more than `LARGEST_RASTER`; for every decoder that allocates by a header.

    Raises:
        DecodeError: the size is not one that a camera has.
    """
    if not 0 < width * height <= LARGEST_RASTER:
        what = f"has {width}x{height} pixels"
        raise DecodeError(what, where=where, todo=f"images of 1 to {LARGEST_RASTER} pixels are read")


def png_size(data: bytes, where: object = "") -> tuple[int, int]:
    """Width and height in pixels by the header, checked by `check_raster`.

    Raises:
        DecodeError: no PNG, or too large.
    """
    if len(data) < _HEADER.size:
        raise DecodeError("is no PNG", where=where)
    signature, _, name, width, height = _HEADER.unpack_from(data)
    if signature != SIGNATURE or name != b"IHDR":
        raise DecodeError("is no PNG", where=where)
    check_raster(width, height, where)
    return width, height


def _check_chunks(data: bytes, where: object) -> None:
    """Refuse chunks that end beyond the data: OpenCV allocates the stated length, up to 2 GB, before it reads."""
    at = len(SIGNATURE)
    while at < len(data):
        if at + _CHUNK.size > len(data):
            raise DecodeError("is a damaged PNG (cut off within a chunk's header)", where=where)
        length, name = _CHUNK.unpack_from(data, at)
        at += _CHUNK.size + length + 4  # 4: the checksum
        if at > len(data):
            raise DecodeError(f"is a damaged PNG (a chunk of {length} bytes ends beyond its data)", where=where)
        if name == b"IEND":
            return
    raise DecodeError("is a damaged PNG (without an end)", where=where)


def decode_png(data: bytes, where: object = "") -> NDArray[Any]:
    """The raster (H, W) or (H, W, channels), uint8 or uint16, colour in the order blue, green, red.

    Raises:
        DecodeError: no PNG, too large, or damaged.
    """
    import cv2
    import numpy as np

    width, height = png_size(data, where)
    _check_chunks(data, where)
    try:
        raster = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise DecodeError(f"is a damaged PNG ({error.err})", where=where) from None
    if raster is None or raster.shape[:2] != (height, width):
        raise DecodeError("is a damaged PNG", where=where)
    return np.asarray(raster)
