# SPDX-License-Identifier: Apache-2.0
"""The node `inspect`: on request, judges every part from the recent dwells."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from visualization_msgs.msg import MarkerArray

from tof_core.beside import beside
from tof_core.errors import RefusedError, UsageError
from tof_core.live import Dwells
from tof_inspect.live import InspectNodeConfig
from tof_inspect.picture import Picture
from tof_inspect.process import Task, judge
from tof_inspect.without import inspected
from tof_ros import messages
from tof_ros.actions import quiet, serve
from tof_ros.colour import ColourFeed
from tof_ros.diagnostics import status
from tof_ros.managed import ManagedNode
from tof_ros.markers import GREEN, GREY, ORANGE, RED, part_markers
from tof_ros.placing import Placing
from tof_ros.views import ViewFeed
from tof_scene.builtin import open_scene
from tof_sensor.known import known_bias

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from tof_core.arrays import Float
    from tof_inspect.judge import Inspection, PartVerdict
    from tof_ros.actions import Progress

NAME = "inspect"
OUTPUTS = {"verdict": DiagnosticArray}
"""Topics under `inspect/`, once per `~/judge`, with the stamp of the last view."""
TYPED = {"parts": "InspectionVerdict"}
"""The verdicts with typed fields (toftwin_msgs)."""
ACTIONS = {"judge": "Judge"}
SHARED = {"inspect/markers": MarkerArray}
"""Latched for RViz: the inspected parts, coloured by the last judgement."""
COLOURS = {"present": GREEN, "displaced": ORANGE, "absent": RED, "not_observable": GREY}
CONFIG = InspectNodeConfig
LEVELS = {
    "present": DiagnosticStatus.OK,
    "displaced": DiagnosticStatus.WARN,
    "absent": DiagnosticStatus.ERROR,
    "not_observable": DiagnosticStatus.STALE,
}


class InspectNode(ManagedNode[InspectNodeConfig]):
    """Judges parts (docs/nodes/inspect.md)."""

    threads = 2

    def __init__(self, **options: Any) -> None:
        """Make the outputs and services; the scene is loaded by `load`."""
        super().__init__(NAME, NAME, InspectNodeConfig, fixed=("live.", "align."), **options)
        self._outputs = {name: self.output(name, kind) for name, kind in OUTPUTS.items()}
        self._parts = self.typed("parts", TYPED["parts"])
        self._latched = {name: self.shared(name, kind) for name, kind in SHARED.items()}
        self._counts: dict[str, int] = {}
        self._placing = Placing(self)
        self.service("capture_reference", self._capture, slow=True)
        self.service("judge", lambda: self._judge()[0], slow=True)
        serve(self, "judge", ACTIONS["judge"], self._answer)

    def load(self) -> None:
        """Read the scene; one without parts to inspect is refused."""
        live = self.config.live
        if not live.scene:
            raise UsageError("no scene given", where=NAME, todo="start it with --scene, or -p live.scene:=FILE")
        self._scene, self._bias = open_scene(live.scene), known_bias(live.sensor)
        self._names = inspected(self._scene)
        self._first: tuple[Picture, ...] = ()

    def start(self) -> None:
        """Subscribe to `preproc` and TF."""
        live, scene = self.config.live, self._scene
        self._drawn_in: tuple[str, Float | None] = (live.cell_frame.lstrip("/") or scene.frame, None)
        chain = self._placing.chain(live, scene.frame, scene.placed_in, self._placed)
        self._dwells = Dwells(live.views)
        colour = ColourFeed(self, chain, live)
        self._feed = ViewFeed(self, chain, live.patience_s, lambda view: self._dwells.add(colour.beside(view)), self._placing.camera)

    def _placed(self, parent: str, child: str, T_parent_child: Float) -> None:
        """TF lacks the cell: where `sim_label` does not publish it, the markers are drawn in the frame in which it is placed."""
        if child == self._drawn_in[0]:
            self._drawn_in = parent, T_parent_child

    def unload(self) -> None:
        """Release the scene."""
        del self._scene, self._bias, self._first

    def reset(self) -> str:
        """Discard the dwells; the reference images are kept."""
        self._dwells.clear()
        self._feed.reset()
        return "the dwells are discarded"

    def _capture(self) -> str:
        """Store the current images as reference images of the complete scene."""
        found, _ = self._judged()
        pictures = [Picture.of(v.colour, p.T_cell_camera) for v, p in zip(found.views, found.posed, strict=True) if p.accepted]
        first = tuple(p for p in pictures if p is not None)
        if not first:
            raise RefusedError("no dwell has a colour image with calibration and TF", where=NAME, todo="is live.colour_topic published?")
        self._first = first
        return f"{len(first)} reference images in colour"

    def _answer(self, goal: Any, progress: Progress) -> Any:
        """The result of the action `judge`."""
        del goal
        from toftwin_msgs.action import Judge

        progress.total = 1 + len(self._names)
        message, found = self._judge(progress, progress.check)
        return Judge.Result(success=True, message=message, verdict=self._typed(found))

    def _judged(
        self, progress: Callable[[str], None] = quiet, check: Callable[[], None] = lambda: None, out: str = ""
    ) -> tuple[Inspection, str]:
        """The verdicts on every part now, and the page of their report in the folder `out`; computed beside the node."""
        views, config = self._dwells.all(), self.config
        task = Task(views, config.live.scene, config.inspect, config.align, self._bias, self._first, out)
        found, page = beside(judge, task, progress, check, name="the judgement")
        return replace(found, views=views), page

    def _judge(self, progress: Callable[[str], None] = quiet, check: Callable[[], None] = lambda: None) -> tuple[str, Inspection]:
        """Judge every part now, and publish the verdicts."""
        found, page = self._judged(progress, check, self.config.live.out)
        states = [v.state for v in found.verdicts]
        self._counts = {state: states.count(state) for state in LEVELS}
        self._publish(found)
        counts = ", ".join(f"{count} {state.replace('_', ' ')}" for state, count in self._counts.items())
        return f"{counts} from {len(found.views)} views" + (f"; report: {page}" if page else ""), found

    def _publish(self, found: Inspection) -> None:
        scene = self._scene
        head = messages.header(found.views[-1].stamp_ns, scene.frame)
        statuses = [_status(v) for v in found.verdicts]
        self.offer(self._outputs["verdict"], lambda: DiagnosticArray(header=head, status=statuses), now="parts")
        self.offer(self._parts, lambda: self._typed(found))
        parts = [(p.name, p.vertices, p.faces) for p in (scene.part(v.name) for v in found.verdicts)]
        colours = {v.name: COLOURS[v.state] for v in found.verdicts}
        frame, T_frame_cell = self._drawn_in
        self._latched["inspect/markers"].publish(part_markers(parts, frame, colours, T_frame_cell=T_frame_cell, space="inspect"))

    def _typed(self, found: Inspection) -> Any:
        """The verdicts as a message."""
        from tof_ros.results import inspection

        return inspection(found.verdicts, found.views, found.colour, self._scene.frame)

    def figures(self) -> Mapping[str, str]:
        """Scene, last verdicts, age of TF."""
        scene = self._scene
        return {
            "scene": f"{self.config.live.scene_name} {scene.digest[:12]}",
            "inspected": str(len(self._names)),
            "first_pictures": str(len(self._first)),
            **{f"verdict.{state}": str(count) for state, count in self._counts.items()},
            **(self._feed.figures() if self.active else {}),
        }

    def warnings(self) -> list[str]:
        """Numbers of absent and displaced parts in the last judgement."""
        bad = {state: self._counts.get(state, 0) for state in ("absent", "displaced")}
        return [f"parts {state}: {count}" for state, count in bad.items() if count]


def _status(verdict: PartVerdict) -> DiagnosticStatus:
    values = {key: "" if value is None else str(value) for key, value in verdict.to_dict().items()}
    return status(LEVELS[verdict.state], f"inspect: {verdict.name}", f"{verdict.state.replace('_', ' ')}: {verdict.why}", values)


def make_node(**options: Any) -> InspectNode:
    """The node; keyword arguments as of `rclpy.node.Node`."""
    return InspectNode(**options)
