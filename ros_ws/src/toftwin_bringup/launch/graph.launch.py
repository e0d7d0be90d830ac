# SPDX-License-Identifier: Apache-2.0
"""The graph, live on a robot or over a bag: `ros2 launch toftwin_bringup graph.launch.py scene:=cell/scene.yaml`."""
# ruff: noqa: INP001

from __future__ import annotations

from pathlib import Path
from typing import Any

from ament_index_python.packages import get_package_share_directory
from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, OpaqueFunction, Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

SHARE = Path(get_package_share_directory("toftwin_bringup"))
TRUTH = ("true", "false")
WITH_SCENE = ("sim_label", "correct", "inspect", "gap")

ARGUMENTS = (
    DeclareLaunchArgument(
        "mode", default_value="live", choices=("live", "replay"), description="live: hear the robot; replay: play bag:= on its own clock"
    ),
    DeclareLaunchArgument(
        "bag", default_value="", description="replay: the bag's folder (for a replay without any loss use `toftwin replay`)"
    ),
    DeclareLaunchArgument("rate", default_value="1.0", description="replay: pace, as a multiple of the bag's"),
    DeclareLaunchArgument(
        "scene",
        default_value="",
        description="scene.yaml of the cell, its folder, or a built-in scene's name; without it nothing is labelled",
    ),
    DeclareLaunchArgument("infer", default_value="true", choices=TRUTH, description="run the network on live depth"),
    DeclareLaunchArgument(
        "correct", default_value="false", choices=TRUTH, description="propose corrections of the arm on request; moves nothing"
    ),
    DeclareLaunchArgument(
        "inspect", default_value="false", choices=TRUTH, description="judge the scene's parts on request (needs scene:=)"
    ),
    DeclareLaunchArgument(
        "gap", default_value="false", choices=TRUTH, description="watch the gap between camera and simulation (needs scene:=)"
    ),
    DeclareLaunchArgument("namespace", default_value="", description="namespace of the robot; topics and nodes are relative to it"),
    DeclareLaunchArgument(
        "params_file",
        default_value=str(SHARE / "config" / "graph.yaml"),
        description="ROS parameters of the nodes; copy the default and change it",
    ),
    DeclareLaunchArgument(
        "rviz", default_value="false", choices=TRUTH, description="start RViz with raw, filtered, label and inferred clouds"
    ),
    DeclareLaunchArgument(
        "use_sim_time", default_value="auto", choices=("auto", *TRUTH), description="follow /clock; auto: only in replay"
    ),
    DeclareLaunchArgument(
        "together",
        default_value="false",
        choices=TRUTH,
        description="all nodes in one process: about a tenth less processor; one that dies takes the others along",
    ),
    DeclareLaunchArgument(
        "respawn", default_value="true", choices=TRUTH, description="start a node again, a tenth of a second after it died"
    ),
    DeclareLaunchArgument("log_level", default_value="info", choices=("debug", "info", "warn", "error"), description="what the nodes log"),
)


def generate_launch_description() -> LaunchDescription:
    """Arguments, then what they ask for."""
    return LaunchDescription([*ARGUMENTS, OpaqueFunction(function=graph)])


def graph(context: LaunchContext) -> list[Any]:
    """The actions, once the arguments are known; a wrong call ends the launch in one line."""
    given = {a.name: LaunchConfiguration(a.name).perform(context) for a in ARGUMENTS}
    check(given)
    sim_time = given["mode"] == "replay" if given["use_sim_time"] == "auto" else given["use_sim_time"] == "true"
    names = wanted(given)
    actions = [node(some, given, sim_time=sim_time) for some in ([names] if given["together"] == "true" else [[name] for name in names])]
    if given["mode"] == "replay":
        actions.append(player(given))
    if given["rviz"] == "true":
        actions.append(rviz(given, sim_time=sim_time))
    return actions


def check(given: dict[str, str]) -> None:
    """Refuse what cannot work before anything starts."""
    if given["mode"] == "replay" and not (given["bag"] and Path(given["bag"]).exists()):
        raise RuntimeError(f"bag:='{given['bag']}' does not exist; mode:=replay needs a bag's folder")
    lacking = [name for name in ("inspect", "gap") if given[name] == "true" and not given["scene"]]
    if lacking:
        raise RuntimeError(f"{lacking[0]}:=true needs scene:=, the CAD of the cell")
    if not Path(given["params_file"]).is_file():
        raise RuntimeError(f"params_file:='{given['params_file']}' does not exist")


def wanted(given: dict[str, str]) -> list[str]:
    """Names of the nodes that run."""
    labels = ["sim_label"] if given["scene"] else []
    asked = [name for name in ("infer", "correct", "inspect", "gap") if given[name] == "true"]
    return ["preproc", *labels, *asked]


def node(names: list[str], given: dict[str, str], *, sim_time: bool) -> Node:
    """One process: a node by its own executable, several by `graph`. A scene is read by the nodes alone that have the parameter."""
    overrides: dict[str, Any] = {"use_sim_time": sim_time}
    if given["scene"] and set(names) & set(WITH_SCENE):
        overrides["live.scene"] = given["scene"]
    executable, arguments = (names[0], []) if len(names) == 1 else ("graph", names)
    return Node(
        package="toftwin", executable=executable, namespace=given["namespace"], output="screen", emulate_tty=True,
        parameters=[given["params_file"], overrides], arguments=[*arguments, "--ros-args", "--log-level", given["log_level"]],
        respawn=given["respawn"] == "true" and given["mode"] == "live", respawn_delay=0.1,
    )  # fmt: skip


def player(given: dict[str, str]) -> ExecuteProcess:
    """The bag with its clock; the graph stops when it ends. The delay lets everybody hear /tf_static."""
    command = [
        "ros2",
        "bag",
        "play",
        given["bag"],
        "--clock",
        "200",
        "--rate",
        given["rate"],
        "--delay",
        "5",
        "--disable-keyboard-controls",
    ]
    return ExecuteProcess(cmd=command, output="screen", on_exit=Shutdown(reason="the bag has been played"))


def rviz(given: dict[str, str], *, sim_time: bool) -> Node:
    """RViz; its topics are relative and follow the namespace."""
    return Node(package="rviz2", executable="rviz2", namespace=given["namespace"], arguments=["-d", str(SHARE / "rviz" / "graph.rviz")],
                parameters=[{"use_sim_time": sim_time}], output="log")  # fmt: skip
