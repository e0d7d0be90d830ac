# SPDX-License-Identifier: Apache-2.0
"""The launch file, executed against a stand-in of `launch` (tests/ros_ws/stand_in.py): what would start, with what."""

from __future__ import annotations

import runpy
from typing import TYPE_CHECKING, Any

import pytest

from tests.ros_ws.stand_in import ExecuteProcess, Node, installed
from tof_core.config import table
from tof_sensor.live import SensorNodeConfig
from toftwin.graph import NODES

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

Launch = dict[str, Any]


@pytest.fixture
def launch(repository: Path) -> Iterator[Launch]:
    share = repository / "ros_ws" / "src" / "toftwin_bringup"
    for _ in installed(share):
        yield runpy.run_path(str(share / "launch" / "graph.launch.py"))


def started(launch: Launch, **given: str) -> list[Any]:
    """The actions for some arguments, the others at their defaults."""
    defaults = {a.name: a.given["default_value"] for a in launch["ARGUMENTS"]}
    assert given.keys() <= defaults.keys()
    actions: list[Any] = launch["graph"]({**defaults, **given})
    return actions


def nodes(actions: list[Any]) -> dict[str, Node]:
    return {a.given["executable"]: a for a in actions if isinstance(a, Node)}


def parameters(node: Node) -> dict[str, Any]:
    overrides: dict[str, Any] = node.given["parameters"][1]
    return overrides


def test_every_argument_is_described_and_has_a_default(launch: Launch) -> None:
    names = [a.name for a in launch["ARGUMENTS"]]
    assert {"mode", "bag", "scene", "namespace", "params_file", "rviz", "use_sim_time"} <= set(names)
    assert all(a.given["description"] and isinstance(a.given["default_value"], str) for a in launch["ARGUMENTS"])
    assert all(a.given["default_value"] in a.given["choices"] for a in launch["ARGUMENTS"] if "choices" in a.given)
    assert len(launch["generate_launch_description"]()) == len(names) + 1


def test_live_without_a_scene_labels_nothing(launch: Launch) -> None:
    found = nodes(started(launch))
    assert list(found) == ["preproc", "infer"]
    assert all(parameters(n)["use_sim_time"] is False and n.given["respawn"] for n in found.values())


def test_a_scene_starts_the_labels_in_the_robots_namespace(launch: Launch) -> None:
    found = nodes(started(launch, scene="cell/scene.yaml", namespace="spot", infer="false"))
    assert list(found) == ["preproc", "sim_label"]
    assert parameters(found["sim_label"])["live.scene"] == "cell/scene.yaml"
    assert {n.given["namespace"] for n in found.values()} == {"spot"}


def test_what_works_on_request_is_started_on_request_and_gets_the_scene(launch: Launch) -> None:
    found = nodes(started(launch, scene="s", correct="true", inspect="true", gap="true"))
    assert list(found) == [name for name in NODES if name != "sensor"]  # which simulates a camera: simulator.launch.py
    assert {name for name, n in found.items() if parameters(n).get("live.scene") == "s"} == {"sim_label", "correct", "inspect", "gap"}
    assert "live.scene" not in parameters(nodes(started(launch, correct="true"))["correct"])


def test_executables_are_nodes_and_are_not_renamed(launch: Launch) -> None:
    """`__node` would rename the transform listener, which lives in the same process."""
    found = nodes(started(launch, scene="s"))
    assert set(found) <= set(NODES)
    assert all(n.given["package"] == "toftwin" and "name" not in n.given for n in found.values())


def test_together_is_one_process_that_is_named_its_nodes(launch: Launch) -> None:
    found = nodes(started(launch, scene="s", namespace="spot", gap="true", together="true"))
    assert list(found) == ["graph"]
    assert found["graph"].given["arguments"] == ["preproc", "sim_label", "infer", "gap", "--ros-args", "--log-level", "info"]
    assert parameters(found["graph"]) == {"use_sim_time": False, "live.scene": "s"}
    assert found["graph"].given["respawn"]


