# SPDX-License-Identifier: Apache-2.0
"""Messages of one camera to captures: joined by stamp, posed by TF; the same offline and live.

Header stamps alone decide which messages are joined, so the order in which topics arrive does not
change the result.
"""

from __future__ import annotations

from bisect import bisect_right, insort
from collections import Counter, deque
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from tof_core.camera import radial_to_z
from tof_core.cameras import Cameras
from tof_core.capture import Capture, Colour
from tof_core.decode import (
    check_size,
    decode_amplitude,
    decode_colour,
    decode_depth,
    depth_from_points,
    image_size,
    stamp_ns,
)
from tof_core.errors import CameraError, DecodeError, TransformError
from tof_core.joined import Joined
from tof_core.reasons import Reason
from tof_core.topics import is_rectified

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from tof_core.arrays import Bytes, Image
    from tof_core.camera import Camera
    from tof_core.capture import RobotPose
    from tof_core.options import BagOptions
    from tof_core.robot import RobotChain
    from tof_core.topics import Topics

NO_INFO, FROZEN, LATE, NO_TRANSFORM = "no camera_info", "frozen", "late", "no transform"
"""Why frames are skipped: the keys of `CaptureBuilder.skipped`."""

ANY_SIZE = (0, 0)
"""Size of a frame that need not wait for a CameraInfo of its size: a cloud, or an unreadable image."""


@dataclass(frozen=True, slots=True, eq=False)
class _Frame:
    """A depth message, waiting."""

    stamp: int
    msg: Any
    cloud: bool
    size: tuple[int, int]


def _size_of(msg: Any) -> tuple[int, int]:
    """Height and width; `ANY_SIZE` for an image with unreadable headers: its decoding raises the error."""
    try:
        return image_size(msg)
    except DecodeError:
        return ANY_SIZE


