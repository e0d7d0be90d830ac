# SPDX-License-Identifier: Apache-2.0
"""The node `inspect` over DDS: the Inspector's verdicts, one status a part, and a file that holds the same."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from tests.tof_inspect.made import CAMERA, EYE, as_built, plate, seen
from tests.tof_ros.peers import Observer, values, wait_for
from tests.tof_ros.view_source import ViewSource
from tof_core import se3
from tof_scene.raycast import Raycaster

pytest.importorskip("rclpy", reason="no ROS 2 here")

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from tof_core.arrays import Bytes
    from tof_scene.scene import Scene

pytestmark = pytest.mark.dds
GONE = "clip"


def written(scene: Scene, folder: Path) -> Path:
    """A scene made in memory, as files."""
    import yaml

    parts = []
    for part in scene.parts:
        lines = [f"v {x} {y} {z}" for x, y, z in part.vertices.tolist()] + [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in part.faces.tolist()]
        (folder / f"{part.name}.obj").write_text("\n".join(lines))
        parts.append({"name": part.name, "mesh": f"{part.name}.obj", "inspect": part.inspect})
    (folder / "scene.yaml").write_text(yaml.safe_dump({"frame": "cell", "parts": parts}))
    return folder / "scene.yaml"


def painted(scene: Scene) -> Bytes:
    """What a colour camera with the lens and the place of the depth camera sees: each part in its own colour."""
    rays = CAMERA.rays().reshape(-1, 3) @ EYE[:3, :3].T
    part = Raycaster(scene).cast(EYE[:3, 3], rays).part
    paint = {name: (90 + 40 * (k % 4), 60 + 30 * (k % 5), 200 - 25 * k) for k, name in enumerate(p.name for p in plate().parts)}
    colours = np.array([*(paint[p.name] for p in scene.parts), (20, 20, 20)], np.uint8)
    return np.asarray(colours[part].reshape(*CAMERA.shape, 3))


class Bench:
    """An `inspect` in one thread, a robot and an observer in others."""

    def __init__(self, node: Any, observer: Observer, out: Path) -> None:
        from diagnostic_msgs.msg import DiagnosticArray

        from tof_ros import qos

        self.node, self.observer, self.out = node, observer, out
        self.source = ViewSource(observer.node)
        self.heard: list[Any] = []
        observer.node.create_subscription(DiagnosticArray, "/spot/inspect/verdict", self.heard.append, qos.OUTPUT)

    def wait_for_views(self, count: int) -> None:
        """Until the node has taken so many."""
        wait_for(lambda: self.node.tally.kept == count, what=str(self.node.tally.skipped))


@pytest.fixture(scope="module")
def bench(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    from tof_inspect.node import make_node
    from tof_ros.environment import parameter_overrides, ros_context
    from tof_ros.spin import spinning

    out = tmp_path_factory.mktemp("inspect") / "out"
    scene = written(plate(), tmp_path_factory.mktemp("scene"))
    overrides = parameter_overrides({"live.scene": str(scene), "live.out": str(out)})
    with ros_context(domain=ros_domain) as context:
        node = make_node(context=context, namespace="spot", parameter_overrides=overrides)
        observer = Observer(context)
        with spinning([node, observer.node]):
            bench = Bench(node, observer, out)
            wait_for(lambda: node.active and bench.source.matched)
            yield bench


def test_without_views_the_service_reports_it(bench: Bench) -> None:
    answer = bench.observer.trigger("/spot/inspect/judge")
    assert (answer.success, "no view has come yet" in answer.message) == (False, True)


def test_a_missing_part_is_reported_on_the_topic_in_diagnostics_and_in_the_file(bench: Bench) -> None:
    for n, built in enumerate((plate(), as_built(plate(), gone=(GONE,)))):
        if n:
            kept = bench.observer.trigger("/spot/inspect/capture_reference")
            assert (kept.success, kept.message) == (True, "1 reference images in colour")
            assert bench.observer.trigger("/spot/inspect/reset").success
        bench.source.send(seen(built), colour=painted(built))
        bench.wait_for_views(n + 1)
    answer = bench.observer.trigger("/spot/inspect/judge")
    assert answer.success, answer.message
    status = {s.name.removeprefix("inspect: "): s for s in wait_for(lambda: bench.heard)[-1].status}
    states = {p["name"]: p["state"] for p in json.loads((bench.out / "inspection.json").read_text())["parts"]}
    assert {name: values(s)["state"] for name, s in status.items()} == states
    assert {name: states[name] for name in (GONE, "block", "behind")} == {GONE: "absent", "block": "present", "behind": "not_observable"}
    assert float(values(status[GONE])["log_colour"]) < -1.0 < 1.0 < float(values(status["block"])["log_colour"])
    levels = {name: int.from_bytes(s.level, "big") for name, s in status.items()}
    assert (levels[GONE], levels["block"], levels["behind"]) == (2, 0, 3)
    assert (bench.out / "inspection.html").is_file()
    assert "parts absent: 1" in bench.observer.status("spot/inspect", lambda s: "absent" in s.message).message


def test_the_action_judges_step_by_step_and_the_typed_topic_has_the_same_verdicts(bench: Bench) -> None:
    from action_msgs.msg import GoalStatus

    messages = pytest.importorskip("toftwin_msgs.msg", reason="toftwin_msgs is not built here")
    from toftwin_msgs.action import Judge

    from tof_ros import qos

    typed: list[Any] = []
    bench.observer.node.create_subscription(messages.InspectionVerdict, "/spot/inspect/parts", typed.append, qos.OUTPUT)
    wait_for(bench.node._parts.get_subscription_count)
    acted = bench.observer.act(Judge, "/spot/inspect/judge")
    assert (acted.status, acted.result.success) == (GoalStatus.STATUS_SUCCEEDED, True), acted.result.message
    parts = {part.name: part for part in acted.result.verdict.parts}
    assert (parts[GONE].state, parts["block"].state) == (messages.PartVerdict.ABSENT, messages.PartVerdict.PRESENT)
    assert (parts["block"].tolerance, acted.result.verdict.header.frame_id) == (pytest.approx(1e-3 * 1.0), "cell")
    assert acted.steps[0].step == "poses of all views"
    assert {s.step for s in acted.steps} >= {GONE, "block"}
    counted = list(dict.fromkeys((s.done, s.total) for s in acted.steps))  # a step that lasts is said again
    assert counted == [(n, len(counted)) for n in range(len(counted))]
    assert [p.name for p in wait_for(lambda: typed)[-1].parts] == list(parts)


def test_a_judgement_is_cancelled_between_two_parts(bench: Bench) -> None:
    from action_msgs.msg import GoalStatus

    pytest.importorskip("toftwin_msgs.msg", reason="toftwin_msgs is not built here")
    from toftwin_msgs.action import Judge

    acted = bench.observer.act(Judge, "/spot/inspect/judge", cancel_at="poses of all views")
    assert (acted.status, acted.result.success) == (GoalStatus.STATUS_CANCELED, False)
    assert acted.result.message.startswith("cancelled: ")
    assert bench.observer.trigger("/spot/inspect/judge").success


def test_the_node_itself_does_not_compute_a_judgement(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """Beside nodes that compute, a thread of the node would wait for the interpreter lock at each of its many short calls."""

    def forbidden(*_: object) -> None:
        raise AssertionError

    monkeypatch.setattr("tof_inspect.judge.Inspector.judge", forbidden)
    assert bench.observer.trigger("/spot/inspect/judge").success


def test_where_tf_has_no_cell_the_markers_stand_in_the_frame_in_which_it_is_placed(ros_domain: int, tmp_path: Path) -> None:
    from rclpy.qos import DurabilityPolicy, QoSProfile
    from visualization_msgs.msg import MarkerArray

    from tof_inspect.node import make_node
    from tof_ros.environment import parameter_overrides, ros_context
    from tof_ros.spin import spinning

    overrides = parameter_overrides({"live.scene": str(written(plate(), tmp_path)), "live.initial_pose": "odom: 0 0 0.2 0 0 0 1"})
    with ros_context(domain=ros_domain) as context:
        node, observer = make_node(context=context, namespace="alone", parameter_overrides=overrides), Observer(context, "other")
        source = ViewSource(observer.node, "alone", root="odom", T_root_cell=se3.from_quat((0.0, 0.0, 0.2), (0.0, 0.0, 0.0, 1.0)))
        drawn: list[Any] = []
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        observer.node.create_subscription(MarkerArray, "/alone/inspect/markers", drawn.append, latched)
        with spinning([node, observer.node]):
            wait_for(lambda: node.active and source.matched)
            source.send(seen(plate()))
            wait_for(lambda: node.tally.kept == 1, what=str(node.tally.skipped))
            assert observer.trigger("/alone/inspect/judge").success
            markers = wait_for(lambda: drawn)[-1].markers
    assert {(m.header.frame_id, round(m.pose.position.z, 6)) for m in markers} == {("odom", 0.2)}


def test_the_text_topic_names_the_typed_one_to_its_subscriber(bench: Bench) -> None:
    lines = wait_for(lambda: [line for line in bench.observer.log if "ends with the next release" in line])
    assert lines == [
        "spot.inspect: /spot/inspect/verdict ends with the next release: let /observer hear /spot/inspect/parts, which has typed fields"
    ]


def test_a_scene_without_parts_to_inspect_is_a_failed_configuration(ros_domain: int, tmp_path: Path) -> None:
    from dataclasses import replace

    from tof_inspect.node import make_node
    from tof_ros.environment import parameter_overrides, ros_context

    bare = plate()
    scene = written(replace(bare, parts=(bare.part("wall"),)), tmp_path)
    with ros_context(domain=ros_domain) as context:
        node = make_node(context=context, parameter_overrides=parameter_overrides({"live.scene": str(scene), "live.autostart": False}))
        node.trigger_configure()
        assert (node.state, "no part has `inspect: true`" in node.trouble) == ("unconfigured", True), node.trouble
        node.destroy_node()
