# SPDX-License-Identifier: Apache-2.0
"""The virtual robot for closed loops: it moves to commanded poses with its own error, and takes captures."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np

from tof_core import se3
from tof_core.capture import Capture, Colour, RobotPose
from tof_core.decode import decode_amplitude, decode_depth
from tof_core.encode import image_fields
from tof_virtual.calibrate import calibrate, resize
from tof_virtual.colour import colour_camera, photograph
from tof_virtual.config import VirtualConfig
from tof_virtual.effect import Moment
from tof_virtual.pipeline import expose
from tof_virtual.record import encode_amplitude, encode_depth
from tof_virtual.robot import HAND_OF_CAMERA, HAND_OF_COLOUR, Robot
from tof_virtual.session import Session
from tof_virtual.sight import Sight, look

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from tof_core.arrays import Float
    from tof_virtual.body import Body

MOVE_S = 2.0


class VirtualRobot:
    """A robot at the first stop of its plan.

    `drive` and `goto` take poses in the robot's own estimate; the true pose is `T_cell_camera_true`, which no code under test
    may read. Effects that need motion (`motion`, `time_sync`) are not visible, since it captures at rest.
    """

    def __init__(
        self,
        bodies: Sequence[Body],
        config: VirtualConfig | None = None,
        effects: Mapping[str, float] | None = None,
        *,
        standing: Sequence[Body] | None = None,
        sizes: Mapping[str, float] | None = None,
    ) -> None:
        """Plan as `record` does, so that effects have the same sizes; `standing`: the bodies as they are, `sizes`: of the effects, by name."""
        self._session = Session(bodies, config or VirtualConfig(), effects or {}, standing)
        if sizes is None:
            calibrate(self._session)
        else:
            resize(self._session, sizes)
        self.config = self._session.config
        self.camera = self._session.camera
        self._robot = Robot(self.config.robot, np.random.default_rng([self.config.seed, 2, self.config.day]), self._session.hand_eye())
        self._photons = np.random.default_rng([self.config.seed, 78, self.config.day])
        self._time_s, self._index, self._station = 0.0, 0, -1
        self._sight: Sight | None = None
        self.drive(self._session.stops[0].T_cell_body)
        self.goto(self._session.stops[0].T_body_hand)

    @property
    def views(self) -> list[tuple[Float, Float]]:
        """Stops of the plan: `T_cell_body`, `T_body_hand`."""
        return [(s.T_cell_body, s.T_body_hand) for s in self._session.stops]

    @property
    def T_cell_body(self) -> Float:
        """Pose of the body in the robot's own estimate."""
        return self._robot.T_cell_body

    @property
    def T_body_hand(self) -> Float:
        """Pose of the hand in the robot's own estimate."""
        return self._robot.T_body_hand

    @property
    def T_cell_camera(self) -> Float:
        """Pose of the camera in the robot's own estimate."""
        return self._robot.T_cell_camera

    @property
    def T_cell_camera_true(self) -> Float:
        """True pose of the camera. For tests and evaluation alone."""
        return self._robot.T_cell_camera_true

    def drive(self, T_cell_body: Float) -> None:
        """Drive the base to a mark; it stops with a new error."""
        self._robot.drive(T_cell_body)
        self._moved()
        self._station += 1

    def goto(self, T_body_hand: Float) -> None:
        """Move the hand to a pose in the body."""
        self._robot.goto(T_body_hand)
        self._moved()

    def capture(self, *, colour: bool = False) -> Capture:
        """Take one capture at rest, as it would come out of a bag."""
        taken = expose(self._moment(), self._session.effects, self._photons)
        encoding = self.config.output.encoding
        depth, reason = decode_depth(_message(encode_depth(taken.depth, taken.saturated, self.camera.shape, encoding), encoding))
        amplitude = decode_amplitude(_message(encode_amplitude(taken.amplitude, self.camera.shape), "mono16"))
        stamp = self.config.output.start_s * 1_000_000_000 + round(self._time_s * 1e9)
        capture = Capture(
            stamp_ns=stamp,
            camera=self.camera,
            depth=depth,
            reason=reason,
            amplitude=amplitude,
            robot=RobotPose(self.T_cell_body.copy(), np.asarray(self.T_body_hand @ HAND_OF_CAMERA)),
            colour=self._colour(stamp) if colour else None,
            temperature=round(self._session.temperature(self._time_s), 2),
        )
        self._time_s += 1 / self.config.plan.rate_hz
        self._index += 1
        return capture

    def _moment(self) -> Moment:
        s = self._session
        return Moment(
            index=self._index,
            view=self._index,
            time_s=self._time_s,
            temperature=s.temperature(self._time_s),
            world=s.world(s.effects),
            config=self.config,
            camera=self.camera,
            sights=(self._seen(),),
        )

    def _colour(self, stamp_ns: int) -> Colour:
        image = photograph(self._session, self.T_cell_camera_true, self._station, self._index)
        return Colour(image, colour_camera(self.config), np.asarray(se3.inverse(HAND_OF_CAMERA) @ HAND_OF_COLOUR), stamp_ns)

    def _moved(self) -> None:
        self._time_s += MOVE_S
        self._sight = None

    def _seen(self) -> Sight:
        if self._sight is None:
            s, effects = self._session, self._session.effects
            camera = self.camera
            for e in effects:
                camera = e.true_camera(camera)
            width = max((e.footprint() for e in effects), default=0.0) or 1.0
            self._sight = look(
                s.world(effects), camera.rays(), self.T_cell_camera_true, subsamples=self.config.camera.subsamples, width=width
            )
        return self._sight


def _message(array: NDArray[np.generic], encoding: str) -> SimpleNamespace:
    """An image message as a subscriber sees it."""
    return SimpleNamespace(**image_fields(array, encoding))
