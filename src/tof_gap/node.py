# SPDX-License-Identifier: Apache-2.0
"""The node `gap`: measured minus rendered for each labelled view, and a warning once that grows."""

from __future__ import annotations

import json
import math
from collections import deque
from typing import TYPE_CHECKING, Any

from geometry_msgs.msg import PoseWithCovarianceStamped
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import String
from visualization_msgs.msg import MarkerArray

from tof_core import se3
from tof_core.beside import beside
from tof_core.decode import stamp_ns
from tof_core.errors import RefusedError, UsageError
from tof_core.live import Dwells
from tof_gap.live import DiagnosisConfig, GapNodeConfig
from tof_gap.process import NICENESS, Task, diagnose
from tof_gap.watch import GapWatch
from tof_ros import messages, qos
from tof_ros.actions import serve
from tof_ros.managed import ManagedNode
from tof_ros.markers import part_markers, same_shade, shade
from tof_ros.placing import Placing
from tof_ros.views import ViewFeed
from tof_scene.builtin import open_scene
from tof_scene.raycast import Raycaster
from tof_sensor.registry import left_out

if TYPE_CHECKING:
    from collections.abc import Mapping

    from tof_core.capture import View
    from tof_gap.watch import Watched
    from tof_ros.actions import Progress

NAME = "gap"
OUTPUTS = {"residual": Image, "camera_info": CameraInfo, "report": String}
"""Topics under `gap/`, once per labelled view, with its stamp."""
SHARED = {"gap/markers": MarkerArray}
"""Latched for RViz: the parts, coloured by the gap that the views of this baseline show on them."""
TYPED = {"watch": "GapReport"}
"""The report with typed fields (toftwin_msgs)."""
ACTIONS = {"diagnose": "Diagnose"}
CONFIG = GapNodeConfig
SCHEMA = "toftwin.gap.watch/1"
KEPT = 8
"""Dwells and poses that wait for each other."""


