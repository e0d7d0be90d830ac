# SPDX-License-Identifier: Apache-2.0
"""Small labelled datasets of a wall seen by a camera with one known error, and a network trained on them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_core.camera import Camera
from tof_core.capture import Capture, Posed, RobotPose, View
from tof_infer.config import NetConfig, TrainConfig
from tof_sim_label.dataset import DatasetWriter
from tof_sim_label.label import Label
from tof_sim_label.schema import Attributes

if TYPE_CHECKING:
    from pathlib import Path

    from tof_core.arrays import Image

CAMERA = Camera(width=44, height=30, fx=40.0, fy=40.0, cx=21.5, cy=14.5, frame_id="hand_depth")
TINY = TrainConfig(net=NetConfig(base=4, levels=2), epochs=2, batch=2, threads=1, drop=0.2)
OFFSET_M = 0.02


def wall(number: int, camera: Camera = CAMERA) -> Image:
    """True depth (H, W) of a wall at 0.6 to 1.2 m, tilted, another one for each number."""
    rng = np.random.default_rng([number, 1])
    a, b, c = rng.uniform(-0.3, 0.3), rng.uniform(-0.3, 0.3), 1 / rng.uniform(0.6, 1.2)
    rays = camera.rays()
    return (1 / (c + a * rays[..., 0] * c + b * rays[..., 1] * c)).astype(np.float32)


def measured(number: int, camera: Camera = CAMERA, offset_m: float = OFFSET_M) -> Capture:
    """The camera's measurement: 20 mm too far (unless said otherwise), 2 mm of noise, one pixel lost."""
    rng = np.random.default_rng([number, 2])
    true = wall(number, camera)
    depth = (true + offset_m + rng.normal(0, 2e-3, true.shape)).astype(np.float32)
    depth[2, 3] = np.nan
    return Capture(
        1_000_000_000 + number, camera, depth, np.isnan(depth).astype(np.uint8), None, (100 / true**2).astype(np.float32), None, 30.0
    )


def labelled(number: int, camera: Camera = CAMERA) -> Label:
    """Its exact label, trusted everywhere."""
    true = wall(number, camera)
    return Label(
        true,
        np.full_like(true, 1e-4),
        np.ones(true.shape, np.uint8),
        np.zeros(true.shape, np.uint8),
        np.zeros(true.shape, np.int16),
        np.zeros_like(true),
        np.full_like(true, 0.2),
        Posed(np.eye(4), np.eye(6) * 1e-8),
    )


def write_dataset(
    path: Path,
    views: int = 8,
    stations: int = 4,
    camera: Camera = CAMERA,
    *,
    damage: str = "",
    damaged: int = 1,
    first: int = 0,
    offset_m: float = OFFSET_M,
) -> Path:
    """A dataset of so many walls; `damage` destroys the first `damaged` views: `nan` its label, `mask` its mask, `raw` its frame."""
    with DatasetWriter(path, camera, Attributes("cad", "config", "robot", ("wall",))) as writer:
        for k in range(views):
            capture, label = measured(first + k, camera, offset_m), labelled(first + k, camera)
            if k < damaged and damage == "nan":
                label.depth[:] = np.nan
            if k < damaged and damage == "mask":
                label.mask[:] = 0
            if k < damaged and damage == "raw":
                capture.depth[:] = np.nan
            view = View.of_capture(capture, k * stations // views)
            robot = RobotPose(np.eye(4), np.eye(4))
            writer.append_capture(capture, k)
            writer.append_view(View(**{n: getattr(view, n) for n in view.__slots__} | {"robot": robot}), label)
    return path
