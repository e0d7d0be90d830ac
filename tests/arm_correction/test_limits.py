# SPDX-License-Identifier: Apache-2.0
"""Safety limits of a correction: each at its exact bound, just beyond it, and for what is no number."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from arm_correction.config import CorrectConfig, LimitConfig
from arm_correction.correction import SMALLEST_COV, Correction, Moment, propose
from arm_correction.corrector import twin_of
from arm_correction.frames import Frames
from arm_correction.live import driver_frame
from arm_correction.register import Registration
from arm_correction.unknown import Unknown
from benchmarks.closed_loop import LoopConfig, close_loop
from tests.arm_correction.made import twist
from tests.tof_align.made import at
from tof_core import se3
from tof_core.capture import RobotPose
from tof_core.errors import RefusedError

if TYPE_CHECKING:
    from tof_core.arrays import Float

CONFIG = CorrectConfig()
LIMITS = CONFIG.limits
NAN = float("nan")
AT_ORIGIN = RobotPose(np.eye(4), np.eye(4))


def found(motion: Float | None = None, **changes: object) -> Registration:
    """A registration that is accepted; without `motion` the camera is where it should be."""
    cov = np.diag([1e-4, 1e-4, 1e-4, 1e-4, 1e-4, 1e-4]) ** 2
    T = np.eye(4) if motion is None else motion
    made = Registration(T, cov, Unknown(np.zeros((0, 6)), ()), True, "ok", 5000, 0.9, 0.95, 1e-3, 1e-3, False)
    return replace(made, **changes)  # type: ignore[arg-type]


def limited(**limits: float) -> CorrectConfig:
    return replace(CONFIG, limits=replace(LIMITS, **limits))


def refusal(out: Correction) -> str:
    """The reason of a refusal, which moves nothing; "" where the motion is released."""
    if out.accepted:
        assert out.verdict == ("partial" if out.unknown else "accepted")
        return ""
    assert out.verdict == "refused"
    np.testing.assert_array_equal(out.delta, np.eye(4))
    return out.reason


def slide(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Float:
    T = np.eye(4)
    T[:3, 3] = x, y, z
    return T


def turn(degrees: float) -> Float:
    return se3.exp(np.array([0, 0, 0, 0, np.radians(degrees), 0]))


def test_the_limits_that_hold_without_a_configuration() -> None:
    """A change of a safety limit's default is a decision, not an accident."""
    assert LimitConfig() == LimitConfig(
        step_mm=400.0, step_deg=25.0, reach_m=1.4, low_m=-0.5, stale_s=5.0, moved_mm=1.0, moved_deg=0.1,
        disagree_sigma=4.0, disagree_mm=1.5, disagree_deg=0.15,
    )  # fmt: skip


@pytest.mark.parametrize("axis", range(3))
def test_a_step_is_released_up_to_its_limit_and_not_beyond(axis: int) -> None:
    shift = np.zeros(3)
    shift[axis] = 0.125
    config = limited(step_mm=125.0, low_m=-5.0)
    assert refusal(propose(found(slide(*shift)), AT_ORIGIN, config)) == ""
    assert "step limit" in refusal(propose(found(slide(*(1.0001 * shift))), AT_ORIGIN, config))
    assert "step limit" in refusal(propose(found(slide(*(-1.0001 * shift))), AT_ORIGIN, config))


def test_a_turn_is_released_up_to_its_limit_and_not_beyond() -> None:
    _, degrees = se3.distance(np.eye(4), se3.inverse(turn(10.0)))
    assert refusal(propose(found(turn(10.0)), AT_ORIGIN, limited(step_deg=degrees))) == ""
    assert "step limit" in refusal(propose(found(turn(10.0)), AT_ORIGIN, limited(step_deg=degrees - 1e-6)))
    assert "10.0 deg" in refusal(propose(found(turn(10.0)), AT_ORIGIN, limited(step_deg=9.0)))


def test_the_step_is_that_of_the_hand_not_of_the_camera() -> None:
    """A turn of 10 degrees of a camera 0.5 m before the hand moves the hand by 87 mm."""
    out = propose(found(turn(10.0)), AT_ORIGIN, limited(step_mm=80.0), T_hand_camera=slide(z=0.5))
    assert "step limit: the hand would move by 87 mm and 10.0 deg" in refusal(out)
    assert refusal(propose(found(turn(10.0)), AT_ORIGIN, limited(step_mm=88.0), T_hand_camera=slide(z=0.5))) == ""


