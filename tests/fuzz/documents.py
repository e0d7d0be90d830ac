# SPDX-License-Identifier: Apache-2.0
"""Compressed images, references, gap reports, streams of transforms and files of node parameters that somebody else wrote."""

from __future__ import annotations

import contextlib
import difflib
import json
import struct
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from arm_correction.live import CorrectNodeConfig
from arm_correction.reference import load_reference, save_reference
from tests.arm_correction.made import FIRST
from tests.arm_correction.made import reference as made_reference
from tests.tof_align.made import section
from tof_core import edge
from tof_core.compressed import unpacked
from tof_core.config import from_mapping
from tof_core.errors import ToftwinError
from tof_core.tf import TransformBuffer
from tof_core.tf_message import StampedTransform, read_transforms
from tof_core.yamlio import parse_yaml
from toftwin.viewing import draw_gap

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

FORMATS = (
    "16UC1; compressedDepth png",
    "16UC1; compressedDepth rvl",
    "32FC1; compressedDepth png",
    "rgb8; jpeg compressed bgr8",
    "png",
    "",
)


def compressed(folder: Path) -> Callable[[bytes], None]:
    """A CompressedImage, its format by the first byte."""
    del folder

    def run(data: bytes) -> None:
        msg = SimpleNamespace(format=FORMATS[data[0] % len(FORMATS)] if data else "", data=data[1:])
        with contextlib.suppress(ToftwinError):
            raster, _ = unpacked(msg, "topic")
            assert raster.size

    return run


def compressed_seeds(folder: Path) -> list[bytes]:
    """One of each kind, of 4 x 3 pixels."""
    del folder
    counts = np.arange(12, dtype=np.uint16).reshape(3, 4) * 100
    png, jpeg = (cv2.imencode(end, image)[1].tobytes() for end, image in ((".png", counts), (".jpg", counts.astype(np.uint8))))
    config = struct.pack("<iff", 0, 1000.0, 1.0)
    rvl = struct.pack("<II", 4, 3) + struct.pack("<4I", 0x10000000, 0xC1234567, 0x89ABCDEF, 0)
    return [b"\x00" + config + png, b"\x01" + config + rvl, b"\x02" + config + png, b"\x03" + jpeg, b"\x04" + png, b"\x05" + png]


def reference(folder: Path) -> Callable[[bytes], None]:
    """The .json or the .npz of a reference, by the first byte, beside the other one as it was."""
    path = save_reference(made_reference(section(), FIRST), folder / "first")
    good = {end: path.with_suffix(end).read_bytes() for end in (".json", ".npz")}

    def run(data: bytes) -> None:
        changed = ".npz" if data[:1] == b"n" else ".json"
        for end, content in good.items():
            path.with_suffix(end).write_bytes(data[1:] if end == changed else content)
        with contextlib.suppress(ToftwinError), np.errstate(all="ignore"):
            assert load_reference(path).depth.ndim == 2

    return run


def reference_seeds(folder: Path) -> list[bytes]:
    """The text as it is written, and arrays small enough to be changed."""
    path = save_reference(made_reference(section(), FIRST), folder / "seed")
    np.savez(folder / "small.npz", depth=np.ones((2, 2), np.float32), region=np.ones((2, 2), bool), T_cell_body=np.eye(4))
    return [b"j" + path.read_bytes(), b"n" + (folder / "small.npz").read_bytes()]


class _Nowhere:
    """Takes whatever is drawn."""

    def __getattr__(self, name: str) -> Callable[..., None]:
        return lambda *_: None


def gap(folder: Path) -> Callable[[bytes], None]:
    """The gap.json or the gap_maps.npz of a report, by the first byte, beside the other one as it was."""
    good = {"gap.json": _gap_text(), "gap_maps.npz": _gap_maps(folder)}

    def run(data: bytes) -> None:
        changed = "gap_maps.npz" if data[:1] == b"n" else "gap.json"
        for name, content in good.items():
            (folder / name).write_bytes(data[1:] if name == changed else content)
        with contextlib.suppress(ToftwinError), np.errstate(all="ignore"):
            draw_gap(_Nowhere(), folder, None)  # type: ignore[arg-type]

    return run


def gap_seeds(folder: Path) -> list[bytes]:
    """A report of one view."""
    return [b"j" + _gap_text(), b"n" + _gap_maps(folder)]


def _gap_text() -> bytes:
    return json.dumps({"verdict": ["wiggling", "none"], "parts": {}}).encode()


