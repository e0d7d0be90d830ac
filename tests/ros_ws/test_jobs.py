# SPDX-License-Identifier: Apache-2.0
"""The jobs on real ROS installations: images, scripts, tests and commands that they name are there. None of it is run here."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
from typing import TYPE_CHECKING, Any

import pytest
import yaml

from toftwin.cli import build_parser
from toftwin.graph import NODES

if TYPE_CHECKING:
    from pathlib import Path

JOBS = {"jazzy": "native.sh", "humble": "peers.sh", "kilted": "peers.sh"}
WITHOUT_ROS = {"wheels": "wheels.sh"}
SCRIPTS = sorted({*JOBS.values(), *WITHOUT_ROS.values()})


@pytest.fixture(scope="module")
def jobs(repository: Path) -> dict[str, Any]:
    found: dict[str, Any] = yaml.safe_load((repository / ".ci" / "ros.yml").read_text())
    return found


@pytest.mark.parametrize("name", JOBS)
def test_each_distribution_has_a_job_on_its_image(name: str, jobs: dict[str, Any], repository: Path) -> None:
    job = jobs[name]
    assert job["image"] == f"ros:{name}-ros-base"
    assert jobs[job["extends"]]["stage"] in jobs["stages"]
    (call,) = [shlex.split(line) for line in job["script"] if line.startswith(".ci/")]
    assert call[0] == f".ci/ros/{JOBS[name]}"
    assert call[1:] == ([name] if JOBS[name] == "peers.sh" else [])
    assert os.access(repository / call[0], os.X_OK)


def test_no_job_is_left_out_of_these_tests(jobs: dict[str, Any]) -> None:
    assert {name for name in jobs if not name.startswith(".")} - {"stages"} == {*JOBS, *WITHOUT_ROS}


def test_the_newest_wheels_run_on_a_python_that_they_exist_for(jobs: dict[str, Any], repository: Path) -> None:
    job = jobs["wheels"]
    assert job["image"].startswith("python:3.11")
    assert job["script"] == [".ci/ros/wheels.sh"]
    assert os.access(repository / job["script"][0], os.X_OK)
    wanted = (repository / ".ci" / "ros" / "kilted.txt").read_text()
    assert "ros-kilted-rclpy[fastrtps]==" in wanted
    assert "jazzy" not in wanted


@pytest.mark.parametrize("script", SCRIPTS)
def test_a_script_is_shell_and_names_what_exists(script: str, repository: Path) -> None:
    path = repository / ".ci" / "ros" / script
    assert subprocess.run(["sh", "-n", str(path)], check=False).returncode == 0
    text = path.read_text()
    named = re.findall(r"(?<![\w/])(?:tests|ros_ws)/[\w/.]+", text)
    built = {"ros_ws/install/setup.sh"}
    assert [name for name in named if name not in built and not (repository / name).exists()] == []
    targets = re.findall(r"^(?:clean )?make ([\w-]+)", text, re.MULTILINE)
    assert targets
    makefile = (repository / "Makefile").read_text()
    assert [t for t in targets if not re.search(rf"^{t}:", makefile, re.MULTILINE)] == []


@pytest.mark.parametrize("script", sorted(set(JOBS.values())))
def test_every_toftwin_command_of_a_script_is_one(script: str, repository: Path) -> None:
    lines = re.findall(r"\.venv/bin/toftwin (.+)", (repository / ".ci" / "ros" / script).read_text())
    assert lines
    for line in lines:
        words = shlex.split(line.removesuffix("&"))
        build_parser(words[0]).parse_args(words)


def test_the_nodes_that_peers_drive_are_nodes(repository: Path) -> None:
    text = (repository / ".ci" / "ros" / "peers.sh").read_text()
    assert set(re.findall(r"ros2 lifecycle set /(\w+)", text)) <= set(NODES)
