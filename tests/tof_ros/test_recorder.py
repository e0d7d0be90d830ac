# SPDX-License-Identifier: Apache-2.0
"""A recording is whole when the topics of each room have carried as many messages."""

from __future__ import annotations

from collections import Counter

import pytest

pytest.importorskip("rclpy", reason="no ROS 2 here: neither sourced nor from pip")

from tof_ros.recorder import Recorder


def recorder(**counts: int) -> Recorder:
    made = object.__new__(Recorder)
    made.counts = Counter({f"/{name.replace('__', '/')}": n for name, n in counts.items()})
    return made


def test_rooms_are_even_each_for_itself() -> None:
    assert recorder().even
    assert recorder(preproc__depth=96, preproc__sigma=96, label__depth=12, label__pose=12).even
    assert not recorder(preproc__depth=95, preproc__sigma=96, label__depth=12).even
