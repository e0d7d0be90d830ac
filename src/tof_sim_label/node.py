# SPDX-License-Identifier: Apache-2.0
"""The node `sim_label`: renders the CAD at the solved pose of each view of `preproc`."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor, wait
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Path
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import MarkerArray

from tof_core.errors import UsageError
from tof_ros import messages
from tof_ros.depth_output import DepthOutput
from tof_ros.managed import ManagedNode
from tof_ros.markers import BLUE, GREEN, ORANGE, RED, colour, part_markers
from tof_ros.patience import PERIOD_S
from tof_ros.placing import Frames, Placing
from tof_ros.recorder import RecordService
from tof_ros.ticker import Ticker
from tof_ros.views import ViewFeed
from tof_scene.builtin import open_scene
from tof_scene.raycast import Raycaster
from tof_sensor.known import known_bias
from tof_sim_label.live import LabelNodeConfig
from tof_sim_label.spare import SpareTime
from tof_sim_label.standing import Standing, Standings
from tof_sim_label.stream import Labelled, LabelStream, warm_up
from tof_sim_label.verdicts import Verdicts

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from tof_core.capture import Posed, View
    from tof_ros.markers import Colour
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
SHARED = {"label/path": Path, "scene/markers": MarkerArray}
"""Latched topics for RViz: the corrected camera since the session began, and the CAD."""
COLOURS = {Standing.CONFIRMED: GREEN, Standing.PARTLY: ORANGE, Standing.CONTRADICTED: RED, Standing.REFUSED: BLUE}
"""Of the parts in `scene/markers`."""
SPARE_TIME = "Or let labels have a share of a core, so that views do not wait for them (--param sim_label.live.share=0.1; ros2 run: -p live.share:=0.1)."
"""What helps where labels take longer than views come."""
LONGEST_PATH = 1000
"""Poses: a day of views, 60 kB a message."""
SETTLE_TICKS = 5
"""Checks per `live.settle_s` whether this time has passed; each check wakes the node."""
CONFIG = LabelNodeConfig


class LabelNode(ManagedNode[LabelNodeConfig]):
    """Labels each view (docs/nodes/sim_label.md)."""

    rest_s = 0.01

    def __init__(self, **options: Any) -> None:
        """Nothing loaded yet."""
        super().__init__(NAME, "label", LabelNodeConfig, fixed=("live.",), **options)
        self._verdicts = Verdicts()
        self._outputs = {name: self.output(name, kind) for name, kind in OUTPUTS.items()}
        self._depth = DepthOutput(self, "depth", self._outputs["depth"], lambda: self.config.live.depth_code)
        self._latched = {name: self.shared(name, kind) for name, kind in SHARED.items()}
        self._placing = Placing(self)
        self.service("capture", self.flush)
        self.service("flush", self.flush)
        labels = [(f"label/{name}", kind) for name, kind in OUTPUTS.items()]
        RecordService(self, lambda: self.config.live.record, "labels", [*labels, ("/tf", TFMessage), ("/tf_static", TFMessage)])

    def load(self) -> None:
        """Read the scene, build its search tree."""
        live = self.config.live
        if not live.scene:
            raise UsageError("no scene given", where="sim_label", todo="start it with --scene, or -p live.scene:=FILE")
        self._scene = open_scene(live.scene)
        self._caster = Raycaster(self._scene)
        self._bias = known_bias(live.sensor)
        warming = ThreadPoolExecutor(1)
        self._warm = warming.submit(warm_up, self._caster)  # While the middleware connects to preproc.
        warming.shutdown(wait=False)

    def start(self) -> None:
        """Subscribe to `preproc` and TF; a session begins."""
        live = self.config.live
        self._begin(self.config)
        self._frames = Frames(self) if live.publish_tf else None
        on_placed = self._frames.placed if self._frames else None
        self._chain = self._placing.chain(live, self._scene.frame, self._scene.placed_in, on_placed)
        self._labelled = time.monotonic()
        self._path = Path(header=messages.header(0, self._cell))
        self._feed = ViewFeed(self, self._chain, live.patience_s, self._take, self._placing.camera, relief=SPARE_TIME)
        self._ticker = Ticker(self, self._settle, max(live.settle_s / SETTLE_TICKS, PERIOD_S))
        self._spare = SpareTime(live.share) if live.share else None
        if self._spare is not None:
            self.at_stop.append(self._spare.close)
        self._colours: dict[str, Colour] | None = None
        self._markers = part_markers([(part.name, part.vertices, part.faces) for part in self._scene.parts], self._cell, {})
        self._standings = Standings(len(self._scene.parts))
        self._draw()

    def unload(self) -> None:
        """Release the scene."""
        wait([self._warm])
        del self._caster, self._scene

    def _take(self, view: View) -> None:
        self._label(self._stream.ended(view))
        self._labelled = time.monotonic()
        self._ticker.start()

    def _label(self, view: View | None) -> None:
        """Label a view: at once, or in spare time where labels have a share of the time."""
        if view is None:
            return
        if self._spare is None:
            self._work(view)
        elif not self._spare.take(partial(self._work, view)):
            self.get_logger().warning(
                f"labels have used up live.share of a core: {self._verdicts.skip()} have none", throttle_duration_sec=60.0
            )

    def _work(self, view: View) -> None:
        self._warm.result()
        self._publish(self._stream.label(view))

    def _finish(self) -> None:
        """Wait for a label in progress."""
        if self._spare is not None:
            self._spare.finish()

    def _settle(self) -> bool:
        """Label the last view once no other has come for a while; whether one may wait for that."""
        settle = self.config.live.settle_s
        if settle and time.monotonic() - self._labelled > settle:
            self._label(self._stream.current())
            return False
        return bool(settle)

    def _publish(self, labelled: Labelled) -> None:
        if labelled.label is None:
            self._verdicts.refuse("refused", labelled.why)
            return
        posed = labelled.label.posed
        if posed.accepted:
            self._verdicts.accept(posed.short)
            self._publish_pose(labelled.view, posed)
        else:
            self._verdicts.refuse(posed.short, posed.verdict)
        self._publish_label(labelled.view, labelled.label)

    def _publish_pose(self, view: View, posed: Posed) -> None:
        """Where the camera is: of an accepted view alone, for a robot acts on it, and nothing in the message would tell a refused one."""
        in_cell = messages.header(view.stamp_ns, self._cell)
        self._outputs["pose"].publish(messages.pose(posed.T_cell_camera, posed.cov, in_cell))
        if self._frames is not None:
            self._frames.aligned(self._cell, view.camera.frame_id, posed.T_cell_camera, view.stamp_ns)
        self._path.poses = [*self._path.poses[1 - LONGEST_PATH :], messages.pose_stamped(posed.T_cell_camera, in_cell)]
        self._latched["label/path"].publish(self._path)

    def _publish_label(self, view: View, label: Label) -> None:
        head = messages.header(view.stamp_ns, view.camera.frame_id)
        images: dict[str, tuple[NDArray[Any], str]] = {
            "sigma": (label.sigma, "32FC1"),
            "mask": (label.mask, "mono8"),
            "part": (np.asarray(label.part, np.int16), "16SC1"),
        }
        self._depth.offer(label.depth, head)
        for name, (array, encoding) in images.items():
            self.offer(self._outputs[name], partial(messages.image, array, encoding, head))
        self.offer(self._outputs["camera_info"], lambda: messages.camera_info(view.camera, head))
        self.offer(
            self._outputs["points"], lambda: messages.points(view.camera.points(label.depth).astype(np.float32), head, view.amplitude)
        )
        self._standings.add(view, label)
        self._draw()

    @property
    def _cell(self) -> str:
        """TF frame of the cell."""
        return self._chain.cell.lstrip("/") or self._scene.frame

    def _draw(self) -> None:
        """Publish the CAD, once and where a colour changes: a part by its standing, grey where nothing is known of it."""
        colours = {self._scene.names[n]: COLOURS[standing] for n, standing in self._standings.all().items()}
        if colours != self._colours:
            self._colours = colours
            colour(self._markers, colours)
            self._latched["scene/markers"].publish(self._markers)

    def flush(self) -> str:
        """Label the current view now."""
        self._feed.advance()
        self._finish()
        view = self._stream.current()
        if view is not None:
            self._work(view)
        return f"{int(view is not None)} view labelled"

    def retune(self, config: LabelNodeConfig) -> None:
        """Other settings begin a new session; the scene stays loaded."""
        self._finish()
        self._begin(config)

    def _begin(self, config: LabelNodeConfig) -> None:
        """A session without a view yet."""
        self._stream = LabelStream(self._caster, config, self._bias)
        self._verdicts.begin()

    def reset(self) -> str:
        """End the session and begin another: what was learnt of the robot and the camera is forgotten."""
        self._finish()
        self._stream.reset()
        self._verdicts.begin()
        self._standings = Standings(len(self._scene.parts))
        self._feed.reset()
        return "the session is forgotten"

    def figures(self) -> Mapping[str, str]:
        """Scene, verdicts, the newest refusal, how old TF is."""
        scene = {"scene": f"{self.config.live.scene_name} {self._scene.digest[:12]}", "raycaster": self._caster.backend}
        verdicts = {f"verdict.{name}": str(count) for name, count in sorted(self._verdicts.counts.items())}
        newest = {"refused": self._verdicts.why} if self._verdicts.why else {}
        return {**scene, **(self._feed.figures() if self.active else {}), **verdicts, **newest}

    def warnings(self) -> list[str]:
        """Views that are refused."""
        refused = self._verdicts.warning(self._placing.source)
        return [refused] if refused else []


def make_node(**options: Any) -> LabelNode:
    """The node; keyword arguments as of `rclpy.node.Node`."""
    return LabelNode(**options)
