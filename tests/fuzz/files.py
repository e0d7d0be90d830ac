# SPDX-License-Identifier: Apache-2.0
"""Bags, datasets and networks as files that were damaged or forged."""

from __future__ import annotations

import contextlib
import json
import shutil
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from tests.tof_core import bags
from tests.tof_sim_label import made
from tof_core.bag import BagOptions, open_bag
from tof_core.bag_writer import BagWriter
from tof_core.camera import Camera
from tof_core.encode import depth_counts
from tof_core.errors import ToftwinError
from tof_infer.card import KEY, OUTPUTS, Card, parse_card
from tof_infer.config import InferConfig
from tof_infer.session import Session
from tof_sim_label.dataset import DatasetWriter, open_dataset
from tof_sim_label.schema import COLUMNS

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

CAMERA = Camera(4, 3, 4.0, 4.0, 1.5, 1.0, frame_id="spot/hand_depth_sensor")


def bag(folder: Path) -> Callable[[bytes], None]:
    """A storage file, or the metadata of a good one; by the first byte, which also says whether to recover."""
    _remember()
    good = _good_bag(folder / "good")
    mcap, db3 = folder / "x.mcap", folder / "x.db3"

    def run(data: bytes) -> None:
        way = data[0] if data else 0
        path = (mcap, db3, good / "metadata.yaml")[way % 3]
        path.write_bytes(data[1:])
        with contextlib.suppress(ToftwinError), np.errstate(all="ignore"):
            options = BagOptions(recover=bool(way & 64))
            with open_bag(good if way % 3 == 2 else path, options, cell_frame="cell") as reader:
                for capture in reader.captures(need_tf=bool(way & 32)):
                    assert capture.depth.shape == reader.camera.shape

    return run


def _remember() -> None:
    """Let rosbags compile a definition, and parse a QoS, once: nine tenths of the time, and neither is under test."""
    from rosbags.rosbag2 import storage_mcap
    from rosbags.serde import cdr, ros1, utils

    compiled = cache(lambda text: utils.compile_lines([text]))
    for module in (cdr, ros1):
        vars(module)["compile_lines"] = lambda lines: compiled("\n".join(lines))
    parsed, parse = dict[str, Any](), vars(storage_mcap)["parse_qos"]
    vars(storage_mcap)["parse_qos"] = lambda text: parsed[text] if text in parsed else parsed.setdefault(text, parse(text))


def _good_bag(path: Path, storage: str = "mcap") -> Path:
    """Two frames of 4 x 3 with TF."""
    with BagWriter(path, storage) as writer:  # type: ignore[arg-type]
        writer.tf(bags.START, [("cell", CAMERA.frame_id, np.eye(4))], static=True)
        for i in range(2):
            at = bags.stamp(i)
            writer.camera_info("/d/camera_info", CAMERA, at)
            writer.temperature("/d/temperature", 30.0, at)
            writer.image("/d/image", depth_counts(np.full(CAMERA.shape, 1.0 + i, np.float32)), "16UC1", CAMERA.frame_id, at)
    return path


def bag_seeds(folder: Path) -> list[bytes]:
    """Good ones of both storages, and metadata."""
    mcap, sqlite = _good_bag(folder / "seed"), _good_bag(folder / "seed3", "sqlite3")
    file, other = next(mcap.glob("*.mcap")).read_bytes(), next(sqlite.glob("*.db3")).read_bytes()
    return [
        bytes([32 + 64]) + file,
        b"\x00" + file[: len(file) // 2],
        bytes([1 + 96]) + other,
        bytes([2 + 96]) + (mcap / "metadata.yaml").read_bytes(),
    ]


def dataset(folder: Path) -> Callable[[bytes], None]:
    """A good dataset of which one file is foreign; the first byte says which."""
    good = _good_dataset(folder / "good.zarr")
    files = _files(good)

    def run(data: bytes) -> None:
        path = files[data[0] % len(files) if data else 0]
        before = path.read_bytes()
        path.write_bytes(data[1:])
        try:
            with contextlib.suppress(ToftwinError), np.errstate(all="ignore"):
                opened = open_dataset(good)
                for group, columns in COLUMNS.items():
                    for name, column in columns.items():
                        # Only what the foreign file concerns: opening an array takes a millisecond.
                        if path.parent.name in (name, group, good.name):
                            _ = opened.frame(f"{group}/{name}", 0) if column.image else opened.column(f"{group}/{name}")
                        if path.parent == good:
                            break
        finally:
            path.write_bytes(before)

    return run


def _good_dataset(path: Path) -> Path:
    with DatasetWriter(path, made.CAMERA, made.ATTRIBUTES) as writer:
        writer.append_capture(made.capture(0), 0)
        writer.append_view(made.view(0), made.label(0))
    return path


def _files(path: Path) -> list[Path]:
    return sorted(p for p in path.rglob("*") if p.is_file() and p.name != ".lock")


def dataset_seeds(folder: Path) -> list[bytes]:
    """Each file as it should be."""
    good = _good_dataset(folder / "seed.zarr")
    seeds = [bytes([i]) + p.read_bytes() for i, p in enumerate(_files(good))]
    shutil.rmtree(good)
    return seeds


def onnx(folder: Path) -> Callable[[bytes], None]:
    """The card of a network: by itself (c), in a network's metadata (m), or the whole file (f)."""
    model, path = _tiny_model(), folder / "x.onnx"

    def run(data: bytes) -> None:
        with contextlib.suppress(ToftwinError):
            if data[:1] == b"f":
                path.write_bytes(data[1:])
            elif data[:1] == b"m":
                path.write_bytes(model + _metadata(KEY.encode(), data[1:]))
            else:
                parse_card(data[1:].decode("utf-8", "replace"), "x")
                return
            Session(InferConfig(model=str(path), threads=1)).accept(CAMERA)

    return run


def _tiny_model() -> bytes:
    """depth and ray in, depth and depth out, no metadata."""
    from onnx import TensorProto, helper

    shape = [1, 1, "h", "w"]
    inputs = [
        helper.make_tensor_value_info("depth", TensorProto.FLOAT, shape),
        helper.make_tensor_value_info("ray", TensorProto.FLOAT, [1, 3, "h", "w"]),
    ]
    outputs = [helper.make_tensor_value_info(name, TensorProto.FLOAT, shape) for name in OUTPUTS]
    graph = helper.make_graph([helper.make_node("Identity", ["depth"], [name]) for name in OUTPUTS], "g", inputs, outputs)
    made_model: Any = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=9)
    return bytes(made_model.SerializeToString())


def _metadata(key: bytes, value: bytes) -> bytes:
    """One entry of `metadata_props` (field 14 of ModelProto) in protobuf's wire format, which may be appended to a model."""
    entry = b"\x0a" + _varint(len(key)) + key + b"\x12" + _varint(len(value)) + value
    return b"\x72" + _varint(len(entry)) + entry


def _varint(number: int) -> bytes:
    out = b""
    while number > 127:
        out += bytes([number & 127 | 128])
        number >>= 7
    return out + bytes([number])


def onnx_seeds(folder: Path) -> list[bytes]:
    """A good card in each of the three ways."""
    del folder
    card = Card(("depth", "ray"), 8, CAMERA, (0.2, 2.0), 0.01).to_json().encode()
    return [b"c" + card, b"m" + card, b"f" + _tiny_model() + _metadata(KEY.encode(), card), b"c" + json.dumps({"schema": 1}).encode()]
