# SPDX-License-Identifier: Apache-2.0
"""Installs launch files, parameters and views where `ros2 launch` looks for them."""
# ruff: noqa: INP001

from setuptools import setup

SHARE = "share/toftwin_bringup"

setup(
    name="toftwin_bringup",
    version="0.1.0",
    description="Launch files, parameters, RViz and Foxglove views of the toftwin graph",
    license="Apache-2.0",
    packages=["toftwin_bringup"],
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/toftwin_bringup"]),
        (SHARE, ["package.xml"]),
        (f"{SHARE}/launch", ["launch/graph.launch.py", "launch/simulator.launch.py"]),
        (f"{SHARE}/config", ["config/graph.yaml"]),
        (f"{SHARE}/rviz", ["rviz/graph.rviz"]),
        (f"{SHARE}/foxglove", ["foxglove/graph.json"]),
    ],
    zip_safe=False,
)
