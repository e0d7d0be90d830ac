# SPDX-License-Identifier: Apache-2.0
"""The node `inspect` over DDS: the Inspector's verdicts, one status a part, and a file that holds the same."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import pytest

from tests.tof_inspect.made import as_built, plate, seen
from tests.tof_ros.peers import Observer, values, wait_for
from tests.tof_ros.view_source import ViewSource

pytest.importorskip("rclpy", reason="no ROS 2 here")

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

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


class Bench:
    """An `inspect` in one thread, a robot and an observer in others."""

    def __init__(self, node: Any, observer: Observer, out: Path) -> None:
        from diagnostic_msgs.msg import DiagnosticArray

        from tof_ros import qos

        self.node, self.observer, self.out = node, observer, out
        self.source = ViewSource(observer.node)
        self.heard: list[Any] = []
        observer.node.create_subscription(DiagnosticArray, "/spot/inspect/verdict", self.heard.append, qos.OUTPUT)


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


def test_without_views_the_service_says_so(bench: Bench) -> None:
    answer = bench.observer.trigger("/spot/inspect/judge")
    assert (answer.success, "no view has come yet" in answer.message) == (False, True)


def test_a_part_that_is_gone_is_told_on_the_topic_in_diagnostics_and_in_the_file(bench: Bench) -> None:
    bench.source.send(seen(as_built(plate(), gone=(GONE,))))
    wait_for(lambda: bench.node.tally.kept == 1, what=str(bench.node.tally.skipped))
    answer = bench.observer.trigger("/spot/inspect/judge")
    assert answer.success, answer.message
    said = {s.name.removeprefix("inspect: "): s for s in wait_for(lambda: bench.heard)[-1].status}
    told = {p["name"]: p["state"] for p in json.loads((bench.out / "inspection.json").read_text())["parts"]}
    assert {name: values(s)["state"] for name, s in said.items()} == told
    assert {name: told[name] for name in (GONE, "block", "behind")} == {GONE: "absent", "block": "present", "behind": "not_observable"}
    levels = {name: int.from_bytes(s.level, "big") for name, s in said.items()}
    assert (levels[GONE], levels["block"], levels["behind"]) == (2, 0, 3)
    assert (bench.out / "inspection.html").is_file()
    assert "parts absent: 1" in bench.observer.status("spot/inspect", lambda s: "absent" in s.message).message


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