@pytest.mark.parametrize("direction", [(1, 0, 0), (0, -1, 0), (0, 0, 1)])
def test_the_hand_stays_within_reach(direction: tuple[int, int, int]) -> None:
    robot = RobotPose(np.eye(4), slide(*(0.75 * np.array(direction))))
    assert refusal(propose(found(), robot, limited(reach_m=0.75))) == ""
    said = refusal(propose(found(), robot, limited(reach_m=0.7499)))
    assert "workspace limit: the hand would be 0.75 m from the body" in said


def test_the_hand_stays_above_the_floor() -> None:
    robot = RobotPose(np.eye(4), slide(z=-0.25))
    assert refusal(propose(found(), robot, limited(low_m=-0.25))) == ""
    assert "workspace limit" in refusal(propose(found(), robot, limited(low_m=-0.2499)))
    assert "-0.25 m high" in refusal(propose(found(), robot, limited(low_m=0.1)))


def test_the_target_counts_and_not_where_the_hand_is() -> None:
    """The camera stands 0.2 m too high: the target is 0.2 m lower."""
    above = found(slide(z=0.2))
    assert "-0.20 m high" in refusal(propose(above, AT_ORIGIN, limited(low_m=-0.1)))
    assert refusal(propose(found(slide(z=-0.2)), AT_ORIGIN, limited(low_m=-0.1))) == ""
    assert "0.50 m from the body" in refusal(propose(found(slide(x=-0.2)), RobotPose(np.eye(4), slide(x=0.3)), limited(reach_m=0.4)))


def test_the_workspace_is_the_bodys_in_whatever_frame_targets_are_given() -> None:
    robot, T_odom_body = RobotPose(np.eye(4), slide(x=0.5, z=-0.25)), at(40.0, -20.0, 3.0, (0, 0, 1.0))
    inside = propose(found(), robot, limited(reach_m=0.6, low_m=-0.3), T_frame_body=T_odom_body, frame="odom")
    assert refusal(inside) == ""
    for limits in ({"low_m": -0.2}, {"reach_m": 0.5}):
        assert "workspace limit" in refusal(propose(found(), robot, limited(**limits), T_frame_body=T_odom_body, frame="odom"))


def test_a_view_is_stale_after_its_limit() -> None:
    for age, released in ((0.0, True), (5.0, True), (5.001, False), (-1.0, True), (-1.001, False)):
        out = refusal(propose(found(), AT_ORIGIN, limited(stale_s=5.0), moment=Moment(age_s=age)))
        assert (out == "") == released, age
        assert released or f"stale: the view is {age:.1f} s old" in out


def test_a_robot_that_moved_since_the_view_is_refused() -> None:
    _, degrees = se3.distance(np.eye(4), turn(0.1))
    config = limited(moved_mm=1.0, moved_deg=degrees)
    for moved, released in ((slide(x=0.001), True), (slide(x=0.0010001), False), (turn(0.1), True), (turn(0.1001), False)):
        for now in (RobotPose(moved, np.eye(4)), RobotPose(np.eye(4), moved)):
            out = refusal(propose(found(), AT_ORIGIN, config, moment=Moment(robot=now)))
            assert (out == "") == released
            assert released or "moved meanwhile" in out


def test_two_dwells_disagree_beyond_their_sigmas_and_by_more_than_matters() -> None:
    """Sigmas: sqrt(xi' inv(C1 + C2) xi / 6), so that 2 mm with 0.1 mm each are 2 / 0.1414 / sqrt(6) = 5.77."""
    sigmas = 2e-3 / np.sqrt(2e-8) / np.sqrt(6)
    other = found(slide(x=0.002))
    for limits, released in (
        ({}, False),
        ({"disagree_sigma": sigmas * 1.001}, True),
        ({"disagree_sigma": sigmas * 0.999}, False),
        ({"disagree_mm": 2.0}, True),
        ({"disagree_mm": 1.999}, False),
    ):
        out = refusal(propose(found(), AT_ORIGIN, limited(**limits), earlier=other))
        assert (out == "") == released, limits
    assert "disagree by 2.0 mm and 0.00 deg, 6 of their sigmas" in refusal(propose(found(), AT_ORIGIN, CONFIG, earlier=other))
    for limit, released in ((0.3, True), (0.2, False)):
        out = refusal(propose(found(), AT_ORIGIN, limited(disagree_deg=limit), earlier=found(turn(0.25))))
        assert (out == "") == released
    assert "the other one was refused (dark)" in refusal(propose(found(), AT_ORIGIN, CONFIG, earlier=found(accepted=False, reason="dark")))


