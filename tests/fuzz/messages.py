# SPDX-License-Identifier: Apache-2.0
"""Images, CameraInfo and point clouds whose every field is foreign."""

from __future__ import annotations

import contextlib
import struct
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np

from tests.tof_core import packing
from tof_core.camera import Camera
from tof_core.clouds import depth_from_points
from tof_core.decode import camera_from_info, check_size, decode_amplitude, decode_colour, decode_depth
from tof_core.encode import ENCODINGS, image_fields, points_fields
from tof_core.errors import ToftwinError

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

CAMERA = Camera(6, 4, 5.0, 5.0, 2.5, 1.5, "plumb_bob", (0.1, -0.01, 0.001, 0.0, 0.0))
NAMES = (*ENCODINGS, "bayer_rggb8", "", "64FC1")
IMAGE = struct.Struct("<BBBHHiB")
CLOUD = struct.Struct("<BBIIiIB")
FIELD = struct.Struct("<BIB")
INFO = struct.Struct("<IIBIIII26d")
MODELS = ("plumb_bob", "rational_polynomial", "", "equidistant")
AXES = ("x", "y", "z", "intensity")
T = np.eye(4) + 0.01


def image(folder: Path) -> Callable[[bytes], None]:
    """Decode an image as depth, amplitude or colour; or read a CameraInfo."""
    del folder
    ways: tuple[Callable[..., Any], ...] = (lambda *a: decode_depth(*a)[0], decode_amplitude, decode_colour)

    def run(data: bytes) -> None:
        if len(data) < IMAGE.size:
            return
        way, encoding, big, height, width, step, wild = IMAGE.unpack_from(data)
        if way % 4 == 3:
            _info(data)
            return
        name = NAMES[encoding % len(NAMES)]
        rest = data[IMAGE.size :]
        if not wild & 1:  # near a good one: small, with whole rows
            height, width = height & 31, width & 31
            kind = ENCODINGS.get(name)
            step = width * (int(kind.element[1]) * kind.channels if kind else 1) + (step & 3 if wild & 2 else 0)
            rest = (rest * 2 + bytes(8))[: max(step * height, 0)] if wild & 4 else rest
        message = SimpleNamespace(height=height, width=width, step=abs(step), encoding=name, is_bigendian=big & 1, data=rest)
        with contextlib.suppress(ToftwinError):
            check_size(ways[way % 4](message, "t").shape, CAMERA, "t")

    return run


def _info(data: bytes) -> None:
    if len(data) < INFO.size + 1:
        return
    width, height, model, bx, by, x0, roi, *numbers = INFO.unpack_from(data, 1)
    message = SimpleNamespace(
        width=width, height=height, distortion_model=MODELS[model % 4], binning_x=bx & 7, binning_y=by,
        roi=SimpleNamespace(x_offset=x0, y_offset=roi & 63, width=roi & 7, height=roi >> 8),
        k=np.array(numbers[:9]), p=np.array(numbers[9:18] + numbers[:3]), d=np.array(numbers[18 : 18 + (model & 15)]),
        header=SimpleNamespace(frame_id="f"),
    )  # fmt: skip
    with contextlib.suppress(ToftwinError), np.errstate(all="ignore"):
        camera = camera_from_info(message, "t", rectified=bool(model & 64))
        camera.project(np.array([[0.1, 0.2, 1.0], [3.0, 0.0, 1.0]]))


def image_seeds(folder: Path) -> list[bytes]:
    """One good image of each encoding, and a CameraInfo."""
    del folder
    seeds = []
    for number, (name, kind) in enumerate(ENCODINGS.items()):
        shape = (4, 6) if kind.channels == 1 else (4, 6, kind.channels)
        fields = image_fields(np.ones(shape, kind.element), name)
        for way in range(3):
            seeds.append(IMAGE.pack(way, number, 0, 4, 6, fields["step"], 0) + bytes(fields["data"]))
            seeds.append(IMAGE.pack(way, number, 1, 4, 6, fields["step"], 1) + bytes(fields["data"]))
    k = [5.0, 0, 2.5, 0, 5.0, 1.5, 0, 0, 1]
    seeds.append(b"\x03" + INFO.pack(6, 4, 5, 1, 1, 0, 0, *k, *k, 0.1, -0.01, 0.001, *[0.0] * 5))
    return seeds


def cloud(folder: Path) -> Callable[[bytes], None]:
    """Decode a point cloud into the camera's raster."""
    del folder

    def run(data: bytes) -> None:
        if len(data) < CLOUD.size:
            return
        count, big, height, width, row, step, wild = CLOUD.unpack_from(data)
        at, fields = CLOUD.size, []
        for _ in range(count % 6):
            if at + FIELD.size > len(data):
                return
            name, offset, kind = FIELD.unpack_from(data, at)
            at += FIELD.size
            fields.append(
                SimpleNamespace(name=AXES[name % 4], offset=offset if wild & 1 else offset & 31, datatype=kind if wild & 1 else kind % 9)
            )
        if not wild & 1:
            height, width, step, row = height & 7, width & 15, step & 31, 0 if wild & 2 else (width & 15) * (step & 31) + (row & 3)
        message: Any = SimpleNamespace(
            height=height, width=width, fields=fields, is_bigendian=big & 1, point_step=step, row_step=abs(row), data=data[at:]
        )
        with contextlib.suppress(ToftwinError), np.errstate(all="ignore"):
            depth_from_points(message, CAMERA, T if wild & 4 else None, "t")

    return run


def cloud_seeds(folder: Path) -> list[bytes]:
    """An organised cloud, and one that is not; float32 and with intensity."""
    del folder
    seeds = []
    depth = np.linspace(0.5, 1.5, 24, dtype=np.float32).reshape(CAMERA.shape)
    for points in (CAMERA.points(depth), CAMERA.points(depth).reshape(-1, 3)):
        fields = points_fields(points)
        described = b"".join(FIELD.pack(i, f.offset, f.datatype) for i, f in enumerate(fields["fields"]))
        for wild in (1, 5):
            head = CLOUD.pack(3, 0, fields["height"], fields["width"], fields["row_step"], fields["point_step"], wild)
            seeds.append(head + described + bytes(fields["data"]))
        seeds.append(CLOUD.pack(3, 0, 2, 3, 0, 12, 2) + described + bytes(fields["data"])[:72])
    return seeds


FORMATS = (
    "16UC1; compressedDepth png",
    "16UC1; compressedDepth rvl",
    "32FC1; compressedDepth png",
    "rgb8; jpeg compressed bgr8",
    "png",
    "",
)


def packed(folder: Path) -> Callable[[bytes], None]:
    """Decode a compressed image as depth, amplitude or colour; the first byte chooses format and way."""
    del folder
    ways: tuple[Callable[..., Any], ...] = (decode_depth, decode_amplitude, decode_colour)

    def run(data: bytes) -> None:
        if not data:
            return
        way, kind = divmod(data[0], len(FORMATS))
        with contextlib.suppress(ToftwinError):
            ways[way % len(ways)](SimpleNamespace(format=FORMATS[kind], data=data[1:]), "/topic")

    return run


def packed_seeds(folder: Path) -> list[bytes]:
    """One good image of each format."""
    del folder
    counts = np.arange(24, dtype=np.uint16).reshape(4, 6) * 300
    colour = np.zeros((8, 8, 3), np.uint8)
    packed = [packing.depth(counts), packing.depth(counts, kind="rvl"), packing.depth(counts, a=10100.0, b=-1009.0)]
    packed += [packing.jpeg(colour), packing.png(colour)]
    return [bytes([number]) + data for number, data in enumerate(packed)]
