# SPDX-License-Identifier: Apache-2.0
"""Several nodes in one process, the same as `ros2 run` starts one by one."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tof_core.cores import one_thread
from tof_core.errors import ToftwinError, UsageError
from tof_core.memory import keep_freed

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from toftwin.given import Addressed

NODES = {
    "preproc": "tof_preproc.node",
    "sim_label": "tof_sim_label.node",
    "infer": "tof_infer.node",
    "correct": "arm_correction.node",
    "inspect": "tof_inspect.node",
    "gap": "tof_gap.node",
    "sensor": "tof_sensor.node",
}
"""Every node of the graph and the module whose `make_node` makes it."""
DONE = {
    "preproc": "preproc/done",
    "sim_label": "label/done",
    "infer": "infer/done",
    "correct": "correction/done",
    "inspect": "inspect/done",
    "gap": "gap/done",
    "sensor": "sensor/done",
}
"""Topic on which each node reports the fate of a frame."""
PLACED = ("sim_label", "correct", "inspect", "gap")
"""Nodes that need the pose of the cell."""
WITH_SCENE = (*PLACED, "sensor")
"""Nodes that need the CAD."""


@dataclass(frozen=True, slots=True)
class GraphSpec:
    """The nodes to run, and their settings.

    `parameters` are by node and dotted name; `remaps` are (from, to) for all nodes. A node with wrong parameters waits until they
    are corrected; with `strict` it ends the graph. `safe` keeps to this host unless the environment says otherwise.
    """

    nodes: tuple[str, ...]
    parameters: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    remaps: tuple[tuple[str, str], ...] = ()
    namespace: str = ""
    use_sim_time: bool = False
    params_files: tuple[str, ...] = ()
    strict: bool = False
    safe: bool = True

    def __post_init__(self) -> None:
        """Refuse unknown node names."""
        for name in self.nodes:
            if name not in NODES:
                raise UsageError(f"'{name}' is no node", where="node", todo=f"nodes are {', '.join(NODES)}")

    @property
    def elsewhere(self) -> tuple[str, ...]:
        """Nodes that may run in other processes with the same parameter files."""
        return ()

    def ros_args(self) -> list[str]:
        """ROS arguments for all nodes, as after `--ros-args`."""
        out = [a for source, target in self.remaps for a in ("-r", f"{source}:={target}")]
        out += [a for path in self.params_files for a in ("--params-file", path)]
        if self.namespace:
            out += ["-r", f"__ns:=/{self.namespace.strip('/')}"]
        return [*out, "-p", "use_sim_time:=true"] if self.use_sim_time else out

    def command(self) -> list[str]:
        """The command line that runs this graph in another process."""
        parameters = [f"{node}.{name}={_text(value)}" for node, values in self.parameters.items() for name, value in values.items()]
        flags = [a for p in parameters for a in ("--param", p)]
        flags += [a for source, target in self.remaps for a in ("--remap", f"{source}:={target}")]
        flags += [a for path in self.params_files for a in ("--params-file", path)]
        flags += ["--namespace", self.namespace] if self.namespace else []
        flags += ["--use-sim-time"] if self.use_sim_time else []
        flags += ["--strict"] if self.strict else []
        return [sys.executable, "-m", "toftwin.cli", "node", *self.nodes, *flags]


def _text(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


def run_graph(spec: GraphSpec) -> int:
    """Run the nodes in this process until SIGINT or SIGTERM; 1 if a node died."""
    one_thread()  # read when NumPy is imported, below
    keep_freed()
    from tof_ros.environment import REACH, parameter_overrides, reach, ros_context
    from tof_ros.spin import spinning
    from toftwin.given import refuse_unknown

    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    with ros_context(spec.ros_args(), safe=spec.safe, alone=True) as context:
        nodes = []
        for name in spec.nodes:
            given = spec.parameters.get(name, {})
            refuse_unknown(given, _addressed(name, name))
            nodes.append(import_module(NODES[name]).make_node(context=context, parameter_overrides=parameter_overrides(given)))
        _warn_of_ignored(spec, nodes)
        with spinning(nodes) as spinners:
            _say(f"hears {reach(os.environ)}{HOW_TO_REACH if os.environ.get(REACH) == 'LOCALHOST' else ''}")
            begun, reported = time.monotonic(), False
            while not stop.wait(0.2):
                dead = [s for s in spinners if not s.alive]
                if dead:
                    raise dead[0].error or ToftwinError("stopped", where=dead[0].node.get_name())
                troubled = [n for n in nodes if n.trouble]
                if spec.strict and troubled:
                    raise ToftwinError(troubled[0].trouble, where=troubled[0].get_name())
                reported = reported or _say_running(nodes, time.monotonic() - begun)
    return 0


def _addressed(name: str, full_name: str) -> Addressed:
    """A node of this graph by its full name, with the names of its parameters."""
    from tof_core.config import table
    from toftwin.given import Addressed

    return Addressed(full_name, tuple(info.name for info in table(import_module(NODES[name]).CONFIG)))


def _warn_of_ignored(spec: GraphSpec, nodes: Sequence[Any]) -> None:
    """Each node names, in its log and its diagnostics, what it was given in vain."""
    from toftwin.given import ignored, sections_of

    addressed = [_addressed(name, node.get_fully_qualified_name()) for name, node in zip(spec.nodes, nodes, strict=True)]
    found = ignored(sections_of(spec.ros_args()), addressed, spec.elsewhere)
    for node in nodes:
        node.warns.append(partial(list, found[node.get_fully_qualified_name()]))


HOW_TO_REACH = "; ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET hears a robot on the network"
SOON_S = 5.0
"""A node that is not active after this time is reported with what it waits for."""


def _say(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


def _say_running(nodes: Sequence[Any], seconds: float) -> bool:
    """Report once that all nodes are active, or, after a while, which are not; true when reported."""
    waiting = {n.get_name(): n.state for n in nodes if not getattr(n, "active", True)}
    if waiting and seconds < SOON_S:
        return False
    if waiting:
        _say(f"not active yet: {', '.join(f'{name} ({state})' for name, state in waiting.items())}")
    else:
        _say(f"running: {', '.join(n.get_name() for n in nodes)}")
    return True


class GraphProcess:
    """A graph that runs in a process of its own."""

    def __init__(self, spec: GraphSpec, domain: int) -> None:
        """Start the process in a ROS domain, with discovery on this host alone unless the environment says otherwise."""
        environment = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", **os.environ, "ROS_DOMAIN_ID": str(domain)}
        self.process = subprocess.Popen(spec.command(), stdin=subprocess.DEVNULL, env=environment)  # noqa: S603  (our own command)

    def alive(self) -> bool:
        """Whether the process runs."""
        return self.process.poll() is None

    def stop(self) -> int:
        """Terminate the process, and kill it after ten seconds; returns its exit code."""
        if self.alive():
            self.process.terminate()
        try:
            return self.process.wait(10)
        except subprocess.TimeoutExpired:
            self.process.kill()
            return self.process.wait()

    def memory_bytes(self) -> int:
        """Largest resident memory of the process so far."""
        try:
            lines = Path(f"/proc/{self.process.pid}/status").read_text(encoding="ascii").splitlines()
        except OSError:
            return 0
        return next((int(line.split()[1]) * 1024 for line in lines if line.startswith("VmHWM")), 0)

    def cpu_seconds(self) -> float:
        """Processor time of the process so far."""
        try:
            fields = Path(f"/proc/{self.process.pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
        except OSError:
            return 0.0
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


class RunningGraph:
    """A graph that was started elsewhere; its process is unknown."""

    def alive(self) -> bool:
        """Always true: the process is unknown, and nodes that do not run give no answers."""
        return True

    def memory_bytes(self) -> int:
        """Unknown."""
        return 0

    def cpu_seconds(self) -> float:
        """Unknown."""
        return 0.0


@contextmanager
def graph_process(spec: GraphSpec, domain: int) -> Iterator[GraphProcess]:
    """Run a graph beside this process while the block runs."""
    graph = GraphProcess(spec, domain)
    try:
        yield graph
    finally:
        graph.stop()


def parse_parameters(pairs: Sequence[str], nodes: Sequence[str]) -> dict[str, dict[str, Any]]:
    """`node.name=value` texts, values in YAML's reading (3 is an integer, true a boolean)."""
    import yaml

    out: dict[str, dict[str, Any]] = {node: {} for node in nodes}
    for pair in pairs:
        key, equals, text = pair.partition("=")
        node, _, name = key.partition(".")
        if not equals or node not in out or not name:
            raise UsageError(f"'{pair}' is not NODE.NAME=VALUE", where="--param", todo=f"nodes here: {', '.join(nodes)}")
        value = yaml.safe_load(text) if text else ""
        out[node][name] = value if isinstance(value, bool | int | float | str) else text
    return out
