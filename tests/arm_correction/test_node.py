# SPDX-License-Identifier: Apache-2.0
"""The node `correct` over DDS: proposals, refusals, and no motion unless it is connected."""

from __future__ import annotations

import time
from functools import lru_cache
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from tests.arm_correction.made import FIRST, seen, twist
from tests.tof_align.made import section
from tests.tof_ros.peers import Observer, wait_for
from tests.tof_ros.view_source import T_HAND_CAMERA, ViewSource
from tof_core import decode, se3

pytest.importorskip("rclpy", reason="no ROS 2 here")

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from tof_core.capture import View

pytestmark = pytest.mark.dds
MOTION = twist((12, -8, 10), (0.5, 0.8, -0.3))


@lru_cache(maxsize=4)
def looked(where: str) -> View:
    """A view from the first place, or from one that the robot takes for it."""
    return seen(section(), FIRST, seed=99) if where == "first" else seen(section(), FIRST @ MOTION, believed=FIRST)


class Bench:
    """A `correct` in one thread, a robot and an observer in others."""

    def __init__(self, node: Any, observer: Observer) -> None:
        from arm_correction.node import OUTPUTS
        from tof_ros import qos

        self.node, self.observer = node, observer
        self.source = ViewSource(observer.node)
        self.heard: dict[str, list[Any]] = {name: [] for name in (*OUTPUTS, "arm")}
        for name, kind in OUTPUTS.items():
            observer.node.create_subscription(kind, f"/spot/correction/{name}", self.heard[name].append, qos.OUTPUT)
        observer.node.create_subscription(OUTPUTS["delta"], "/spot/arm_pose_commands", self.heard["arm"].append, qos.OUTPUT)

    def look(self, where: str, **how: Any) -> View:
        """Send a view and wait until the node has it."""
        wait_for(lambda: self.node.active and self.source.matched)
        before = self.node.tally.kept
        view = self.source.send(looked(where), **how)
        wait_for(lambda: self.node.tally.kept > before, what=f"for a view; skipped {self.node.tally.skipped}")
        return view

    def ask(self, service: str) -> tuple[bool, str]:
        answer = self.observer.trigger(f"/spot/correct/{service}")
        return bool(answer.success), str(answer.message)


