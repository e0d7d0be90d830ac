# SPDX-License-Identifier: Apache-2.0
"""The node `sensor`: subscribes to a simulator's ideal depth, publishes what the modelled camera measures."""

from __future__ import annotations

import time
from collections import deque
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from sensor_msgs.msg import CameraInfo, Image, Temperature

from tof_core.builder import LATE, CaptureBuilder
from tof_core.decode import stamp_ns
from tof_core.errors import RefusedError, ToftwinError
from tof_core.jump import BackwardJump
from tof_core.robot import RobotChain
from tof_core.tf import TransformBuffer
from tof_ros import messages, qos
from tof_ros.base import LEFT_OVER
from tof_ros.managed import ManagedNode
from tof_ros.patience import NEVER, PERIOD_S, Patience
from tof_ros.transforms import TransformListener
from tof_scene.builtin import open_scene
from tof_scene.raycast import Raycaster
from tof_sensor.live import SensorNodeConfig, input_topics
from tof_sensor.normals import Normals
from tof_sensor.simulator import Simulator

if TYPE_CHECKING:
    from collections.abc import Mapping

    from tof_core.capture import Capture

NAME = "sensor"
OUTPUTS = {"depth": Image, "amplitude": Image, "camera_info": CameraInfo}
"""Topics under `sensor/`, once per frame, with its stamp."""
CONFIG = SensorNodeConfig