class CaptureBuilder:
    """Takes the messages of one camera, gives captures in the order of their stamps.

    Args:
        options: units and tolerances; the names of optional topics only decide which messages are joined.
        chain: frames and transforms; None yields captures without a robot pose.
        topics: which topics there are: amplitude and colour are waited for only where named.
        need_tf: skip (and count) frames without a transform, instead of giving them with `robot=None`.
                wait_s: a frame stops waiting once the newest depth stamp is this much later; where it is infinite, a frame stops waiting
                    once `overdue` reaches its stamp.
        repeats: keep frames whose content equals that of the frame before, as a simulated camera at rest gives them.
        ahead_s: TF must reach this far beyond a frame before it is given out, so that the motion
            gate (`motion.is_still`) sees the same live as offline.

    Live, the last frame before a silence waits for ever: call `ready(final=True)` after a while.
    """

    def __init__(
        self,
        options: BagOptions,
        chain: RobotChain | None,
        topics: Topics,
        *,
        need_tf: bool = True,
        repeats: bool = False,
        wait_s: float = 0.5,
        ahead_s: float = 0.04,
    ) -> None:
        """Nothing received yet."""
        self.options, self.chain, self.topics, self.need_tf, self._repeats = options, chain, topics, need_tf, repeats
        self.skipped: Counter[str] = Counter()
        self.on_skip: Callable[[int, str], None] = lambda _stamp, _reason: None
        self.last_error = ""
        self.camera: Camera | None = None
        self._wait_ns, self._ahead_ns = wait_s * 1e9, round(ahead_s * 1e9)
        self._join_ns, self._colour_join_ns = round(options.join_s * 1e9), round(options.colour_join_s * 1e9)
        self._cameras = Cameras()
        self.reset()

    def reset(self) -> None:
        """Drop waiting messages (the clock was set back); the camera is kept."""
        self._frames: deque[_Frame] = deque()
        self._amplitude, self._colour = Joined([], []), Joined([], [])
        self._temperatures: list[tuple[int, float]] = []
        self._colour_camera: Camera | None = None
        self.last_stamp, self._newest, self.overdue = -(2**62), -(2**62), -(2**62)
        self._last_content: Bytes | None = None
        self._unsettled: tuple[str, int, int] | None = None  # frame, stamp and state of TF that had no answer

    def info(self, msg: Any) -> None:
        """A CameraInfo of the depth camera; the newest one holds."""
        self.camera = self._cameras.of(msg, self.topics.info or "camera_info", rectified=is_rectified(self.topics.depth))

    def colour_info(self, msg: Any) -> None:
        """A CameraInfo of the colour camera; with an uncalibrated one, colour has no camera."""
        try:
            self._colour_camera = self._cameras.of(msg, self.topics.colour_info, rectified=is_rectified(self.topics.colour))
        except CameraError as error:
            self._colour_camera, self.last_error = None, str(error)

    def depth(self, msg: Any) -> None:
        """A depth image."""
        self._push(msg, cloud=False)

    def points(self, msg: Any) -> None:
        """A point cloud to take the depth from."""
        self._push(msg, cloud=True)

    def amplitude(self, msg: Any) -> None:
        """An amplitude image."""
        self._amplitude.put(msg)

    def colour(self, msg: Any) -> None:
        """A colour image."""
        self._colour.put(msg)

    def temperature(self, msg: Any) -> None:
        """A temperature; joins the frames from its stamp on."""
        insort(self._temperatures, (stamp_ns(msg), float(msg.temperature)))
        del self._temperatures[:-256]

    def ready(self, *, final: bool = False) -> Iterator[Capture]:
        """Captures that no later message can change, oldest first; `final` gives out all that are waiting."""
        while self._frames and (final or self._complete(self._frames[0])):
            frame = self._frames.popleft()
            if (capture := self._capture(frame)) is not None:
                yield capture
            self._amplitude.forget_before(frame.stamp - self._join_ns)
            self._colour.forget_before(frame.stamp - self._colour_join_ns)

    @property
    def waiting(self) -> set[int]:
        """Stamps of the frames that wait for something."""
        return {frame.stamp for frame in self._frames}

    def _skip(self, stamp: int, reason: str) -> None:
        self.skipped[reason] += 1
        self.on_skip(stamp, reason)

    def _push(self, msg: Any, *, cloud: bool) -> None:
        stamp = stamp_ns(msg)
        content = np.frombuffer(msg.data, np.uint8) if not isinstance(msg.data, list) else np.asarray(msg.data, np.uint8)
        same = not self._repeats and self._last_content is not None and np.array_equal(content, self._last_content)
        if stamp == self.last_stamp or stamp in self.waiting or same:
            self._skip(stamp, FROZEN)
            return
        if stamp < self.last_stamp:
            self._skip(stamp, LATE)
            return
        self._last_content = content
        self._newest = max(self._newest, stamp)
        self._frames.append(_Frame(stamp, msg, cloud, ANY_SIZE if cloud else _size_of(msg)))
        if len(self._frames) > 1 and self._frames[-2].stamp > stamp:
            self._frames = deque(sorted(self._frames, key=lambda f: f.stamp))

    def _complete(self, frame: _Frame) -> bool:
        if self._newest > frame.stamp + self._wait_ns or frame.stamp <= self.overdue:
            return True
        return (
            self.camera is not None
            and frame.size in (ANY_SIZE, self.camera.shape)  # else it overtook its camera_info
            and (not self.topics.amplitude or self._amplitude.settled(frame.stamp))
            and (not self.topics.colour or self._colour.settled(frame.stamp))
            and self._tf_settled(frame)
        )

    def _tf_settled(self, frame: _Frame) -> bool:
        """Whether TF has the pose at the stamp and a little after it, or never will."""
        if self.chain is None:
            return True
        camera, after = self._frame_id(frame), frame.stamp + self._ahead_ns
        if self._unsettled == (asked := (camera, after, self.chain.transforms.changes)):
            return False
        try:
            self.chain.check(camera, after)  # first: mostly it is what has not come yet
            self.chain.check(camera, frame.stamp)
        except TransformError:
            settled = self.chain.settled(camera, after)
            self._unsettled = None if settled else asked
            return settled
        return True

    def _frame_id(self, frame: _Frame) -> str:
        """The camera's frame: a cloud may be in another one."""
        return self.camera.frame_id if frame.cloud and self.camera else str(frame.msg.header.frame_id).lstrip("/")

    def _capture(self, frame: _Frame) -> Capture | None:
        self.last_stamp = frame.stamp
        if self.camera is None:
            self._skip(frame.stamp, NO_INFO)
            return None
        frame_id = self._frame_id(frame)
        robot = self._robot(frame_id, frame.stamp)
        if robot is None and self.need_tf:
            self._skip(frame.stamp, NO_TRANSFORM)
            return None
        camera = self.camera if self.camera.frame_id == frame_id else replace(self.camera, frame_id=frame_id)
        try:
            depth, reason = self._depth_of(frame, camera)
        except TransformError as error:
            self.last_error = str(error)
            self._skip(frame.stamp, NO_TRANSFORM)
            return None
        amplitude = self._amplitude.nearest(frame.stamp, self._join_ns)
        return Capture(
            stamp_ns=frame.stamp,
            camera=camera,
            depth=depth,
            reason=reason,
            robot=robot,
            temperature=self._temperature(frame.stamp),
            amplitude=None if amplitude is None else self._amplitude_of(amplitude, camera),
            colour=self._colour_of(frame_id, frame.stamp),
        )

    def _depth_of(self, frame: _Frame, camera: Camera) -> tuple[Image, Bytes]:
        if frame.cloud:
            cloud_frame = frame.msg.header.frame_id.lstrip("/")
            if cloud_frame == camera.frame_id:
                return depth_from_points(frame.msg, camera, None, self.topics.points)
            if self.chain is None:
                raise TransformError(f"the cloud is in '{cloud_frame}', the camera in '{camera.frame_id}'", where=self.topics.points)
            T = self.chain.transforms.lookup(camera.frame_id, cloud_frame, frame.stamp)
            return depth_from_points(frame.msg, camera, T, self.topics.points)
        depth, reason = decode_depth(frame.msg, self.topics.depth, scale=self.options.depth_scale)
        check_size(depth.shape, camera, self.topics.depth)
        if self.options.depth == "radial":
            depth = radial_to_z(camera, depth)
        if camera.distorted and (outside := np.isnan(camera.ray_length())).any():
            depth[outside] = np.nan
            reason[outside & (reason == Reason.VALID)] = Reason.OUT_OF_RANGE
        return depth, reason

    def _amplitude_of(self, msg: Any, camera: Camera) -> Image:
        amplitude = decode_amplitude(msg, self.topics.amplitude)
        check_size(amplitude.shape, camera, self.topics.amplitude)
        return amplitude

    def _colour_of(self, frame_id: str, stamp: int) -> Colour | None:
        msg = self._colour.nearest(stamp, self._colour_join_ns)
        if msg is None:
            return None
        image, T = decode_colour(msg, self.topics.colour), None
        camera = self._colour_camera
        if camera is not None:
            check_size(image.shape, camera, self.topics.colour)
        if self.chain is not None:
            try:
                T = self.chain.transforms.lookup(frame_id, msg.header.frame_id, stamp)
            except TransformError as error:
                self.last_error = str(error)
        return Colour(image, camera, T, stamp_ns(msg))

    def _temperature(self, stamp: int) -> float:
        """The nearest earlier temperature, NaN where there is none."""
        i = bisect_right(self._temperatures, (stamp, float("inf")))
        return self._temperatures[i - 1][1] if i else float("nan")

    def _robot(self, frame_id: str, stamp: int) -> RobotPose | None:
        if self.chain is None:
            return None
        try:
            return self.chain.pose(frame_id, stamp)
        except TransformError as error:
            self.last_error = str(error)
            return None
