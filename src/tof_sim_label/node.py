# SPDX-License-Identifier: Apache-2.0
"""The node `sim_label`: the CAD rendered from where the camera really was, for each view of `preproc`."""

from __future__ import annotations

import time
from collections import Counter, deque
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped
from sensor_msgs.msg import CameraInfo, Image, PointCloud2, TimeReference

from tof_core.decode import stamp_ns
from tof_core.errors import TransformError, UsageError
from tof_core.robot import RobotChain
from tof_core.tf import TransformBuffer
from tof_ros import messages, qos
from tof_ros.base import RoomNode
from tof_ros.joiner import StampJoiner
from tof_ros.patience import NEVER, PERIOD_S, Patience
from tof_ros.recorder import RecordService
from tof_ros.transforms import TransformListener
from tof_scene.builtin import open_scene
from tof_scene.raycast import Raycaster
from tof_sim_label.live import LabelNodeConfig, view_of
from tof_sim_label.stream import Labelled, LabelStream

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from tof_core.capture import View
    from tof_sim_label.label import Label

NAME = "sim_label"
OUTPUTS = {
    "depth": Image,
    "mask": Image,
    "part": Image,
    "sigma": Image,
    "camera_info": CameraInfo,
    "points": PointCloud2,
    "pose": PoseWithCovarianceStamped,
}
"""Topics under `label/`, once per view, with the stamp of its last capture."""
REQUIRED = ("depth", "sigma", "count", "reason", "camera_info", "dwell")


CONFIG = LabelNodeConfig


class LabelNode(RoomNode[LabelNodeConfig]):
    """Labels each view (docs/nodes/sim_label.md)."""

    def __init__(self, **options: Any) -> None:
        """Load the scene, then subscribe."""
        super().__init__(NAME, "label", LabelNodeConfig, fixed=("live.",), **options)
        live = self.config.live
        if not live.scene:
            raise UsageError("no scene given", where="sim_label", todo="start it with --scene, or -p live.scene:=FILE")
        self._scene = open_scene(live.scene)
        self._caster = Raycaster(self._scene)
        self._stream = LabelStream(self._caster, self.config)
        self._chain = RobotChain(
            TransformBuffer(live.max_gap_s, keep_s=live.keep_tf_s),
            live.cell_frame or self._scene.frame,
            live.body_frame,
            self._scene.placed_in,
        )
        self._joiner = StampJoiner(REQUIRED, patience_s=2.0)
        self._waiting: deque[tuple[int, dict[str, Any]]] = deque()
        self._arrivals: dict[int, float] = {}
        self._patience, self._overdue = Patience(live.patience_s), NEVER
        self._verdicts: Counter[str] = Counter()
        self._labelled = time.monotonic()
        self._tf = TransformListener(self, self._chain.transforms, self._advance)
        self._outputs = {name: self.output(name, kind) for name, kind in OUTPUTS.items()}
        for part, kind in {**dict.fromkeys((*REQUIRED, "amplitude"), Image), "camera_info": CameraInfo, "dwell": TimeReference}.items():
            self.input(f"preproc/{part}", kind, partial(self._part, part), qos.OUTPUT)
        self.service("capture", self.flush)
        self.service("flush", self.flush)
        RecordService(self, live.record, "labels", [(f"label/{name}", kind) for name, kind in OUTPUTS.items()])
        self.timer(PERIOD_S, self._tick)

    def _part(self, part: str, message: Any) -> None:
        stamp = stamp_ns(message)
        if part == "depth":
            self._arrivals[stamp] = self.tally.arrived()
            self._patience.start(stamp)
        if part == "dwell" and "amplitude=1" in message.source:
            self._joiner.expect("amplitude")
        self._joiner.add(part, stamp, message)
        self._advance()

    def _tick(self) -> None:
        """Give up waiting for what does not come; label a view that has long been the last."""
        self._overdue = max(self._overdue, self._patience.tick())
        self._advance()
        settle = self.config.live.settle_s
        if settle and time.monotonic() - self._labelled > settle:
            self._publish(self._stream.flush())

    def _advance(self) -> None:
        """Take every view whose transform is there."""
        self._waiting.extend(self._joiner.take())
        while self._waiting:
            stamp, parts = self._waiting[0]
            try:
                view = view_of(stamp, parts, self._chain)
            except TransformError as error:
                if stamp > self._overdue and not self._chain.settled(parts["depth"].header.frame_id, stamp):
                    return
                self._waiting.popleft()
                self._patience.end(stamp)
                self.skip(stamp, "no transform", str(error))
                continue
            self._waiting.popleft()
            self._patience.end(stamp)
            self._publish(self._stream.push(view))
            self._labelled = time.monotonic()
            self.done(stamp, self._arrivals.pop(stamp, self._labelled))

    def _publish(self, labelled: Labelled | None) -> None:
        if labelled is None:
            return
        if labelled.label is None:
            self._verdicts["refused"] += 1
            self.get_logger().warning(f"view {labelled.view.stamp_ns} has no label: {labelled.why}")
            return
        self._verdicts[labelled.label.posed.verdict] += 1
        self._publish_label(labelled.view, labelled.label)

    def _publish_label(self, view: View, label: Label) -> None:
        head = messages.header(view.stamp_ns, view.camera.frame_id)
        images: dict[str, tuple[NDArray[Any], str]] = {
            "depth": (label.depth, "32FC1"),
            "sigma": (label.sigma, "32FC1"),
            "mask": (label.mask, "mono8"),
            "part": (np.asarray(label.part, np.int16), "16SC1"),
        }
        for name, (array, encoding) in images.items():
            self._outputs[name].publish(messages.image(array, encoding, head))
        self._outputs["camera_info"].publish(messages.camera_info(view.camera, head))
        if self._outputs["points"].get_subscription_count():
            self._outputs["points"].publish(messages.points(view.camera.points(label.depth).astype(np.float32), head))
        cell = self._chain.cell or self._scene.frame
        self._outputs["pose"].publish(messages.pose(label.posed, messages.header(view.stamp_ns, cell)))

    def flush(self) -> str:
        """Label what has been accumulated, now."""
        self._advance()
        before = self._verdicts.total()
        self._publish(self._stream.flush())
        return f"{self._verdicts.total() - before} view labelled"

    def on_config(self, config: LabelNodeConfig) -> None:
        """Other settings begin a new session; the scene stays loaded."""
        self._stream = LabelStream(self._caster, config)

    def destroy_node(self) -> None:
        """Stop listening to TF, then go."""
        self._tf.close()
        super().destroy_node()

    def reset(self) -> str:
        """Forget the session."""
        if hasattr(self, "_stream"):
            self._stream.reset()
            self._joiner.clear()
            self._waiting.clear()
            self._arrivals.clear()
            self._patience.clear()
            self._overdue = NEVER
            self._chain.transforms.clear_dynamic()
        return "the session is forgotten"

    def figures(self) -> Mapping[str, str]:
        """Scene, verdicts, how old TF is."""
        verdicts = {f"verdict.{name}": str(count) for name, count in sorted(self._verdicts.items())}
        return {
            "scene": f"{self._scene.folder.name} {self._scene.digest[:12]}",
            "raycaster": self._caster.backend,
            "tf_age_s": f"{self._tf.age:.2f}",
            "incomplete": str(self._joiner.incomplete),
            **verdicts,
        }


def make_node(**options: Any) -> LabelNode:
    """The node; keyword arguments as of `rclpy.node.Node`."""
    return LabelNode(**options)
