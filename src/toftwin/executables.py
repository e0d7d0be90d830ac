# SPDX-License-Identifier: Apache-2.0
"""Entry points of `ros2 run toftwin NODE` and `ros2 launch`: a node, or several in one process, with ROS's arguments."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from functools import partial
from itertools import takewhile
from typing import TYPE_CHECKING

from tof_core.errors import UsageError
from toftwin.graph import NODES, GraphSpec, run_graph

if TYPE_CHECKING:
    from collections.abc import Callable


@dataclass(frozen=True, slots=True)
class RosCall(GraphSpec):
    """A graph from foreign ROS arguments: names, remappings, parameter files."""

    arguments: tuple[str, ...] = ()

    @property
    def elsewhere(self) -> tuple[str, ...]:
        """Every node: a launch file gives one parameter file to each of its processes."""
        return tuple(NODES)

    def ros_args(self) -> list[str]:
        """The text after `--ros-args`."""
        return list(self.arguments)


def called(nodes: tuple[str, ...], argv: list[str]) -> RosCall:
    """The call of an executable that `ros2 run` starts: `--ros-args` comes off, since `ros_context` adds it; the discovery range is ROS's default."""
    return RosCall(nodes, safe=False, arguments=tuple(a for a in argv if a != "--ros-args"))


def called_together(argv: list[str]) -> RosCall:
    """Arguments of several nodes: the names come before the first ROS argument."""
    names = tuple(takewhile(lambda a: not a.startswith("-"), argv))
    if not names:
        raise UsageError("no node named", where="graph", todo=f"ros2 run toftwin graph preproc infer; nodes are {', '.join(NODES)}")
    return called(names, argv[len(names) :])


def _main(call: Callable[[list[str]], RosCall]) -> int:
    from toftwin.cli import report

    try:
        return run_graph(call(sys.argv[1:]))
    except (Exception, KeyboardInterrupt) as error:  # noqa: BLE001
        return report(error)


def graph() -> int:
    """Several nodes in one process: 10 % less processor time per frame, but a crash of one ends all."""
    return _main(called_together)


def preproc() -> int:
    """Accumulate and filter."""
    return _main(partial(called, ("preproc",)))


def sim_label() -> int:
    """Align and label."""
    return _main(partial(called, ("sim_label",)))


def infer() -> int:
    """Repair live depth."""
    return _main(partial(called, ("infer",)))


def correct() -> int:
    """Propose corrections of the arm."""
    return _main(partial(called, ("correct",)))


def inspect() -> int:
    """Judge whether every part is there."""
    return _main(partial(called, ("inspect",)))


def gap() -> int:
    """Watch the gap between camera and simulation."""
    return _main(partial(called, ("gap",)))


def sensor() -> int:
    """Simulate a camera on ideal depth."""
    return _main(partial(called, ("sensor",)))
