# SPDX-License-Identifier: Apache-2.0
"""Frames wait in the node's own turns."""

from __future__ import annotations

from tof_ros.patience import ALWAYS, NEVER, Patience


def test_a_frame_is_overdue_after_its_ticks_and_takes_older_ones_along() -> None:
    patience = Patience(0.3)
    patience.start(100)
    assert patience.tick() == NEVER
    patience.start(200)
    assert patience.tick() == NEVER
    assert patience.tick() == 100
    assert patience.tick() == 200


def test_a_frame_that_is_done_is_never_overdue() -> None:
    patience = Patience(0.2)
    patience.start(100)
    patience.end(100)
    assert [patience.tick() for _ in range(5)] == [NEVER] * 5


def test_a_frame_heard_twice_keeps_its_age() -> None:
    patience = Patience(0.2)
    patience.start(100)
    patience.tick()
    patience.start(100)
    assert patience.tick() == 100


def test_the_oldest_stamp_is_that_of_the_first_frame_that_waits() -> None:
    patience = Patience(0.2)
    assert patience.oldest == ALWAYS
    for stamp in (300, 100, 200):
        patience.start(stamp)
    assert patience.oldest == 100
    patience.end(100)
    assert patience.oldest == 200
