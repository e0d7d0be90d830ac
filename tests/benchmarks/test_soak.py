# SPDX-License-Identifier: Apache-2.0
"""The long run's rows: the worst node counts, and what else the machine did stands beside."""

from __future__ import annotations

import pytest

pytest.importorskip("rclpy", reason="no ROS 2 here")

from benchmarks.soak import Run, rows

GOOD = Run(15.0, 9000, {"preproc": 0, "label": 0, "infer": 0}, 30.0, 80.0, 4.0, {"preproc": 30.0, "camera": 5.0}, 0.1, 0)


def test_a_run_that_loses_nothing_meets_its_bars() -> None:
    figures = rows(GOOD, 10.0)
    assert [f.met for f in figures] == [True, True, True]
    assert "9000 frames at 15.0 Hz in 10 min" in figures[0].remark
    assert "other processes 0.10 cores" in figures[0].remark


def test_one_frame_lost_by_one_node_misses_the_bar() -> None:
    from dataclasses import replace

    figures = rows(replace(GOOD, lost={"preproc": 0, "label": 1, "infer": 0}, p95_ms=101.0, grown_mb=21.0), 10.0)
    assert [f.met for f in figures] == [False, False, False]
    assert figures[0].value == 1
