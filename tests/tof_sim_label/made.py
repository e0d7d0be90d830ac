# SPDX-License-Identifier: Apache-2.0
"""Small captures, views and labels whose values encode their number."""

from __future__ import annotations

import numpy as np

from tof_core import se3
from tof_core.camera import Camera
from tof_core.capture import Capture, Posed, RobotPose, View
from tof_sim_label.label import Label
from tof_sim_label.schema import Attributes

CAMERA = Camera(width=12, height=8, fx=10.0, fy=10.0, cx=5.5, cy=3.5, frame_id="hand_depth")
ATTRIBUTES = Attributes(cad_hash="cad0", config_hash="config0", pose_source="session, final", parts=("sill", "clip"))


def capture(number: int, camera: Camera = CAMERA) -> Capture:
    """Capture `number`: depth 1 m + number mm with one invalid pixel, amplitude 100 + number."""
    depth = np.full(camera.shape, 1.0 + number / 1000, np.float32)
    depth[0, 0] = np.nan
    return Capture(
        stamp_ns=1_000 + number,
        camera=camera,
        depth=depth,
        reason=np.isnan(depth).astype(np.uint8),
        amplitude=np.full(camera.shape, 100.0 + number, np.float32),
        temperature=20.0 + number,
    )


def view(number: int, station: int = 0, camera: Camera = CAMERA) -> View:
    """View `number`: depth 2 m + number mm, sigma 1 mm, count number + 1."""
    shape = camera.shape
    return View(
        stamp_ns=2_000 + number,
        dwell_ns=1_000 + number,
        camera=camera,
        depth=np.full(shape, 2.0 + number / 1000, np.float32),
        sigma=np.full(shape, 1e-3, np.float32),
        count=np.full(shape, number + 1, np.uint16),
        reason=np.zeros(shape, np.uint8),
        robot=RobotPose(np.eye(4), np.eye(4)),
        station=station,
    )


def label(number: int, camera: Camera = CAMERA) -> Label:
    """Label `number`: depth 3 m + number mm, sigma 2 mm; the left half is part 0, the right half misses."""
    shape = camera.shape
    hit = np.arange(camera.width) < camera.width // 2
    pose = se3.exp([0.1 * number, 0.2, 0.3, 0.01, 0.02, 0.03])
    return Label(
        depth=np.where(hit, 3.0 + number / 1000, np.nan).astype(np.float32) * np.ones(shape, np.float32),
        sigma=np.full(shape, 2e-3, np.float32),
        mask=np.broadcast_to(hit, shape).astype(np.uint8),
        reason=np.broadcast_to(~hit, shape).astype(np.uint8) * np.uint8(2),
        part=np.broadcast_to(np.where(hit, 0, -1), shape).astype(np.int16),
        mixed=np.full(shape, 0.25, np.float32),
        incidence=np.full(shape, 0.5, np.float32),
        posed=Posed(pose, np.diag([1e-6] * 3 + [1e-8] * 3), verdict=f"ok {number}"),
    )
