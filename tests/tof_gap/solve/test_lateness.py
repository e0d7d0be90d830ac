# SPDX-License-Identifier: Apache-2.0
"""Late stamps apart from motion: by how long a frame of the taps is."""

from __future__ import annotations

import pytest

from tof_gap.solve.lateness import late_apart
from tof_gap.solved import Named
from tof_sensor.effects.motion import Motion
from tof_sensor.effects.range_offset import RangeOffset

FRAME_TAPS = 12.0
OFFSET = Named("range_offset", (RangeOffset(0.002),), ({"offset_m": 1e-4},), (), 1.0)


def named(axial_s: float, edge: float = 0.6, turned: float = 0.8) -> Named:
    """Motion whose taps are 5 ms apart: a frame of 60 ms."""
    effect = Motion(axial_s=axial_s, edge=edge, turned=turned, tap_s=0.005)
    return Named("motion", (effect,), ({"axial_s": 1e-3, "edge": 0.01, "turned": 0.01},), ("time_sync", "radial_depth"), 0.9)


def test_taps_are_apart_by_the_size_of_their_error() -> None:
    """Half of the error of taps 20 ms apart is that of taps 10 ms apart."""
    assert Motion(edge=0.3, turned=0.4, tap_s=0.02).apart_s == pytest.approx(0.01)


@pytest.mark.parametrize("axial_s", [0.0, 0.029, -0.029])
def test_a_mean_time_within_the_frame_is_motions_own(axial_s: float) -> None:
    found = (named(axial_s), OFFSET)
    assert late_apart(found, FRAME_TAPS) == found


@pytest.mark.parametrize("axial_s", [0.031, -0.031])
def test_a_stamp_outside_of_the_frame_is_late_besides(axial_s: float) -> None:
    found = late_apart((named(axial_s), OFFSET), FRAME_TAPS)
    assert [one.name for one in found] == ["motion", "range_offset", "time_sync"]
    motion, _, late = found
    assert motion.effects[0].late_s == 0.0, "the lateness is counted once"
    assert late.effects[0].late_s == axial_s
    assert late.std == ({"delay_s": 1e-3},)
    assert late.ties == motion.ties == ("radial_depth",), "named beside each other they are no tie"
    assert late.confidence == motion.confidence


def test_a_lateness_that_is_left_out_is_not_named() -> None:
    found = (named(0.2), OFFSET)
    assert late_apart(found, FRAME_TAPS, asked=False) == found


def test_a_session_without_motion_is_left_as_it_is() -> None:
    assert late_apart((OFFSET,), FRAME_TAPS) == (OFFSET,)
