# SPDX-License-Identifier: Apache-2.0
"""The node `sensor`: subscribes to a simulator's ideal depth, publishes the depth that the modelled camera would measure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from sensor_msgs.msg import CameraInfo, Image

from tof_core.builder import CaptureBuilder
from tof_core.robot import RobotChain
from tof_core.tf import TransformBuffer
from tof_ros import messages, qos
from tof_ros.captures import CaptureFeed
from tof_ros.depth_output import DepthOutput
from tof_ros.managed import ManagedNode
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
        """Make the outputs; the sensor model is loaded by `load`."""
        super().__init__(NAME, NAME, SensorNodeConfig, fixed=("input.", "sensor.", "live."), **options)
        self._refusal, self._lens_note = "", list[str]()
        self._outputs = {name: self.output(name, kind) for name, kind in OUTPUTS.items()}
        self._depth = DepthOutput(self, "depth", self._outputs["depth"], lambda: self.config.live.depth_code)
        self.service("flush", self.flush)

    def load(self) -> None:
        """Read the sensor model, and the scene where one is named."""
        scene = self.config.live.scene
        self._camera = Simulator.load(self.config.sensor, Raycaster(open_scene(scene)) if scene else None)

    def unload(self) -> None:
        """Release both."""
        del self._camera

    def start(self) -> None:
        """Subscribe; topics are relative and remappable."""
        live, options = self.config.live, self.config.input
        topics, chain = input_topics(options), self._chain()
        builder = CaptureBuilder(options, chain, topics, need_tf=chain is not None, repeats=True, ahead_s=0.0)
        self._normals = Normals(options.join_s)
        self._camera.reset()
        self._feed = CaptureFeed(
            self, builder, topics, self._simulate, self._refuse, self._has_normals, patience_s=live.patience_s, reliable=live.reliable
        )
        if chain is not None:
            listener = TransformListener(self, chain.transforms, self._feed.advance, lambda: self._feed.oldest)
            self.at_stop.append(listener.close)
        if live.normals_topic:
            self.input(live.normals_topic, Image, self._normal, qos.sensor(reliable=live.reliable, depth=32))

    def _chain(self) -> RobotChain | None:
        """The chain of TF, if a scene is rendered at the camera's pose; otherwise None."""
        caster, live, options = self._camera.caster, self.config.live, self.config.input
        if caster is None:
            return None
        transforms = TransformBuffer(options.max_gap_s, keep_s=live.keep_tf_s)
        return RobotChain(transforms, options.cell_frame or caster.scene.frame, options.body_frame)

    def _refuse(self, why: str) -> None:
        self._refusal = why

    def _normal(self, message: Image) -> None:
        self._normals.put(message)
        self._feed.advance()

    def _has_normals(self, stamp: int) -> bool:
        return not self.config.live.normals_topic or self._normals.settled(stamp)

    def _simulate(self, ideal: Capture) -> None:
        measured = self._camera.measured(ideal, self._normals.at(ideal))
        self._refusal, self._lens_note, amplitude = "", self._camera.lens_note(ideal), measured.amplitude
        assert amplitude is not None
        head = messages.header(ideal.stamp_ns, ideal.camera.frame_id)
        self._depth.offer(measured.depth, head)
        self.offer(self._outputs["amplitude"], lambda: messages.image(amplitude, "32FC1", head))
        self._outputs["camera_info"].publish(messages.camera_info(ideal.camera, head))

    def reset(self) -> str:
        """Discard the frames that wait; the next frame is the first of a session."""
        self._feed.reset()
        self._normals.clear()
        self._camera.reset()
        return "waiting frames are discarded"

    def flush(self) -> str:
        """Simulate all waiting frames, as at the end of a bag."""
        return self._feed.flush()

    def figures(self) -> Mapping[str, str]:
        """The effects that are simulated, and the scene."""
        return {"effects": " ".join(self._camera.model.names), "scene": self.config.live.scene}

    def warnings(self) -> list[str]:
        """Refused frames, another lens, and effects that need a scene."""
        out = [self._refusal] if self._refusal else self._lens_note.copy()
        if lacking := self._camera.without_effect:
            out.append(f"without a scene these do nothing: {', '.join(lacking)} (live.scene)")
        return out


def make_node(**options: Any) -> SensorNode:
    """The node; keyword arguments as of `rclpy.node.Node`."""
    return SensorNode(**options)
