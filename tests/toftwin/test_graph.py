# SPDX-License-Identifier: Apache-2.0
"""Nodes of one host leave each other's cores alone."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

pytest.importorskip("rclpy", reason="no ROS 2 here")

ASK = """
import os, signal, sys, threading, time
from toftwin import graph
early = "numpy" in sys.modules
def stop():
    while signal.getsignal(signal.SIGTERM) is signal.SIG_DFL:
        time.sleep(0.01)
    os.kill(os.getpid(), signal.SIGTERM)
threading.Thread(target=stop).start()
graph.run_graph(graph.GraphSpec(()))
print(early, os.environ["OPENBLAS_NUM_THREADS"])
"""


@pytest.mark.dds
@pytest.mark.parametrize(("told", "has"), [({}, "1"), ({"OPENBLAS_NUM_THREADS": "2"}, "2")])
def test_a_node_s_linear_algebra_has_one_thread_unless_told_otherwise(told: dict[str, str], has: str) -> None:
    """NumPy reads the number when it is imported: which must be after it is set."""
    plain = {k: v for k, v in os.environ.items() if not k.endswith("_NUM_THREADS")}
    out = subprocess.run([sys.executable, "-c", ASK], env={**plain, **told}, capture_output=True, text=True, check=True, timeout=60)
    assert out.stdout.split() == ["False", has]


class Node:
    """A node of which only name and state matter."""

    def __init__(self, name: str, *, active: bool | None = None) -> None:
        self._name, self.state = name, "unconfigured"
        if active is not None:
            self.active = active

    def get_name(self) -> str:
        return self._name


def test_running_is_reported_once_all_nodes_are_active(capsys: pytest.CaptureFixture[str]) -> None:
    from toftwin.graph import SOON_S, _say_running

    preproc, label = Node("preproc"), Node("sim_label", active=False)
    assert not _say_running([preproc, label], 0.2)
    assert capsys.readouterr().err == ""
    assert _say_running([preproc, label], SOON_S)
    assert capsys.readouterr().err == "not active yet: sim_label (unconfigured)\n"
    label.active = True
    assert _say_running([preproc, label], 0.2)
    assert capsys.readouterr().err == "running: preproc, sim_label\n"
