# SPDX-License-Identifier: Apache-2.0
"""What `ros2 run toftwin NODE` and `ros2 launch` start: one node a process, with the arguments as ROS gives them."""

from __future__ import annotations

import sys
from dataclasses import dataclass

from toftwin.graph import GraphSpec, run_graph


@dataclass(frozen=True, slots=True)
class RosCall(GraphSpec):
    """A graph whose ROS arguments were written by somebody else: names, remappings, parameter files."""

    arguments: tuple[str, ...] = ()

    def ros_args(self) -> list[str]:
        """What came after `--ros-args`."""
        return list(self.arguments)


def called(node: str, argv: list[str]) -> RosCall:
    """The call as `ros2 run` makes it: everything but `--ros-args` itself, which `ros_context` puts back. It reaches as far as every node does."""
    return RosCall((node,), safe=False, arguments=tuple(a for a in argv if a != "--ros-args"))


def _main(node: str) -> int:
    from toftwin.cli import report

    try:
        return run_graph(called(node, sys.argv[1:]))
    except (Exception, KeyboardInterrupt) as error:  # noqa: BLE001
        return report(error)


def preproc() -> int:
    """Accumulate and filter."""
    return _main("preproc")


def sim_label() -> int:
    """Align and label."""
    return _main("sim_label")


def infer() -> int:
    """Repair live depth."""
    return _main("infer")


def correct() -> int:
    """Propose corrections of the arm."""
    return _main("correct")


def inspect() -> int:
    """Judge whether every part is there."""
    return _main("inspect")


def gap() -> int:
    """Watch the gap between camera and simulation."""
    return _main("gap")


def sensor() -> int:
    """Simulate a camera on ideal depth."""
    return _main("sensor")
