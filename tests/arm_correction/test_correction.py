# SPDX-License-Identifier: Apache-2.0
"""The proposal: frames, hand-eye, covariance, and every reason for a refusal."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from arm_correction.correction import Moment, propose
from arm_correction.register import Registration
from arm_correction.unknown import Unknown
from tests.arm_correction.made import CONFIG, twist
from tests.tof_align.made import at
from tof_core import se3
from tof_core.capture import RobotPose

HAND_EYE = at(0.06, 0.0, 0.04, (0.3, -1.1, 0.2))
BODY, CAMERA_IN_BODY = at(1.5, 0.2, 0.5, (0, 0, 3.0)), at(0.6, 0.1, 0.3, (0.2, 0.5, -0.1))
ROBOT = RobotPose(BODY, CAMERA_IN_BODY)
MOTION = twist((30, -12, 8), (1.0, 2.0, -0.5))


def found(motion: np.ndarray = MOTION, **changes: object) -> Registration:
    cov = np.diag([1e-4, 2e-4, 3e-4, 1e-3, 2e-3, 3e-3]) ** 2
    made = Registration(motion, cov, Unknown(np.zeros((0, 6)), ()), True, "ok", 5000, 0.9, 0.95, 1e-3, 1e-3, False)
    return replace(made, **changes)  # type: ignore[arg-type]


def test_a_camera_that_obeys_is_back_where_the_reference_was_taken() -> None:
    out = propose(found(), ROBOT, CONFIG, T_hand_camera=HAND_EYE)
    camera_after = out.T_frame_hand @ HAND_EYE
    np.testing.assert_allclose(camera_after, CAMERA_IN_BODY @ se3.inverse(MOTION), atol=1e-12)
    np.testing.assert_allclose(CAMERA_IN_BODY @ se3.inverse(HAND_EYE) @ out.delta, out.T_frame_hand, atol=1e-12)
    assert (out.verdict, out.reason) == ("accepted", "ok")


def test_the_odom_frame_holds_the_same_pose() -> None:
    T_odom_body = at(4.0, -2.0, 0.5, (0, 0, 1.2))
    body = propose(found(), ROBOT, CONFIG, T_hand_camera=HAND_EYE)
    odom = propose(found(), ROBOT, CONFIG, T_hand_camera=HAND_EYE, T_frame_body=T_odom_body, frame="odom")
    np.testing.assert_allclose(odom.T_frame_hand, T_odom_body @ body.T_frame_hand, atol=1e-12)
    assert odom.frame == "odom"


def test_the_covariance_is_that_of_the_target() -> None:
    rng = np.random.default_rng(0)
    f = found()
    out = propose(f, ROBOT, CONFIG, T_hand_camera=HAND_EYE)
    drawn = []
    for xi in rng.multivariate_normal(np.zeros(6), f.cov, 4000):
        T = propose(replace(f, T_reference_now=MOTION @ se3.exp(xi)), ROBOT, CONFIG, T_hand_camera=HAND_EYE).T_frame_hand
        drawn.append(np.concatenate([T[:3, 3] - out.T_frame_hand[:3, 3], se3.so3_log(T[:3, :3] @ out.T_frame_hand[:3, :3].T)]))
    np.testing.assert_allclose(np.sqrt(np.diag(np.cov(np.array(drawn).T))), np.sqrt(np.diag(out.cov)), rtol=0.06)
    squares = np.einsum("ni,ij,nj->n", drawn, np.linalg.inv(out.cov), drawn)
    low, high = chi2.ppf([0.005, 0.995], 6 * len(drawn)) / len(drawn)
    assert low < squares.mean() < high, "the whole matrix, from both sides"


@pytest.mark.parametrize(
    ("registration", "moment", "reason"),
    [
        (found(accepted=False, reason="low support: x"), Moment(), "low support"),
        (found(), Moment(age_s=9.0), "stale"),
        (found(), Moment(robot=RobotPose(BODY, CAMERA_IN_BODY @ twist((3, 0, 0)))), "moved meanwhile"),
        (found(twist((500, 0, 0))), Moment(), "step limit"),
        (found(twist((0, 0, 0), (0, 40, 0))), Moment(), "step limit"),
    ],
)
def test_nothing_is_proposed_when(registration: Registration, moment: Moment, reason: str) -> None:
    out = propose(registration, ROBOT, CONFIG, T_hand_camera=HAND_EYE, moment=moment)
    assert out.verdict == "refused"
    assert reason in out.reason
    np.testing.assert_allclose(out.T_frame_hand, CAMERA_IN_BODY @ se3.inverse(HAND_EYE), atol=1e-12)
    assert out.step == (0.0, 0.0)


def test_a_hand_out_of_reach_is_refused() -> None:
    out = propose(found(), ROBOT, replace(CONFIG, limits=replace(CONFIG.limits, reach_m=0.3)))
    assert "workspace limit" in out.reason


def test_two_dwells_must_agree() -> None:
    near, apart = found(MOTION @ twist((0.2, 0, 0))), found(MOTION @ twist((6.0, 0, 0)))
    assert propose(found(), ROBOT, CONFIG, earlier=near).accepted
    out = propose(found(), ROBOT, CONFIG, earlier=apart)
    assert not out.accepted
    assert "two dwells disagree by 6.0 mm" in out.reason


def test_a_partial_correction_lists_the_undetermined_directions() -> None:
    out = propose(found(unknown=Unknown(np.eye(6)[:1], ("slides along camera x",))), ROBOT, CONFIG)
    assert out.verdict == "partial"
    assert out.reason == "no motion along undetermined directions: slides along camera x"
    assert out.to_dict()["not_known"] == ["slides along camera x"]
