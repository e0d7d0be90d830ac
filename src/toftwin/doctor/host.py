# SPDX-License-Identifier: Apache-2.0
"""Checks of this host: Python, ROS and its middleware, ray casters, ONNX providers, system libraries."""

from __future__ import annotations

import ctypes
import importlib
import os
import platform
import sys
from importlib import metadata
from typing import TYPE_CHECKING

from toftwin.doctor.finding import fix, note, ok

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from toftwin.doctor.finding import Finding

PYTHONS = ((3, 11), (3, 12))
LIBRARIES = {"libgomp.so.1": "libgomp1", "libGL.so.1": "libgl1", "libX11.so.6": "libx11-6", "libEGL.so.1": "libegl1"}
"""Libraries that wheels link but do not contain, each with its Debian package."""
CASTERS = {"embreex": "embreex", "open3d": "open3d"}


def examine_host() -> Iterator[Finding]:
    """All checks that need no bag."""
    yield python()
    yield from middleware()
    yield discovery(dict(os.environ))
    yield from ray_casters()
    yield onnx_providers()
    yield from libraries()


def python(version: tuple[int, int] | None = None) -> Finding:
    """Wheels and ROS exist for this version of Python."""
    version = version or (sys.version_info.major, sys.version_info.minor)
    named = f"Python {version[0]}.{version[1]} on {platform.machine()}"
    if version in PYTHONS:
        return ok("python", named)
    return fix("python", f"{named} is not 3.11 or 3.12", "PYTHON=python3.11 make setup")


def middleware() -> Iterator[Finding]:
    """rclpy can be imported, has a middleware, and runs callbacks."""
    from tof_ros.survey import middleware_name

    try:
        name = middleware_name()
    except ImportError as error:
        yield fix(
            "ROS", f"rclpy cannot be imported ({error})", "run make setup, or source /opt/ros/jazzy/setup.sh first and then make setup"
        )
        return
    from tof_ros.environment import rclpy_version
    from tof_ros.trial import try_here

    sourced = os.environ.get("ROS_DISTRO", "")
    if sourced and sourced != "jazzy":
        yield fix("ROS", f"ROS {sourced} is sourced", "open a shell without it; its bags and topics are read by Jazzy's rclpy all the same")
    else:
        yield ok("ROS", f"rclpy {rclpy_version()} over {name}, {'sourced Jazzy' if sourced else 'from pip'}")
    yield executor(try_here())


def executor(failures: dict[str, str]) -> Finding:
    """The executor that runs the nodes; `failures`: why an executor does not work on this host, the graph's own first."""
    (own, why), (fallback, nothing_works) = failures.items()
    if not why:
        return ok("executor", f"{own} runs guards, timers, messages, services and coroutines")
    if nothing_works:
        return fix(
            "executor",
            f"no node can run: {nothing_works}",
            "reinstall ROS: make clean setup, or apt-get install --reinstall ros-jazzy-rclpy",
        )
    return note(
        "executor",
        f"rclpy's {fallback} runs the nodes, a third dearer per message; the graph's {own} does not work here: {why}",
        "install a newer toftwin",
    )


def discovery(environment: Mapping[str, str]) -> Finding:
    """Range of discovery: without a setting, robots on other hosts are not found."""
    from tof_ros.environment import REACH, REACH_CHOICES, reach

    if not any(environment.get(name) for name in REACH_CHOICES):
        environment = {**environment, REACH: "LOCALHOST"}
    if environment.get(REACH) == "LOCALHOST":
        todo = f"{REACH}=SUBNET hears a robot on the network, ROS_STATIC_PEERS=ROBOT too; ros2 run and ros2 launch reach as far as every node does"
        return note("discovery", reach(environment), todo)
    return ok("discovery", reach(environment))


def ray_casters() -> Iterator[Finding]:
    """One ray caster is enough; labels need it."""
    found = {name: _version(name) for name in CASTERS}
    works = {name: version for name, version in found.items() if version}
    if not works:
        yield fix("ray casting", "neither embreex nor open3d can be imported", "pip install embreex (aarch64: pip install open3d)")
        return
    yield ok("ray casting", ", ".join(f"{name} {version}" for name, version in works.items()))
    if "embreex" not in works:
        yield note("ray casting", "embreex cannot be imported; open3d stands in", "pip install embreex where a wheel exists")


def onnx_providers() -> Finding:
    """Inference needs onnxruntime; a GPU's provider is named where there is one."""
    if not _version("onnxruntime"):
        return fix("ONNX", "onnxruntime cannot be imported", "pip install onnxruntime (or onnxruntime-gpu)")
    providers = importlib.import_module("onnxruntime").get_available_providers()
    return ok("ONNX", ", ".join(name.removesuffix("ExecutionProvider") for name in providers))


def libraries() -> Iterator[Finding]:
    """System libraries that wheels link."""
    missing = {library: package for library, package in LIBRARIES.items() if not _loads(library)}
    if missing:
        yield fix("libraries", f"the linker does not find {', '.join(missing)}", f"apt-get install {' '.join(sorted(missing.values()))}")
    else:
        yield ok("libraries", f"{len(LIBRARIES)} of {len(LIBRARIES)} system libraries found")


def _version(package: str) -> str:
    """Version of a package, empty if it cannot be imported."""
    try:
        importlib.import_module(package)
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "(version unknown)"
    except (ImportError, OSError):
        return ""


def _loads(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True
