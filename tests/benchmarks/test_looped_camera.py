# SPDX-License-Identifier: Apache-2.0
"""What became of each frame may be asked at any moment of a long run."""

from __future__ import annotations

import threading
from collections import defaultdict

import pytest

pytest.importorskip("rclpy", reason="no ROS 2 here")

from benchmarks.looped_camera import LoopedCamera


def test_lost_frames_are_counted_while_others_are_sent() -> None:
    camera = LoopedCamera.__new__(LoopedCamera)
    camera.sent, camera.fates, camera.latencies = {}, defaultdict(dict), []
    stop = threading.Event()

    def send() -> None:
        while not stop.is_set():
            stamp = len(camera.sent)
            camera.sent[stamp] = 0.0
            camera.latencies.append(0.02)
            camera.fates["infer"][stamp] = "no transform" if stamp in (3, 5) else "kept"

    sender = threading.Thread(target=send)
    sender.start()
    try:
        while len(camera.sent) < 20_000:
            assert 0 <= camera.lost("infer") <= 3 + 2
            assert camera.latency_ms(95) == pytest.approx(20.0) or not camera.latencies
    finally:
        stop.set()
        sender.join()
    assert camera.lost("infer") == 2