def test_a_single_node_together_is_its_own_executable(launch: Launch) -> None:
    assert list(nodes(started(launch, infer="false", together="true"))) == ["preproc"]


def test_replay_plays_the_bag_with_its_clock_and_stops_with_it(launch: Launch, tmp_path: Path) -> None:
    actions = started(launch, mode="replay", bag=str(tmp_path), scene="s", rate="2.0")
    (player,) = [a for a in actions if isinstance(a, ExecuteProcess)]
    assert player.given["cmd"][:4] == ["ros2", "bag", "play", str(tmp_path)]
    assert "--clock" in player.given["cmd"]
    assert "on_exit" in player.given
    assert all(parameters(n)["use_sim_time"] is True and not n.given["respawn"] for n in nodes(actions).values())


def test_sim_time_can_be_forced_either_way(launch: Launch, tmp_path: Path) -> None:
    assert parameters(nodes(started(launch, use_sim_time="true"))["preproc"])["use_sim_time"] is True
    forced = started(launch, mode="replay", bag=str(tmp_path), use_sim_time="false")
    assert parameters(nodes(forced)["preproc"])["use_sim_time"] is False


def test_rviz_starts_with_a_config_that_exists(launch: Launch, repository: Path) -> None:
    rviz = nodes(started(launch, rviz="true"))["rviz2"]
    assert (repository / rviz.given["arguments"][1]).is_file()


@pytest.mark.parametrize(
    "wrong", [{"mode": "replay"}, {"mode": "replay", "bag": "no/such/bag"}, {"params_file": "no/such.yaml"}, {"gap": "true"}]
)
def test_a_wrong_call_starts_nothing_and_names_the_argument(launch: Launch, wrong: dict[str, str]) -> None:
    with pytest.raises(RuntimeError, match=r"(bag|params_file|gap):="):
        started(launch, **wrong)


@pytest.fixture
def simulator(repository: Path) -> Iterator[Launch]:
    share = repository / "ros_ws" / "src" / "toftwin_bringup"
    for _ in installed(share):
        yield runpy.run_path(str(share / "launch" / "simulator.launch.py"))


def simulated(launch: Launch, **given: str) -> dict[str, Node]:
    """The nodes of the simulator's launch file for some arguments."""
    defaults = {a.name: a.given["default_value"] for a in launch["ARGUMENTS"]}
    assert given.keys() <= defaults.keys()
    return nodes(launch["camera"]({**defaults, **given}))


def test_gazebo_is_bridged_and_the_camera_hears_its_topics(simulator: Launch, tmp_path: Path) -> None:
    (tmp_path / "sensor.yaml").write_text("schema: toftwin.sensor/1\neffects: []\n")
    found = simulated(simulator, model=str(tmp_path / "sensor.yaml"), depth="/rgbd/depth_image", info="/rgbd/camera_info", albedo="/grey")
    assert list(found) == ["parameter_bridge", "sensor"]
    assert "/rgbd/depth_image@sensor_msgs/msg/Image[gz.msgs.Image" in found["parameter_bridge"].given["arguments"]
    assert "/grey@sensor_msgs/msg/Image[gz.msgs.Image" in found["parameter_bridge"].given["arguments"]
    (values,) = found["sensor"].given["parameters"]
    assert values["input.depth_topic"] == "/rgbd/depth_image"
    assert values["use_sim_time"] is True
    known = {row.name for row in table(SensorNodeConfig)}
    assert set(values) - {"use_sim_time"} <= known


def test_topics_of_ros_need_no_bridge_and_a_missing_model_is_refused(simulator: Launch, tmp_path: Path) -> None:
    (tmp_path / "sensor.yaml").write_text("schema: toftwin.sensor/1\neffects: []\n")
    assert list(simulated(simulator, model=str(tmp_path / "sensor.yaml"), simulator="ros")) == ["sensor"]
    with pytest.raises(RuntimeError, match="does not exist"):
        simulated(simulator, model="nowhere.yaml")
