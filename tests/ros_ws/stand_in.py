# SPDX-License-Identifier: Apache-2.0
"""A stand-in of `launch` for hosts without it: keeps what a launch file asks for, and runs nothing."""

from __future__ import annotations

import sys
from types import ModuleType
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path


class Action:
    """Any action: its keyword arguments, and the first positional one as `name`."""

    def __init__(self, name: Any = "", **given: Any) -> None:
        self.name, self.given = name, given


class Node(Action):
    """A node that would be started."""


class ExecuteProcess(Action):
    """A process that would be started."""


class LaunchConfiguration:
    """The value of an argument."""

    def __init__(self, name: str) -> None:
        self.name = name

    def perform(self, context: Mapping[str, str]) -> str:
        """What the user gave."""
        return context[self.name]


def installed(share: Path) -> Iterator[None]:
    """The stand-in as importable modules; the package's share folder is `share`."""
    contents: dict[str, dict[str, Any]] = {
        "ament_index_python": {},
        "ament_index_python.packages": {"get_package_share_directory": lambda _: str(share)},
        "launch": {"LaunchDescription": list, "LaunchContext": dict},
        "launch.actions": {name: type(name, (Action,), {}) for name in ("DeclareLaunchArgument", "OpaqueFunction", "Shutdown")}
        | {"ExecuteProcess": ExecuteProcess},
        "launch.substitutions": {"LaunchConfiguration": LaunchConfiguration},
        "launch_ros": {},
        "launch_ros.actions": {"Node": Node},
    }
    with pytest.MonkeyPatch.context() as patch:
        for name, members in contents.items():
            module = ModuleType(name)
            for key, value in members.items():
                setattr(module, key, value)
            patch.setitem(sys.modules, name, module)
        yield
