# SPDX-License-Identifier: Apache-2.0
"""Bags of ideal depth, as a simulator would record them: the virtual robot's true depth from its true poses."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from tof_core.bag import open_bag
from tof_core.bag_writer import BagWriter

if TYPE_CHECKING:
    from pathlib import Path

    from benchmarks.recorded import Recorded

DEPTH, INFO, ALBEDO, FRAME = "/sim/depth/image", "/sim/depth/camera_info", "/sim/albedo_ir/image", "sim_camera"
PERIOD_NS = 33_333_333
"""Between captures of one view: 30 Hz."""


def ideal_bag(session: Recorded, out: Path, captures: int = 1) -> Path:
    """Write true depth and albedo of every view, `captures` times over, with TF of the true poses."""
    with open_bag(session.bag, cell_frame=session.scene.frame) as reader:
        camera = reader.camera
    albedo = np.array([*(p.material.albedo for p in session.scene.parts), np.nan])
    truth: dict[str, Any] = session.truth
    with BagWriter(out) as bag:
        for stamp, T, depth, part in zip(*(truth[k] for k in ("stamp_ns", "T_cell_camera", "depth", "part")), strict=True):
            first, last = int(stamp), int(stamp) + (captures - 1) * PERIOD_NS
            for at in range(first - 300_000_000, last + 300_000_001, 50_000_000):
                bag.tf(at, [(session.scene.frame, FRAME, T)])
            for at in range(first, last + 1, PERIOD_NS):
                bag.image(DEPTH, depth, "32FC1", FRAME, at)
                bag.image(ALBEDO, albedo[part].astype(np.float32), "32FC1", FRAME, at)
                bag.camera_info(INFO, camera, at, FRAME)
    return out
