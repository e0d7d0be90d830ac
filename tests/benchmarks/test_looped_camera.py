# SPDX-License-Identifier: Apache-2.0
"""What became of each frame may be asked at any moment of a long run."""

from __future__ import annotations

from collections import defaultdict
from typing import Any

import pytest

pytest.importorskip("rclpy", reason="no ROS 2 here")

from benchmarks.looped_camera import LoopedCamera


def test_lost_frames_are_counted_while_others_are_sent() -> None:
    camera = LoopedCamera.__new__(LoopedCamera)
    camera.sent, camera.fates = dict.fromkeys(range(100), 0.0), defaultdict(dict)

    class Busy(dict[int, str]):
        """Another frame is sent whenever one is looked up."""

        def get(self, stamp: int, default: Any = None) -> Any:
            camera.sent[len(camera.sent)] = 0.0
            return super().get(stamp, default)

    camera.fates["infer"] = Busy({stamp: "no transform" if stamp in (3, 5) else "kept" for stamp in range(99)})
    assert camera.lost("infer") == 3
    assert len(camera.sent) == 200
