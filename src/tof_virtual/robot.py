# SPDX-License-Identifier: Apache-2.0
"""The robot's body and arm: the camera pose in its own estimate (TF), and the true camera pose.

`T_cell_camera = B_station . T_cell_body . T_body_camera . A_view . X`
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_core import se3

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_virtual.config import RobotConfig

HAND_OF_CAMERA = np.array([[0.0, 0, 1, 0.06], [-1, 0, 0, 0.0], [0, -1, 0, 0.04], [0, 0, 0, 1]])
"""T_hand_camera: hand x forward, optical z forward; 60 mm ahead of and 40 mm above the hand."""
HAND_OF_COLOUR = np.array([[0.0, 0, 1, 0.06], [-1, 0, 0, 0.025], [0, -1, 0, 0.04], [0, 0, 0, 1]])
"""T_hand_colour: 25 mm to the left of the depth camera."""
WRIST_OF_HAND = np.array([[1.0, 0, 0, 0.12], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
SHOULDER = np.array([0.29, 0.0, 0.19])
REPEAT_LENGTH_M = 0.25
"""Over which hand travel the repeatable part of the arm's error changes."""


class Robot:
    """A base that stops beside its mark and an arm with a repeatable and a random error.

    Attributes:
        T_cell_body: the base's own estimate of its pose.
        T_body_hand: the arm's own estimate of the hand's pose.
        B: (4, 4) the base's error, of this station; A: the arm's, of this pose; X: hand-eye, of this robot.
    """

    def __init__(self, config: RobotConfig, rng: np.random.Generator, X: Float | None = None) -> None:
        """Draw the arm's own, repeatable error field; the base starts at the cell's origin without error."""
        self._config, self._rng = config, rng
        self.X: Float = np.eye(4) if X is None else X
        self.T_cell_body: Float = np.eye(4)
        self.T_body_hand: Float = np.eye(4)
        self.B: Float = np.eye(4)
        self.A: Float = np.eye(4)
        self._waves = rng.normal(0, 1 / REPEAT_LENGTH_M, (4, 6))
        self._phase = rng.uniform(0, 2 * np.pi, (4, 6))
        self._axis = np.linalg.qr(rng.normal(0, 1, (6, 6)))[0] / np.sqrt(4 / 2)  # four waves of mean square 1/2

    def drive(self, T_cell_body: Float) -> None:
        """Stop at a new station: the error of the base is drawn anew, in the axes of the body."""
        c, rng = self._config, self._rng
        off = rng.uniform(c.base_min_mm, max(c.base_max_mm, c.base_min_mm)) / 1e3
        where = rng.uniform(0, 2 * np.pi)
        turn = np.radians([rng.normal(0, c.base_tilt_deg), rng.normal(0, c.base_tilt_deg), rng.uniform(-c.base_deg, c.base_deg)])
        twist = [off * np.cos(where), off * np.sin(where), rng.normal(0, c.base_height_mm / 1e3), *turn]
        self.T_cell_body = T_cell_body
        self.B = T_cell_body @ se3.exp(twist) @ se3.inverse(T_cell_body)

    def goto(self, T_body_hand: Float) -> None:
        """Move the hand; A is the error at that pose, part of it the same whenever the pose is the same."""
        c = self._config
        self.T_body_hand = T_body_hand
        random = self._rng.normal(0, 1, 6) * _per_axis(c.repeat_mm, c.repeat_deg)
        steady = self._repeatable(T_body_hand) * _per_axis(
            np.sqrt(max(c.arm_mm**2 - c.repeat_mm**2, 0)), np.sqrt(max(c.arm_deg**2 - c.repeat_deg**2, 0))
        )
        self.A = se3.exp(steady + random)

    def _repeatable(self, T_body_hand: Float) -> Float:
        """Smooth unit-variance field (6,) over hand positions and directions."""
        coordinates = np.concatenate([T_body_hand[:3, 3], 0.3 * T_body_hand[:3, 0]])[:, None]
        return np.asarray((np.sin(self._waves @ coordinates + self._phase) @ self._axis.T).sum(axis=0))

    @property
    def T_cell_camera(self) -> Float:
        """Pose of the camera in the robot's own estimate."""
        return np.asarray(self.T_cell_body @ self.T_body_hand @ HAND_OF_CAMERA)

    @property
    def T_cell_camera_true(self) -> Float:
        """True pose of the camera."""
        return np.asarray(self.B @ self.T_cell_camera @ self.A @ self.X)


def _per_axis(mm: float, deg: float) -> Float:
    """Standard deviation (6,) of a twist whose parts have these RMS lengths."""
    return np.asarray(np.repeat([mm / 1e3, np.radians(deg)], 3) / np.sqrt(3))


def arm_links(T_body_hand: Float) -> tuple[Float, Float]:
    """`T_body_shoulder` and `T_shoulder_wrist`: a shoulder that turns toward the wrist, and the rest."""
    T_body_wrist = T_body_hand @ se3.inverse(WRIST_OF_HAND)
    reach = T_body_wrist[:3, 3] - SHOULDER
    yaw, pitch = np.arctan2(reach[1], reach[0]), -np.arctan2(reach[2], np.hypot(reach[0], reach[1]))
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = se3.so3_exp([0, 0, yaw]) @ se3.so3_exp([0, pitch, 0]), SHOULDER
    return T, np.asarray(se3.inverse(T) @ T_body_wrist)
