# SPDX-License-Identifier: Apache-2.0
"""From a registration to a proposal: target of the hand, its covariance, and the reasons for a refusal."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from tof_core import se3

if TYPE_CHECKING:
    from arm_correction.config import CorrectConfig, LimitConfig
    from arm_correction.register import Registration
    from tof_core.arrays import Float
    from tof_core.capture import RobotPose


SMALLEST_COV = 1e-18 * np.eye(6)
"""m^2 and rad^2: a nanometre, so that a sum of two zero covariances is regular."""


@dataclass(frozen=True, slots=True, eq=False)
class Correction:
    """A proposal. It never moves the robot.

    T_frame_hand (4, 4): where the hand should go, in `frame` (the body by default); delta (4, 4): the motion of the hand in its
    own axes; cov (6, 6) of the target with fixed axes of `frame`; unknown: undetermined directions, along which nothing moves.
    If refused, the target is the present pose of the hand.
    """

    T_frame_hand: Float
    delta: Float
    cov: Float
    accepted: bool
    reason: str
    unknown: tuple[str, ...]
    frame: str = "body"
    by: str = "reference"
    facts: dict[str, float] = field(default_factory=dict)

    @property
    def step(self) -> tuple[float, float]:
        """Proposed motion of the hand: millimetres and degrees."""
        metres, degrees = se3.distance(np.eye(4), self.delta)
        return 1e3 * metres, degrees

    @property
    def verdict(self) -> str:
        """accepted, partial (some directions are not known) or refused."""
        return "refused" if not self.accepted else "partial" if self.unknown else "accepted"

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        mm, deg = self.step
        return {
            "verdict": self.verdict, "reason": self.reason, "by": self.by, "frame": self.frame, "step_mm": mm, "step_deg": deg,
            "target": {"xyz": self.T_frame_hand[:3, 3].tolist(), "xyzw": se3.quat_from_matrix(self.T_frame_hand[:3, :3]).tolist()},
            "delta": se3.log(self.delta).tolist(), "covariance": self.cov.ravel().tolist(), "not_known": list(self.unknown), **self.facts,
        }  # fmt: skip


@dataclass(frozen=True, slots=True)
class Moment:
    """What a proposal depends on beside the view: the view's age in seconds when it was asked for, and the robot's pose now (None: not asked)."""

    age_s: float = 0.0
    robot: RobotPose | None = None


def propose(
    found: Registration,
    robot: RobotPose,
    config: CorrectConfig,
    *,
    T_hand_camera: Float | None = None,
    T_frame_body: Float | None = None,
    frame: str = "body",
    earlier: Registration | None = None,
    moment: Moment | None = None,
) -> Correction:
    """Turn `T_reference_now` into a target of the hand.

    The camera must move by the inverse of `T_reference_now` in its own axes: `T_body_camera inv(T_reference_now)`. A hand-eye
    error of TF enters only through its commutator with that motion, so that it vanishes as the loop converges.

    Args:
        found: the registration.
        robot: the robot's own pose at the view's stamp.
        config: limits.
        T_hand_camera: (4, 4) hand-eye by TF (default: the camera is the hand).
        T_frame_body: (4, 4) body in the frame that the target is wanted in (default: the body itself).
        frame: the name of that frame.
        earlier: another dwell's registration of the same pose, which must agree.
        moment: age of the view and present pose of the robot.
    """
    hand = np.eye(4) if T_hand_camera is None else T_hand_camera
    base = np.eye(4) if T_frame_body is None else T_frame_body
    T_hand = base @ robot.T_body_camera @ se3.inverse(hand)
    delta = hand @ se3.inverse(found.T_reference_now) @ se3.inverse(hand)
    target = T_hand @ delta
    # inv(T exp(xi)) = exp(-xi) inv(T): a left factor at the camera, carried to the hand.
    carry = se3.adjoint(hand @ found.T_reference_now)
    cov = se3.cov_fixed_axes(target, carry @ found.cov @ carry.T)
    reason = _refusal(found, robot, se3.inverse(base) @ target, delta, config.limits, earlier, moment or Moment())
    facts = {"support": found.support, "overlap": found.overlap, "rms_mm": 1e3 * found.rms, "pixels": float(found.pixels)}
    if reason:
        return Correction(
            T_hand, np.eye(4), cov, accepted=False, reason=reason, unknown=found.unknown.names, frame=frame, by=found.by, facts=facts
        )
    reason = "ok" if not found.unknown.names else "no motion along undetermined directions: " + "; ".join(found.unknown.names)
    return Correction(target, delta, cov, accepted=True, reason=reason, unknown=found.unknown.names, frame=frame, by=found.by, facts=facts)


def _refusal(
    found: Registration,
    robot: RobotPose,
    T_body_hand: Float,
    delta: Float,
    limits: LimitConfig,
    earlier: Registration | None,
    moment: Moment,
) -> str:
    """The first reason not to move, or "". Comparisons are written so that NaN exceeds every bound."""
    metres, degrees = se3.distance(np.eye(4), delta)
    if not found.accepted:
        return found.reason
    if not -1.0 <= moment.age_s <= limits.stale_s:
        return f"stale: the view is {moment.age_s:.1f} s old (at most {limits.stale_s:g} s)"
    if moment.robot is not None and (moved := _moved(robot, moment.robot, limits)):
        return moved
    if earlier is not None and (apart := _disagreement(found, earlier, limits)):
        return apart
    if not (1e3 * metres <= limits.step_mm and degrees <= limits.step_deg):
        return f"step limit: the hand would move by {1e3 * metres:.0f} mm and {degrees:.1f} deg (at most {limits.step_mm:g} mm and {limits.step_deg:g} deg)"
    reach = float(np.linalg.norm(T_body_hand[:3, 3]))
    if not (reach <= limits.reach_m and T_body_hand[2, 3] >= limits.low_m):
        return f"workspace limit: the hand would be {reach:.2f} m from the body, {T_body_hand[2, 3]:.2f} m high"
    return ""


def _moved(then: RobotPose, now: RobotPose, limits: LimitConfig) -> str:
    metres, degrees = se3.distance(then.T_cell_camera, now.T_cell_camera)
    if 1e3 * metres <= limits.moved_mm and degrees <= limits.moved_deg:
        return ""
    return f"moved meanwhile: by {1e3 * metres:.1f} mm and {degrees:.2f} deg since the view"


def _disagreement(one: Registration, two: Registration, limits: LimitConfig) -> str:
    """Why two dwells of one pose disagree: beyond their sigmas and beyond the limits; empty if they agree."""
    if not two.accepted:
        return f"two dwells disagree: the other one was refused ({two.reason})"
    xi = se3.log(se3.inverse(one.T_reference_now) @ two.T_reference_now)
    mm, deg = 1e3 * float(np.linalg.norm(xi[:3])), float(np.degrees(np.linalg.norm(xi[3:])))
    sigmas = float(np.sqrt(xi @ np.linalg.solve(one.cov + two.cov + SMALLEST_COV, xi) / 6.0))
    if sigmas <= limits.disagree_sigma or (mm <= limits.disagree_mm and deg <= limits.disagree_deg):
        return ""
    return f"two dwells disagree by {mm:.1f} mm and {deg:.2f} deg, {sigmas:.0f} of their sigmas"