@pytest.fixture(scope="module")
def bench(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    from arm_correction.node import make_node
    from tof_ros.environment import parameter_overrides, ros_context
    from tof_ros.spin import spinning

    values = {"live.reference": str(tmp_path_factory.mktemp("reference") / "first"), "correct.limits.stale_s": 60.0}
    with ros_context(domain=ros_domain) as context:
        node = make_node(context=context, namespace="spot", parameter_overrides=parameter_overrides(values))
        observer = Observer(context)
        with spinning([node, observer.node]):
            yield Bench(node, observer)


def test_without_a_reference_the_node_reports_it(bench: Bench) -> None:
    wait_for(lambda: bench.node.active)
    assert bench.ask("propose") == (False, "preproc: no view has come yet; is preproc running, and does TF reach the camera?")
    bench.look("first")
    done, why = bench.ask("propose")
    assert (done, "capture a reference first" in why) == (False, True)
    assert "call ~/capture_reference" in bench.observer.status("spot/correct", lambda s: "no reference" in s.message).message


def test_a_proposal_leads_to_the_reference_view_and_moves_nothing(bench: Bench, tmp_path: Path) -> None:
    from arm_correction.reference import load_reference
    from tof_ros import messages

    first = bench.look("first")
    done, message = bench.ask("capture_reference")
    assert done, message
    assert load_reference(bench.node.config.live.reference).stamp_ns == first.stamp_ns
    view = bench.look("back", station=1)
    done, message = bench.ask("propose")
    assert done, message
    pose = wait_for(lambda: bench.heard["pose"])[-1]
    delta = messages.matrix(wait_for(lambda: bench.heard["delta"])[-1].pose)
    assert (pose.header.frame_id, decode.stamp_ns(pose)) == ("spot/body", view.stamp_ns)
    metres, degrees = se3.distance(FIRST @ MOTION @ se3.inverse(T_HAND_CAMERA) @ delta @ T_HAND_CAMERA, FIRST)
    assert (1e3 * metres < 1.0, degrees < 0.15) == (True, True)
    hand = se3.inverse(se3.from_quat((0.2, 0, 0), (0, 0, 0, 1))) @ FIRST @ se3.inverse(T_HAND_CAMERA)
    np.testing.assert_allclose(messages.matrix(pose.pose.pose), hand @ delta, atol=1e-6)
    assert (np.diag(pose.pose.covariance.reshape(6, 6)) > 0).all()
    verdict = bench.heard["verdict"][-1].status[0]
    assert (verdict.name, verdict.message.partition(":")[0]) == ("correction: reference", "accepted")
    assert bench.heard["arm"] == []
    assert bench.observer.node.count_publishers("/spot/arm_pose_commands") == 0


def test_the_action_gives_the_proposal_and_of_a_refused_one_the_reason(bench: Bench) -> None:
    from action_msgs.msg import GoalStatus
    from rclpy.parameter import Parameter

    kinds = pytest.importorskip("toftwin_msgs.msg", reason="toftwin_msgs is not built here")
    from toftwin_msgs.action import Propose

    from tof_ros import messages, qos

    typed: list[Any] = []
    bench.observer.node.create_subscription(kinds.CorrectionProposal, "/spot/correction/proposal", typed.append, qos.OUTPUT)
    wait_for(bench.node._proposal.get_subscription_count)
    view = bench.look("back")
    acted = bench.observer.act(Propose, "/spot/correct/propose")
    assert (acted.status, acted.result.success) == (GoalStatus.STATUS_SUCCEEDED, True), acted.result.message
    (proposal,) = acted.result.proposals
    assert (proposal.verdict, proposal.registered_to, proposal.header.frame_id) == (
        kinds.CorrectionProposal.ACCEPTED,
        "reference",
        "spot/body",
    )
    assert decode.stamp_ns(proposal) == view.stamp_ns
    metres, degrees = se3.distance(FIRST @ MOTION @ se3.inverse(T_HAND_CAMERA) @ messages.matrix(proposal.delta) @ T_HAND_CAMERA, FIRST)
    assert (1e3 * metres < 1.0, degrees < 0.15) == (True, True)
    assert proposal.distance == pytest.approx(se3.distance(np.eye(4), messages.matrix(proposal.delta))[0])
    assert [s.step for s in acted.steps] == ["register", "publish"]
    assert wait_for(lambda: typed)[-1].target == proposal.target

    assert bench.node.set_parameters([Parameter("correct.limits.stale_s", value=0.01)])[0].successful
    acted = bench.observer.act(Propose, "/spot/correct/propose")
    assert bench.node.set_parameters([Parameter("correct.limits.stale_s", value=60.0)])[0].successful
    assert (acted.status, acted.result.success) == (GoalStatus.STATUS_ABORTED, False)
    assert "stale" in acted.result.message
    assert (acted.result.proposals[0].verdict, acted.result.proposals[0].distance) == (kinds.CorrectionProposal.REFUSED, 0.0)


def test_a_stale_view_and_a_robot_that_moved_meanwhile_are_refused_with_the_reason(bench: Bench) -> None:
    from rclpy.parameter import Parameter

    assert bench.node.set_parameters([Parameter("correct.limits.stale_s", value=0.01)])[0].successful
    old = bench.look("back")
    wait_for(lambda: time.time_ns() - old.stamp_ns > 20_000_000)
    done, why = bench.ask("propose")
    assert (done, "stale: the view is" in why) == (False, True), why
    assert bench.node.set_parameters([Parameter("correct.limits.stale_s", value=60.0)])[0].successful
    view = bench.look("back")
    bench.source.place(FIRST @ twist((5, 0, 0)), view.camera.frame_id, time.time_ns() + 400_000_000)
    wait_for(lambda: bench.node._chain.transforms.latest("cell", view.camera.frame_id) > view.stamp_ns + 300_000_000)
    done, why = bench.ask("propose")
    assert (done, "moved meanwhile: by 5.0 mm" in why) == (False, True), why
    wait_for(lambda: bench.heard["verdict"][-1].status[0].message.startswith("refused: moved meanwhile"))
    assert bench.ask("reset") == (True, "the dwells are discarded, the reference is kept")


def test_the_time_of_the_registration_is_not_the_age_of_the_view(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    from rclpy.time import Time

    node, limit_s = bench.node, 60.0
    propose, clock = node._corrector.propose, node.get_clock()

    def slow(*views: Any, **how: Any) -> Any:
        late = Time(nanoseconds=clock.now().nanoseconds + round(2e9 * limit_s), clock_type=clock.clock_type)
        monkeypatch.setattr(node, "get_clock", lambda: SimpleNamespace(now=lambda: late, ros_time_is_active=False))
        return propose(*views, **how)

    bench.ask("reset")
    bench.look("back")
    monkeypatch.setattr(node._corrector, "propose", slow)
    done, message = bench.ask("propose")
    assert done, message


def test_a_proposal_that_is_cancelled_publishes_nothing(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    from action_msgs.msg import GoalStatus

    pytest.importorskip("toftwin_msgs.msg", reason="toftwin_msgs is not built here")
    from toftwin_msgs.action import Propose

    node, began = bench.node, []
    whole, propose = node._propose, node._corrector.propose

    def asked(progress: Any) -> Any:
        began.append(progress)
        return whole(progress)

    def until_cancelled(*views: Any, **how: Any) -> Any:
        wait_for(lambda: began[-1]._goal.is_cancel_requested)
        return propose(*views, **how)

    bench.ask("reset")
    bench.look("back")
    monkeypatch.setattr(node, "_propose", asked)
    monkeypatch.setattr(node._corrector, "propose", until_cancelled)
    published: list[Any] = []
    monkeypatch.setattr(node, "_publish", published.append)
    acted = bench.observer.act(Propose, "/spot/correct/propose", cancel_at="register")
    assert (acted.status, acted.result.message, published) == (GoalStatus.STATUS_CANCELED, "cancelled: register", [])


def test_two_dwells_that_disagree_are_refused(bench: Bench) -> None:
    bench.look("first")
    bench.look("back")
    done, why = bench.ask("propose")
    assert (done, "two dwells disagree" in why) == (False, True), why


def test_of_two_commands_at_once_the_second_is_refused(bench: Bench) -> None:
    from std_srvs.srv import Trigger

    bench.look("back")
    bench.look("back")
    client = bench.observer.node.create_client(Trigger, "/spot/correct/propose")
    assert client.wait_for_service(10.0)
    answers = [client.call_async(Trigger.Request()) for _ in range(2)]
    wait_for(lambda: all(a.done() for a in answers))
    results = sorted((a.result().success, a.result().message) for a in answers)
    assert [success for success, _ in results] == [False, True], results
    assert "busy with another command" in results[0][1]


def test_step_limits_can_be_tightened_live(bench: Bench) -> None:
    from rclpy.parameter import Parameter

    assert bench.node.set_parameters([Parameter("correct.limits.step_mm", value=5.0)])[0].successful
    bench.look("back")
    bench.look("back")
    done, why = bench.ask("propose")
    assert (done, "step limit" in why) == (False, True), why
    assert bench.node.set_parameters([Parameter("correct.limits.step_mm", value=400.0)])[0].successful


def test_connected_it_commands_the_hand_in_the_drivers_own_frame(bench: Bench) -> None:
    from rclpy.parameter import Parameter

    bench.node.trigger_deactivate()
    bench.node.trigger_cleanup()
    assert bench.node.set_parameters([Parameter("live.connect", value="arm_pose_commands")])[0].successful
    bench.node.trigger_configure()
    bench.node.trigger_activate()
    wait_for(lambda: bench.observer.node.count_publishers("/spot/arm_pose_commands"))
    wait_for(lambda: [p for p in bench.node.publishers if p.topic_name == "/spot/arm_pose_commands" and p.get_subscription_count()])
    bench.look("back")
    bench.look("back")
    done, message = bench.ask("propose")
    assert done, message
    assert message.endswith("sent to /spot/arm_pose_commands")
    command = wait_for(lambda: bench.heard["arm"])[-1]
    assert command.header.frame_id == "body"
    proposal = wait_for(lambda: [m for m in bench.heard["pose"] if m.pose.pose == command.pose])
    assert proposal[-1].header.frame_id == "spot/body"


def test_a_node_that_is_stopped_while_it_proposes_commands_nothing(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    corrector = bench.node._corrector
    propose = corrector.propose

    def stopped(*views: Any, **how: Any) -> Any:
        made = propose(*views, **how)
        bench.node.trigger_deactivate()
        return made

    bench.look("back")
    bench.look("back")
    before = len(bench.heard["arm"])
    monkeypatch.setattr(corrector, "propose", stopped)
    assert bench.ask("propose") == (False, "correction: stopped meanwhile, nothing was sent; activate the node and ask again")
    assert len(bench.heard["arm"]) == before
    bench.node.trigger_activate()


@pytest.mark.parametrize(("frame", "hand", "why"), [("cell", "spot/hand", "takes targets in"), ("spot/odom", "camera", "moves 'hand'")])
def test_a_target_that_the_driver_would_read_otherwise_is_refused(frame: str, hand: str, why: str) -> None:
    from arm_correction.frames import Frames
    from arm_correction.live import driver_frame
    from tof_core.errors import RefusedError

    with pytest.raises(RefusedError, match=why):
        driver_frame(Frames(frame=frame, hand=hand))
    assert driver_frame(Frames(frame="spot/odom", hand="spot/hand")) == "odom"
