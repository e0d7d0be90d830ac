# SPDX-License-Identifier: Apache-2.0
"""A real camera in a simulator: `ros2 launch toftwin_bringup simulator.launch.py model:=sensor.yaml simulator:=gz depth:=/depth_camera`."""
# ruff: noqa: INP001

from __future__ import annotations

from pathlib import Path
from typing import Any

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

ARGUMENTS = (
    DeclareLaunchArgument("model", default_value="", description="sensor.yaml of the camera, from `toftwin gap`"),
    DeclareLaunchArgument(
        "simulator",
        default_value="gz",
        choices=("gz", "ros"),
        description="gz: bridge Gazebo's topics to ROS; ros: they are ROS topics already (Isaac Sim)",
    ),
    DeclareLaunchArgument("depth", default_value="/depth_camera", description="ideal depth image, metres along the optical axis"),
    DeclareLaunchArgument("info", default_value="/camera_info", description="its calibration"),
    DeclareLaunchArgument(
        "albedo", default_value="", description="albedo or amplitude image (light:=amplitude); empty: one albedo for all"
    ),
    DeclareLaunchArgument(
        "albedo_per_count", default_value="1.0", description="albedo of one count of the albedo image; 0.0039 for 8 bits"
    ),
    DeclareLaunchArgument("normals", default_value="", description="images of unit normals, 32FC3; empty: from the depth"),
    DeclareLaunchArgument("light", default_value="albedo", choices=("albedo", "amplitude"), description="what the image of albedo:= holds"),
    DeclareLaunchArgument(
        "scene", default_value="", description="scene.yaml of the cell; needs TF from the cell to the camera's optical frame"
    ),
    DeclareLaunchArgument("seed", default_value="0", description="seed of noise, losses and edges"),
    DeclareLaunchArgument("namespace", default_value="", description="namespace of the outputs sensor/depth, sensor/amplitude"),
)


def generate_launch_description() -> LaunchDescription:
    """Arguments, then the bridge and the node."""
    return LaunchDescription([*ARGUMENTS, OpaqueFunction(function=camera)])


def camera(context: LaunchContext) -> list[Any]:
    """The actions, once the arguments are known."""
    given = {a.name: LaunchConfiguration(a.name).perform(context) for a in ARGUMENTS}
    if not Path(given["model"]).is_file():
        raise RuntimeError(f"model:='{given['model']}' does not exist; it is the sensor.yaml that `toftwin gap` writes")
    return [*([bridge(given)] if given["simulator"] == "gz" else []), sensor(given)]


def bridge(given: dict[str, str]) -> Node:
    """Gazebo to ROS, one way; /clock too, so that stamps and clock agree."""
    images = [f"{given[name]}@sensor_msgs/msg/Image[gz.msgs.Image" for name in ("depth", "albedo") if given[name]]
    topics = [*images, f"{given['info']}@sensor_msgs/msg/CameraInfo[gz.msgs.CameraInfo", "/clock@rosgraph_msgs/msg/Clock[gz.msgs.Clock"]
    return Node(package="ros_gz_bridge", executable="parameter_bridge", arguments=topics, output="screen")


def sensor(given: dict[str, str]) -> Node:
    """The simulated camera."""
    parameters: dict[str, Any] = {
        "sensor.model": given["model"],
        "sensor.seed": int(given["seed"]),
        "sensor.light": given["light"],
        "sensor.albedo_per_count": float(given["albedo_per_count"]),
        "input.depth_topic": given["depth"],
        "input.info_topic": given["info"],
        "input.amplitude_topic": given["albedo"] or "none",
        "live.normals_topic": given["normals"],
        "live.scene": given["scene"],
        "use_sim_time": given["simulator"] == "gz",
    }
    return Node(package="toftwin", executable="sensor", namespace=given["namespace"], output="screen", parameters=[parameters])