@pytest.mark.parametrize("axis", range(3))
def test_dwells_of_one_pose_are_compared_where_they_are(axis: int) -> None:
    """A turn of 0.14 degrees lies within 0.15, one of 0.25 does not; where both stand does not matter."""
    there = at(0.2, -0.1, 0.3, (0.2, 0.1, -0.1))
    config = limited(step_mm=1000.0, step_deg=90.0, low_m=-5.0, reach_m=5.0)
    for degrees, released in ((0.14, True), (0.25, False)):
        turned = np.zeros(6)
        turned[3 + axis] = np.radians(degrees)
        assert (refusal(propose(found(there), AT_ORIGIN, config, earlier=found(there @ se3.exp(turned)))) == "") == released


def test_dwells_at_their_limits_agree() -> None:
    one, other = found(), found(slide(x=0.002) @ turn(0.25))
    xi = se3.log(other.T_reference_now)
    sigmas = float(np.sqrt(xi @ np.linalg.solve(one.cov + other.cov + SMALLEST_COV, xi) / 6.0))
    degrees = float(np.degrees(np.linalg.norm(xi[3:])))
    assert refusal(propose(one, AT_ORIGIN, limited(disagree_sigma=sigmas), earlier=other)) == ""
    assert refusal(propose(one, AT_ORIGIN, limited(disagree_mm=10.0, disagree_deg=degrees), earlier=other)) == ""
    assert refusal(propose(one, AT_ORIGIN, limited(disagree_mm=10.0, disagree_deg=degrees - 1e-9), earlier=other)) != ""


def test_dwells_without_any_covariance_disagree_in_numbers() -> None:
    exact = found(cov=np.zeros((6, 6)))
    said = refusal(propose(exact, AT_ORIGIN, CONFIG, earlier=replace(exact, T_reference_now=slide(x=0.002))))
    assert re.search(r"\d+ of their sigmas", said)


def test_sigmas_of_both_dwells_count() -> None:
    unsure = found(slide(x=0.002), cov=np.eye(6) * 1e-4)
    assert refusal(propose(found(), AT_ORIGIN, CONFIG, earlier=unsure)) == ""
    assert refusal(propose(replace(unsure, T_reference_now=np.eye(4)), AT_ORIGIN, CONFIG, earlier=found(slide(x=0.002)))) == ""


def test_what_was_refused_is_never_released() -> None:
    out = propose(found(accepted=False, reason="low support"), AT_ORIGIN, CONFIG)
    assert refusal(out) == "low support"
    unknown = Unknown(np.eye(6)[:1], ("slides along camera x",))
    partly = propose(found(accepted=False, reason="low support", unknown=unknown), AT_ORIGIN, CONFIG)
    assert partly.verdict == "refused", "what is not known does not make a refusal partial"
    assert propose(found(unknown=unknown), AT_ORIGIN, CONFIG).verdict == "partial"


@pytest.mark.parametrize("place", [(0, 3), (1, 1), (2, 3)])
def test_what_is_no_number_moves_nothing(place: tuple[int, int]) -> None:
    broken = np.eye(4)
    broken[place] = NAN
    pose = RobotPose(np.eye(4), broken)
    for out in (
        propose(found(broken), AT_ORIGIN, CONFIG),
        propose(found(), AT_ORIGIN, CONFIG, T_hand_camera=broken),
        propose(found(), AT_ORIGIN, CONFIG, moment=Moment(robot=pose)),
        propose(found(), AT_ORIGIN, CONFIG, earlier=found(broken)),
    ):
        assert refusal(out) != ""


def test_a_hand_at_no_number_and_an_age_of_none_move_nothing() -> None:
    assert "workspace" in refusal(propose(found(), RobotPose(np.eye(4), slide(x=NAN)), CONFIG))
    assert "workspace" in refusal(propose(found(), RobotPose(np.eye(4), slide(z=NAN)), CONFIG))
    assert "stale" in refusal(propose(found(), AT_ORIGIN, CONFIG, moment=Moment(age_s=NAN)))
    assert refusal(propose(found(), AT_ORIGIN, CONFIG, earlier=found(slide(x=0.002), cov=np.full((6, 6), NAN)))) != ""


