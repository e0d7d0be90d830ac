# SPDX-License-Identifier: Apache-2.0
"""The executor is tried on the rclpy that is installed; where it does not work, rclpy's own runs the node, with one warning."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip("rclpy", reason="no ROS 2 here")
from tests.tof_ros import newer_rclpy

if TYPE_CHECKING:
    from collections.abc import Iterator

pytestmark = pytest.mark.dds


@pytest.fixture(scope="module")
def context(ros_domain: int) -> Iterator[Any]:
    from tof_ros.environment import ros_context

    with ros_context(domain=ros_domain) as context:
        yield context


def test_both_executors_run_all_that_a_node_has(context: Any) -> None:
    from rclpy.executors import SingleThreadedExecutor

    from tof_ros.executor import DirectExecutor
    from tof_ros.trial import failure

    assert failure(DirectExecutor, context) == ""
    assert failure(SingleThreadedExecutor, context) == ""


def test_the_layout_of_newer_releases_passes_the_trial(context: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    from tof_ros.executor import DirectExecutor
    from tof_ros.trial import failure

    newer_rclpy.emulate(monkeypatch)
    assert failure(DirectExecutor, context) == ""


LOST = ["_take_subscription", "_take_timer", "_take_client", "_take_service"]


@pytest.mark.parametrize("method", LOST)
def test_a_release_that_takes_a_method_away_is_noticed(method: str, context: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    from rclpy.executors import Executor

    from tof_ros.executor import DirectExecutor
    from tof_ros.trial import failure

    monkeypatch.delattr(Executor, method)
    assert method in failure(DirectExecutor, context)


def test_a_method_that_behaves_otherwise_is_noticed(context: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    from tof_ros import trial
    from tof_ros.executor import DirectExecutor

    monkeypatch.setattr(trial, "DEADLINE_S", 0.5)
    monkeypatch.setattr(DirectExecutor, "_take_subscription", lambda _self, _sub: None)
    assert trial.failure(DirectExecutor, context) == "not run within 0 s: subscription"


def test_rclpy_s_own_runs_the_node_where_ours_fails_and_one_warning_says_so(
    context: Any, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    import rclpy
    from rclpy.executors import SingleThreadedExecutor

    from tof_ros import spin
    from tof_ros.executor import DirectExecutor
    from tof_ros.trial import Choice

    class Broken(DirectExecutor):
        def spin(self) -> None:
            raise AttributeError("no attribute '_tasks'")

    monkeypatch.setattr(spin, "CHOICE", Choice(Broken))
    heard: list[int] = []
    for k in range(2):
        node = rclpy.create_node(f"fallen_back_{k}", context=context)
        spinner = spin.Spinner(node)
        assert type(node.executor) is SingleThreadedExecutor
        node.create_guard_condition(lambda k=k: heard.append(k)).trigger()
        end = time.monotonic() + 10.0
        while k not in heard and time.monotonic() < end:
            time.sleep(0.01)
        spinner.stop()
    assert heard == [0, 1]
    said = capfd.readouterr().err
    assert said.count("the graph's own executor does not work with rclpy") == 1
    assert "no attribute '_tasks'" in said


def test_the_version_of_rclpy_is_known(context: Any) -> None:
    from tof_ros.environment import rclpy_version

    assert rclpy_version()[0].isdigit()