class GapNode(ManagedNode[GapNodeConfig]):
    """Watches the gap at the poses of `sim_label`, and diagnoses it on request (docs/nodes/gap.md)."""

    threads = 2

    def __init__(self, **options: Any) -> None:
        """Nothing loaded yet."""
        super().__init__(NAME, NAME, GapNodeConfig, fixed=("live.", "watch."), **options)
        self._outputs = {name: self.output(name, kind) for name, kind in OUTPUTS.items()}
        self._latched = {name: self.shared(name, kind) for name, kind in SHARED.items()}
        self._typed = self.typed("watch", TYPED["watch"])
        self._placing = Placing(self)
        self._forget()
        serve(self, "diagnose", ACTIONS["diagnose"], self._diagnose)

    def load(self) -> None:
        """Read the scene."""
        live = self.config.live
        if not live.scene:
            raise UsageError("no scene given", where=NAME, todo="start it with --scene, or -p live.scene:=FILE")
        self._caster = Raycaster(open_scene(live.scene))

    def start(self) -> None:
        """Hear `preproc`, TF and the poses of the labels; what is usual is learned anew."""
        live, scene = self.config.live, self._caster.scene
        self._forget()
        self._watch = GapWatch(self._caster, self.config.watch)
        self._dwells, self._session, self._poses = Dwells(KEPT), Dwells(live.views), deque[PoseWithCovarianceStamped](maxlen=KEPT)
        chain = self._placing.chain(live, scene.frame, scene.placed_in)
        self._feed = ViewFeed(self, chain, live.patience_s, self._take, self._placing.camera, unfiltered=True)
        self.input("label/pose", PoseWithCovarianceStamped, self._posed, qos.OUTPUT)

    def unload(self) -> None:
        """Let go of the scene."""
        del self._caster

    def reset(self) -> str:
        """Forget the usual gap and the dwells: the next `watch.baseline` views define what is usual."""
        self._watch.restart()
        self._dwells.clear()
        self._session.clear()
        self._poses.clear()
        self._feed.reset()
        self._forget()
        return "what is usual is forgotten"

    def _forget(self) -> None:
        """Drop the last verdict: it is of another baseline."""
        self._last: Watched | None = None
        self._refused = ""
        self._parts_mm: dict[str, float] = {}

    def _take(self, view: View) -> None:
        self._dwells.add(view)
        self._session.add(view)
        self._match()

    def _posed(self, message: PoseWithCovarianceStamped) -> None:
        self._poses.append(message)
        self._match()

    def _match(self) -> None:
        """Judge each view whose pose has come."""
        for pose in tuple(self._poses):
            if (view := self._dwells.at(stamp_ns(pose))) is not None:
                self._poses.remove(pose)
                self._judge(view, pose)

    def _judge(self, view: View, pose: PoseWithCovarianceStamped) -> None:
        T = messages.matrix(pose.pose.pose)
        try:
            last = self._watch.add(view, T, se3.cov_right(T, pose.pose.covariance.reshape(6, 6)))
        except RefusedError as error:
            self._refused = str(error)
            return
        self._last, self._refused = last, ""
        head = messages.header(view.stamp_ns, view.camera.frame_id)
        self.offer(self._outputs["residual"], lambda: messages.image(last.residual, "32FC1", head))
        self._outputs["camera_info"].publish(messages.camera_info(view.camera, head))
        self.offer(self._outputs["report"], lambda: String(data=json.dumps(_report(last, view))), now="watch")
        if self._typed is not None and self._typed.get_subscription_count():
            from tof_ros.results import gap_report

            self._typed.publish(gap_report(last, head))

        self._draw(last)

    def _draw(self, last: Watched) -> None:
        """Colour the parts: a part keeps the gap of the last view that showed it."""
        before, self._parts_mm = self._parts_mm, {**self._parts_mm, **last.parts_mm}
        red, scene = self.config.live.red_mm, self._caster.scene
        if all(same_shade(before.get(name), mm, red) for name, mm in self._parts_mm.items()):
            return
        colours = {name: shade(mm / red) for name, mm in self._parts_mm.items()}
        parts = [(part.name, part.vertices, part.faces) for part in scene.parts]
        cell = self.config.live.cell_frame.lstrip("/") or scene.frame
        self._latched["gap/markers"].publish(part_markers(parts, cell, colours, space="gap"))

    def _diagnose(self, goal: Any, progress: Progress) -> Any:
        """The result of the action: a diagnosis of the dwells that are kept."""
        from tof_ros.results import diagnosis

        views, live = self._session.all(), self.config.live
        settings = DiagnosisConfig.load(live.settings)
        task = Task(views, live.scene, settings.gap, settings.align, live.sensor, left_out(goal.leave_out, "leave_out"), goal.out)
        found = beside(diagnose, task, progress, progress.check, name="the diagnosis", niceness=NICENESS)
        return diagnosis(found, len(views))

    def figures(self) -> Mapping[str, str]:
        """Scene, the last view's gap, how old TF is."""
        scene, last = self._caster.scene, self._last
        figures = {} if last is None else {key: str(value) for key, value in _report(last).items() if key != "schema"}
        return {
            "scene": f"{self.config.live.scene_name} {scene.digest[:12]}",
            "dwells": str(self._session.count),
            **figures,
            **(self._feed.figures() if self.active else {}),
        }

    def warnings(self) -> list[str]:
        """A gap that grows, or a view that could not be judged."""
        grown = [self._last.message] if self._last is not None and self._last.state == "grown" else []
        return [*grown, *([self._refused] if self._refused else [])]


def _report(watched: Watched, view: View | None = None) -> dict[str, Any]:
    """What a program reads; what is not known yet is null."""
    figures = {"gap_mm": watched.gap_mm, "floor_mm": watched.floor_mm, "usual_mm": watched.usual_mm, "alarm": watched.alarm}
    rounded = {key: None if math.isnan(value) else round(value, 4) for key, value in figures.items()}
    stamp = {"stamp_ns": view.stamp_ns} if view is not None else {}
    return {"schema": SCHEMA, **stamp, "state_of_gap": watched.state, "views": watched.views, **rounded}


def make_node(**options: Any) -> GapNode:
    """The node; keyword arguments as of `rclpy.node.Node`."""
    return GapNode(**options)