def _gap_maps(folder: Path) -> bytes:
    one = np.full((1, 2, 3), 1e-3, np.float32)
    np.savez(folder / "made.npz", view_stamp_ns=np.array([5]), residual_m=one, region=np.zeros((1, 2, 3), np.int32), wiggling=one)
    return (folder / "made.npz").read_bytes()


_TRANSFORM = struct.Struct("<BBBqf4b")
FRAMES = tuple(f"f{i}" for i in range(16))
EYE = np.eye(3)


def tf(folder: Path) -> Callable[[bytes], None]:
    """A serialised message; a stream of transforms between sixteen frames, nineteen bytes each, and questions in between."""
    del folder
    vars(edge)["BLOCK"] = 2  # a short stream fills and divides blocks, too

    def run(data: bytes) -> None:
        buffer = TransformBuffer(keep_s=10.0 if data[:1] == b"k" else 0.0)
        with contextlib.suppress(ToftwinError):
            for sent in read_transforms(data):
                buffer.put(sent)
        for way, parent, child, stamp, x, *q in _TRANSFORM.iter_unpack(data[1 : 1 + (len(data) - 1) // _TRANSFORM.size * _TRANSFORM.size]):
            sent = StampedTransform(FRAMES[parent % 16], FRAMES[child % 16], stamp, (x, 0.0, 0.0, *(v / 127 for v in q)))
            with contextlib.suppress(ToftwinError):
                if way & 8:
                    buffer.add_message(_tf_message(sent), static=bool(way & 1))
                else:
                    buffer.put(sent, static=bool(way & 1))
            with contextlib.suppress(ToftwinError):
                if way & 2:
                    T = buffer.lookup(sent.parent, FRAMES[0], stamp)
                    assert abs(T[:3, :3] @ T[:3, :3].T - EYE).max() < 1e-6
                if way & 4:
                    buffer.settled(sent.child, FRAMES[0], stamp)
                    buffer.latest(sent.child, FRAMES[0])
                if way & 128:
                    buffer.clear_dynamic()

    return run


def _tf_message(sent: StampedTransform) -> Any:
    x, y, z, qx, qy, qz, qw = sent.motion
    motion = SimpleNamespace(translation=SimpleNamespace(x=x, y=y, z=z), rotation=SimpleNamespace(x=qx, y=qy, z=qz, w=qw))
    header = SimpleNamespace(frame_id=sent.parent, stamp=SimpleNamespace(sec=sent.stamp_ns // 10**9 % 2**31, nanosec=sent.stamp_ns % 10**9))
    return SimpleNamespace(transforms=[SimpleNamespace(header=header, child_frame_id=sent.child, transform=motion)])


def tf_seeds(folder: Path) -> list[bytes]:
    """A chain that moves, in order and backward, and a static one."""
    del folder
    forward = [_TRANSFORM.pack(14, i % 3, i % 3 + 1, 10**8 * i, 0.1 * i, 0, 0, 0, 127) for i in range(12)]
    static = [_TRANSFORM.pack(3, i, i + 1, 0, 1.0, 0, 127, 0, 0) for i in range(5)]
    message = b"\0\1\0\0" + struct.pack("<IiII8sI8s4x7d", 1, 1, 5, 5, b"body", 7, b"camera", 0, 0, 1, 0, 0, 0, 1)
    return [b"k" + b"".join(forward), b"a" + b"".join(reversed(forward)), b"a" + b"".join(static), message]


def parameters(folder: Path) -> Callable[[bytes], None]:
    """A file of node parameters, as `--params-file` takes it."""
    del folder
    difflib.get_close_matches = lambda *_, **__: []  # what to say of a misspelt key: ten times the work of all the rest

    def run(data: bytes) -> None:
        with contextlib.suppress(ToftwinError):
            nodes = parse_yaml(data.decode("utf-8", "replace"), where="params")
            for values in nodes.values():
                if isinstance(values, dict) and isinstance(values.get("ros__parameters"), dict):
                    from_mapping(CorrectNodeConfig, values["ros__parameters"], where="params")

    return run


def parameters_seeds(folder: Path) -> list[bytes]:
    """Nested and dotted names."""
    del folder
    return [
        b"/**:\n  ros__parameters:\n    correct:\n      limits: {step_mm: 100.0, reach_m: 1.0}\n    live.connect: arm\n",
        b"correct:\n  ros__parameters: {correct.limits.low_m: .nan, align.mode: session}\n",
    ]
