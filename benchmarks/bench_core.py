# SPDX-License-Identifier: Apache-2.0
"""The way in: decoding a frame, looking a transform up, a bag written and read back."""

from __future__ import annotations

import time
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.figure import Figure, at_most
from tof_core import se3
from tof_core.bag import open_bag
from tof_core.bag_writer import BagWriter
from tof_core.camera import Camera
from tof_core.decode import decode_depth
from tof_core.encode import depth_counts, image_fields
from tof_core.tf import TransformBuffer

if TYPE_CHECKING:
    from collections.abc import Callable

    from tof_core.arrays import Image

CAMERA = Camera(400, 300, 377.0, 377.0, 199.5, 149.5, frame_id="camera")
FRAMES = 60
LINKS = 8
SECOND = 1_000_000_000


def run() -> list[Figure]:
    """All figures of one frame, 400x300."""
    depth = np.random.default_rng(0).uniform(0.3, 4.0, CAMERA.shape).astype(np.float32)
    counts = SimpleNamespace(**image_fields(depth_counts(depth), "16UC1"))
    metres = SimpleNamespace(**image_fields(depth, "32FC1"))
    write_ms, read_ms = bag_round_trip(depth)
    return [
        at_most("decode one 16UC1 frame to metres and reasons", best_ms(lambda: decode_depth(counts)), 1.0, "ms"),
        at_most("decode one 32FC1 frame to metres and reasons", best_ms(lambda: decode_depth(metres)), 1.0, "ms"),
        at_most(f"look a transform up over {LINKS} moving links", lookup_ms(), 0.2, "ms"),
        Figure("write one frame with camera_info and TF to MCAP", write_ms, "ms", remark=f"mean of {FRAMES}"),
        Figure("read it back as a capture with its robot pose", read_ms, "ms", remark="indexing the bag included"),
    ]


def best_ms(call: Callable[[], object], rounds: int = 50) -> float:
    """Best time of one call in milliseconds."""
    best = float("inf")
    for _ in range(rounds):
        begun = time.perf_counter()
        call()
        best = min(best, time.perf_counter() - begun)
    return 1e3 * best


def lookup_ms() -> float:
    """An arm at 50 Hz over ten seconds, asked between samples."""
    rng, buffer = np.random.default_rng(1), TransformBuffer()
    for step in range(500):
        for link in range(LINKS):
            buffer.add(f"link{link}", f"link{link + 1}", step * SECOND // 50, se3.exp(0.1 * rng.standard_normal(6)))
    return best_ms(lambda: buffer.lookup("link0", f"link{LINKS}", 5 * SECOND + 7_000_000))


def bag_round_trip(depth: Image) -> tuple[float, float]:
    """Milliseconds a frame to write a bag and to read it."""
    with TemporaryDirectory() as folder:
        begun = time.perf_counter()
        with BagWriter(Path(folder) / "bag") as bag:
            for i in range(FRAMES):
                stamp = i * SECOND // 15
                for step in range(4):
                    bag.tf(stamp + step * SECOND // 60, [("cell", "camera", np.eye(4))])
                bag.camera_info("/depth/camera_info", CAMERA, stamp)
                bag.image("/depth/image", depth_counts(depth + 0.001 * i), "16UC1", "camera", stamp)
        written = time.perf_counter()
        with open_bag(Path(folder) / "bag", cell_frame="cell") as reader:
            frames = sum(1 for _ in reader.captures())
        done = time.perf_counter()
    assert frames == FRAMES
    return 1e3 * (written - begun) / FRAMES, 1e3 * (done - written) / FRAMES
