# SPDX-License-Identifier: Apache-2.0
"""The action `diagnose` of the node `gap` over DDS: a whole diagnosis of the views that the graph published, without a bag."""

from __future__ import annotations

import json
import math
import time
from functools import partial
from typing import TYPE_CHECKING, Any

import pytest

from tests.tof_ros.peers import Observer, wait_for
from tests.tof_ros.view_source import ViewSource
from tof_core.config import from_mapping

pytest.importorskip("rclpy", reason="no ROS 2 here")
pytest.importorskip("toftwin_msgs.msg", reason="toftwin_msgs is not built here")

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from tof_core.capture import View

pytestmark = pytest.mark.dds
VIEWS = 9


@pytest.fixture(scope="module")
def views(tmp_path_factory: pytest.TempPathFactory) -> list[View]:
    """Unfiltered views of a virtual robot whose camera wiggles."""
    from tof_scene.builtin import make_builtin
    from tof_virtual.config import VirtualConfig
    from tof_virtual.record import record
    from toftwin.commands.simulate import bodies_of
    from toftwin.diagnosis import GapPipelineConfig
    from toftwin.inputs import opened
    from toftwin.pipeline import raw_views

    bag = tmp_path_factory.mktemp("session") / "bag"
    config = from_mapping(VirtualConfig, {"seed": 5, "camera.width": 112, "camera.height": 86, "plan.views": VIEWS, "plan.pause_s": 30.0})
    record(bodies_of(make_builtin("body_section")), bag, config, effects={"wiggling": 1.0})
    with opened(bag, None, GapPipelineConfig()) as (reader, _):
        return raw_views(reader, GapPipelineConfig())


def kept(node: Any, count: int) -> bool:
    return bool(node.tally.kept == count)


@pytest.fixture(scope="module")
def bench(ros_domain: int, views: list[View]) -> Iterator[tuple[Any, Observer]]:
    from tof_gap.node import make_node
    from tof_ros.environment import parameter_overrides, ros_context
    from tof_ros.spin import spinning

    with ros_context(domain=ros_domain) as context:
        node = make_node(context=context, namespace="spot", parameter_overrides=parameter_overrides({"live.scene": "body_section"}))
        observer = Observer(context)
        with spinning([node, observer.node]):
            source = ViewSource(observer.node)
            wait_for(lambda: node.active and source.matched)
            for n, view in enumerate(views):
                source.send(view, station=view.station)
                wait_for(partial(kept, node, n + 1), what=f"for view {n}; skipped {node.tally.skipped}")
                time.sleep(0.3)  # the robot moves by TF: the next pose is another one's, of another time
            yield node, observer


def test_a_diagnosis_is_cancelled_at_once(bench: tuple[Any, Observer]) -> None:
    from action_msgs.msg import GoalStatus
    from toftwin_msgs.action import Diagnose

    _, observer = bench
    acted = observer.act(Diagnose, "/spot/gap/diagnose", cancel_at="first poses")
    assert (acted.status, acted.result.success) == (GoalStatus.STATUS_CANCELED, False)
    assert acted.result.message.startswith("cancelled: first poses")


def test_it_names_the_effect_that_the_published_views_have(bench: tuple[Any, Observer], tmp_path: Path) -> None:
    from action_msgs.msg import GoalStatus
    from toftwin_msgs.action import Diagnose

    _, observer = bench
    acted = observer.act(Diagnose, "/spot/gap/diagnose", Diagnose.Goal(out=str(tmp_path / "gap")), seconds=400.0)
    assert acted.status == GoalStatus.STATUS_SUCCEEDED, acted.result.message
    found = acted.result
    assert (list(found.verdict), found.views) == (["wiggling"], VIEWS)
    assert [effect.name for effect in found.effects] == ["wiggling"]
    assert found.effects[0].explains > 0.8
    assert found.gap_after < 0.4 * found.gap_before
    assert found.shrink_low < found.shrink <= found.shrink_high
    assert json.loads((tmp_path / "gap" / "gap.json").read_text())["verdict"] == ["wiggling"]
    assert found.report == str(tmp_path / "gap" / "report.html")
    steps = [s.step for s in acted.steps]
    assert steps[0] == "first poses: depth or distance along the ray (0 to 10 % of the usual time)"
    assert steps[-1] == "advice and report (99 to 100 % of the usual time)"
    assert all(math.isfinite(s.seconds) for s in acted.steps)


def test_a_goal_that_cannot_be_worked_on_is_aborted_with_the_reason(bench: tuple[Any, Observer]) -> None:
    from action_msgs.msg import GoalStatus
    from toftwin_msgs.action import Diagnose

    node, observer = bench
    acted = observer.act(Diagnose, "/spot/gap/diagnose", Diagnose.Goal(leave_out=["wigling"]))
    assert (acted.status, acted.result.success) == (GoalStatus.STATUS_ABORTED, False)
    assert "there is no effect 'wigling'" in acted.result.message
    with node.alone():
        acted = observer.act(Diagnose, "/spot/gap/diagnose")
    assert "busy with another command" in acted.result.message
    assert node.trigger_deactivate().name == "SUCCESS"
    acted = observer.act(Diagnose, "/spot/gap/diagnose")
    assert (acted.status, "the node is inactive" in acted.result.message) == (GoalStatus.STATUS_ABORTED, True)