class SensorNode(ManagedNode[SensorNodeConfig]):
    """Simulates the camera of a sensor.yaml on ideal frames (docs/nodes/sensor.md)."""

    def __init__(self, **options: Any) -> None:
        """Nothing loaded yet."""
        super().__init__(NAME, NAME, SensorNodeConfig, fixed=("input.", "sensor.", "live."), **options)
        self._refusal = ""
        self._outputs = {name: self.output(name, kind) for name, kind in OUTPUTS.items()}
        self.service("flush", self.flush)

    def load(self) -> None:
        """Read the sensor model, and the scene where one is named."""
        scene = self.config.live.scene
        self._camera = Simulator.load(self.config.sensor, Raycaster(open_scene(scene)) if scene else None)

    def unload(self) -> None:
        """Let go of both."""
        del self._camera

    def start(self) -> None:
        """Subscribe; topics are relative and remappable."""
        live, options = self.config.live, self.config.input
        self._topics, self._waiting = input_topics(options), deque[Any]()
        self._arrivals: dict[int, float] = {}
        self._patience, self._jump, self._overdue = Patience(live.patience_s), BackwardJump(), NEVER
        chain = self._chain()
        self._builder = CaptureBuilder(
            options, chain, replace(self._topics, amplitude=""), need_tf=chain is not None, repeats=True, ahead_s=0.0
        )
        self._builder.on_skip = lambda stamp, reason: self._skipped(stamp, reason, self._builder.last_error)
        self._normals = Normals(options.join_s)
        self._camera.reset()
        sensor = qos.sensor(reliable=live.reliable, depth=32)
        self.input(self._topics.depth, messages.image_class(self._topics.depth), self._frame, sensor, frames="input.depth_topic")
        self.input(self._topics.info, CameraInfo, self._info, sensor)
        if self._topics.amplitude:
            self.input(self._topics.amplitude, messages.image_class(self._topics.amplitude), self._amplitude, sensor)
        if self._topics.temperature:
            self.input(self._topics.temperature, Temperature, self._builder.temperature, sensor)
        if live.normals_topic:
            self.input(live.normals_topic, Image, self._normal, sensor)
        self.timer(PERIOD_S, self._tick)

    def _chain(self) -> RobotChain | None:
        """TF, where a scene is rendered from the camera's pose."""
        caster, live, options = self._camera.caster, self.config.live, self.config.input
        if caster is None:
            return None
        chain = RobotChain(
            TransformBuffer(options.max_gap_s, keep_s=live.keep_tf_s), options.cell_frame or caster.scene.frame, options.body_frame
        )
        listener = TransformListener(self, chain.transforms, self._advance, lambda: self._patience.oldest)
        self.at_stop.append(listener.close)
        return chain

    def _frame(self, message: Any) -> None:
        arrived = self.tally.arrived()
        if self.left_over(stamp_ns(message)):
            self.skip(stamp_ns(message), LEFT_OVER)
            return
        self._arrivals[stamp_ns(message)] = arrived
        self._patience.start(stamp_ns(message))
        self._builder.depth(message)
        if self._jump:
            self.jumped()
        self._advance()

    def _info(self, message: CameraInfo) -> None:
        self._builder.info(message)
        self._advance()

    def _amplitude(self, message: Any) -> None:
        # Seen for the first time: from now on it is waited for.
        self._builder.topics = self._topics
        self._builder.amplitude(message)
        self._advance()

    def _normal(self, message: Image) -> None:
        self._normals.put(message)
        self._advance()

    def _tick(self) -> None:
        self._overdue = max(self._overdue, self._patience.tick())
        self._builder.overdue = max(self._builder.overdue, self._overdue)
        self._advance()

    def _advance(self, *, final: bool = False) -> None:
        self._waiting.extend(self._builder.ready(final=final))
        while self._waiting and (final or self._has_normals(self._waiting[0].stamp_ns)):
            capture = self._waiting.popleft()
            try:
                self._simulate(capture)
            except RefusedError as error:
                self._refusal = str(error)
                self._skipped(capture.stamp_ns, "refused", str(error))
            except ToftwinError as error:
                self._skipped(capture.stamp_ns, "bad frame", str(error))

    def _has_normals(self, stamp: int) -> bool:
        return not self.config.live.normals_topic or self._normals.settled(stamp) or stamp <= self._overdue

    def _simulate(self, ideal: Capture) -> None:
        measured = self._camera.measured(ideal, self._normals.at(ideal))
        self._refusal, amplitude = "", measured.amplitude
        assert amplitude is not None
        head = messages.header(ideal.stamp_ns, ideal.camera.frame_id)
        self.offer(self._outputs["depth"], lambda: messages.image(measured.depth, "32FC1", head))
        self.offer(self._outputs["amplitude"], lambda: messages.image(amplitude, "32FC1", head))
        self._outputs["camera_info"].publish(messages.camera_info(ideal.camera, head))
        self._patience.end(ideal.stamp_ns)
        self._jump.clear()
        self.done(ideal.stamp_ns, self._arrivals.pop(ideal.stamp_ns, time.monotonic()))

    def _skipped(self, stamp: int, reason: str, why: str) -> None:
        self._patience.end(stamp)
        self._arrivals.pop(stamp, None)
        self.skip(stamp, reason, why)
        if reason == LATE:
            self._jump.late(stamp, self._builder.last_stamp)

    def reset(self) -> str:
        """Discard the frames that are waiting; the next one is the first of a session."""
        self._builder.reset()
        self._waiting.clear()
        self._normals.clear()
        self._camera.reset()
        self.forget_frames(self._arrivals)
        self._patience.clear()
        self._jump.clear()
        return "what waited is forgotten"

    def flush(self) -> str:
        """Give out every frame that waits, as at the end of a bag."""
        waiting = self._builder.waiting + len(self._waiting)
        self._advance(final=True)
        return f"{waiting} frames waited"

    def figures(self) -> Mapping[str, str]:
        """The effects that are simulated, and the scene."""
        return {"effects": " ".join(self._camera.model.names), "scene": self.config.live.scene}

    def warnings(self) -> list[str]:
        """A camera whose unit of amplitude is unknown; effects that need a scene."""
        out = [self._refusal] if self._refusal else []
        if lacking := self._camera.without_effect:
            out.append(f"without a scene these do nothing: {', '.join(lacking)} (live.scene)")
        return out


def make_node(**options: Any) -> SensorNode:
    """The node; keyword arguments as of `rclpy.node.Node`."""
    return SensorNode(**options)
