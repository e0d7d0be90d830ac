# SPDX-License-Identifier: Apache-2.0
"""Frames whose every error is known."""

from __future__ import annotations

import numpy as np

from tof_core.camera import Camera
from tof_core.capture import Capture
from tof_scene.render import Rendering

CAMERA = Camera(40, 30, 40.0, 40.0, 19.5, 14.5, frame_id="cam")


def rendering(depth: np.ndarray, albedo: float = 0.5) -> Rendering:
    """Left half part 0 (dark), right half part 1."""
    shape = CAMERA.shape
    part = np.zeros(shape, np.int16)
    part[:, 20:] = 1
    none = np.full(shape, np.nan, np.float32)
    light = np.where(part == 0, 0.05, albedo).astype(np.float32)
    return Rendering(
        CAMERA,
        np.eye(4),
        depth,
        part,
        part.astype(np.int32),
        np.zeros((*shape, 3), np.float32),
        np.full(shape, 0.3, np.float32),
        light,
        np.zeros(shape, np.float32),
        none,
    )


def capture(depth: np.ndarray, stamp: int = 1, amplitude: np.ndarray | None = None) -> Capture:
    depth = depth.astype(np.float32)
    return Capture(
        stamp, CAMERA, depth, np.isnan(depth).astype(np.uint8), None, None if amplitude is None else amplitude.astype(np.float32)
    )
