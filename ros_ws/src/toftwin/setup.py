# SPDX-License-Identifier: Apache-2.0
"""The repository's `src/` as a ROS package; name, version and sources are the same as pip's."""
# ruff: noqa: INP001

import tomllib
from pathlib import Path

from setuptools import find_packages, setup

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[2]
# A link to the repository's src/: `colcon build --symlink-install` (setuptools' develop) takes no path that leaves the package.
SOURCES = "src"
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
EXECUTABLES = ("graph", "preproc", "sim_label", "infer", "correct", "inspect", "gap", "sensor")

setup(
    name="toftwin",
    version=PROJECT["project"]["version"],
    description=PROJECT["project"]["description"],
    license="Apache-2.0",
    package_dir={"": SOURCES},
    packages=find_packages(str(HERE / SOURCES)),
    # What pyproject.toml calls "*" (every package) is "" here.
    package_data={"": PROJECT["tool"]["setuptools"]["package-data"]["*"]},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/toftwin"]),
        ("share/toftwin", ["package.xml"]),
    ],
    zip_safe=False,
    entry_points={"console_scripts": ["toftwin = toftwin.cli:main", *(f"{name} = toftwin.executables:{name}" for name in EXECUTABLES)]},
)