@pytest.mark.parametrize(
    ("frame", "hand", "gives"),
    [
        ("body", "hand", "body"),
        ("spot/odom", "spot/hand", "odom"),
        ("vision", "hand", "vision"),
        ("cell", "hand", ""),
        ("body", "camera", ""),
        ("bodyx", "hand", ""),
        ("odom/cell", "hand", ""),
    ],
)
def test_the_arm_is_sent_only_what_its_driver_reads_alike(frame: str, hand: str, gives: str) -> None:
    frames = Frames(frame=frame, hand=hand)
    if gives:
        assert driver_frame(frames) == gives
        return
    with pytest.raises(RefusedError, match="the arm's driver"):
        driver_frame(frames)


def test_the_dwell_before_counts_only_where_the_robot_stood() -> None:
    from tests.arm_correction.made import CAMERA
    from tof_core.capture import View

    def view(station: int, T: Float | None) -> View:
        none = np.zeros((1, 1), np.float32)
        robot = None if T is None else RobotPose(np.eye(4), T)
        return View(1, 1, CAMERA, none, none, none.astype(np.uint16), none.astype(np.uint8), robot, captures=1, station=station)

    _, degrees = se3.distance(np.eye(4), turn(0.1))
    limits = replace(LIMITS, moved_mm=1.0, moved_deg=degrees)
    here = view(0, np.eye(4))
    for before, is_twin in (
        (view(0, np.eye(4)), True),
        (view(0, slide(x=0.0009995)), True),
        (view(0, slide(x=0.001)), False),
        (view(0, turn(0.099)), True),
        (view(0, turn(0.1)), False),
        (view(1, np.eye(4)), False),
        (view(0, None), False),
    ):
        assert (twin_of([before, here], limits) is before) == is_twin
    assert twin_of([here], limits) is None
    assert twin_of([here, view(0, None)], limits) is None
    first = view(0, np.eye(4))
    middle = view(0, np.eye(4))
    assert twin_of([first, middle, here], limits) is middle
    for last in (view(1, np.eye(4)), view(0, None), view(0, slide(x=0.1))):
        assert twin_of([first, middle, last], limits) is None


class Looked:
    """A first picture and an arm: each look gives the next registration, each move is noted."""

    def __init__(self, *registrations: Registration) -> None:
        self.left = list(registrations)
        self.went: list[Float] = []

    def register(self, view: object, config: CorrectConfig) -> Registration:
        return self.left.pop(0)

    def goto(self, T_body_hand: Float) -> None:
        self.went.append(T_body_hand)


def closed(*registrations: Registration) -> tuple[bool, int, str, int]:
    from types import SimpleNamespace

    world = Looked(*registrations)
    loop = LoopConfig(tolerance_mm=0.5, tolerance_deg=0.05)
    out = close_loop(world, lambda: SimpleNamespace(robot=AT_ORIGIN), world, CONFIG, np.eye(4), loop)  # type: ignore[arg-type, return-value]
    assert out.moves == len(world.went)
    return out.done, out.moves, out.reason, len(out.corrections)


def test_a_loop_ends_where_it_should() -> None:
    far, near, inside = found(twist((30, 0, 0))), found(twist((0.8, 0, 0))), found(twist((0.5, 0, 0)))
    refused, by_cad = found(accepted=False, reason="dark"), found(twist((0.1, 0, 0)), by="cad")
    assert closed(inside) == (True, 0, "inside tolerance", 1)
    assert closed(far, inside) == (True, 1, "inside tolerance", 2)
    assert closed(far, refused) == (False, 1, "dark", 2)
    assert closed(near, near) == (True, 1, "as near as the arm gets", 2)
    assert closed(found(twist((1.6, 0, 0))), near, inside)[1] == 2, "half as far as before: go on"
    assert closed(far, far, far, far) == (False, 3, "moves used up", 4)
    assert closed(far, far, found(twist((3.0, 0, 0))), found(twist((1.0, 0, 0)))) == (True, 3, "moves used up", 4)
    assert closed(far, far, found(twist((3.0, 0, 0))), found(twist((1.01, 0, 0)))) == (False, 3, "moves used up", 4)
    assert closed(by_cad, by_cad, by_cad, by_cad) == (False, 3, "moves used up", 4), "the CAD brings near, it does not end the loop"
    assert closed(found(turn(0.051)), found(turn(0.01)))[:2] == (True, 1)
    assert closed(found(turn(0.1)), found(turn(0.049)))[:2] == (True, 1)
    assert closed(found(twist((2.0, 0, 0), (0, 0.2, 0))), found(twist((0.9, 0, 0), (0, 0.11, 0))), found()) == (
        True,
        2,
        "inside tolerance",
        3,
    )
