# SPDX-License-Identifier: Apache-2.0
"""The life cycle of a node that loads something, over DDS: what fails is said and can be mended without a restart."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

from tests.tof_ros.peers import Observer, wait_for

pytest.importorskip("rclpy", reason="no ROS 2 here")

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

pytestmark = pytest.mark.dds


@pytest.fixture
def started(ros_domain: int) -> Iterator[Callable[..., tuple[Any, Observer]]]:
    from contextlib import ExitStack

    from tof_infer.node import make_node
    from tof_ros.environment import parameter_overrides, ros_context
    from tof_ros.spin import spinning

    with ExitStack() as stack:
        context = stack.enter_context(ros_context(domain=ros_domain))

        def start(**values: Any) -> tuple[Any, Observer]:
            overrides = parameter_overrides({name.replace("__", "."): value for name, value in values.items()})
            node = make_node(context=context, parameter_overrides=overrides)
            observer = Observer(context)
            stack.enter_context(spinning([node, observer.node]))
            return node, observer

        yield start


def change(observer: Observer, label: str) -> bool:
    """Ask the node for a transition."""
    from lifecycle_msgs.msg import Transition
    from lifecycle_msgs.srv import ChangeState

    request = ChangeState.Request(transition=Transition(id=getattr(Transition, f"TRANSITION_{label.upper()}")))
    return bool(observer.call(ChangeState, "infer/change_state", request).success)


def state(observer: Observer) -> str:
    from lifecycle_msgs.srv import GetState

    return str(observer.call(GetState, "infer/get_state").current_state.label)


def put(observer: Observer, name: str, value: str | int) -> Any:
    from rcl_interfaces.srv import SetParameters
    from rclpy.parameter import Parameter

    request = SetParameters.Request(parameters=[Parameter(name, value=value).to_parameter_msg()])
    return observer.call(SetParameters, "infer/set_parameters", request).results[0]


def test_a_model_that_is_missing_leaves_the_node_unconfigured_until_it_is_set_right(started: Callable[..., tuple[Any, Observer]]) -> None:
    from diagnostic_msgs.msg import DiagnosticStatus

    _, observer = started(infer__model="no/such.onnx")
    status = observer.status("infer", lambda s: s.level == DiagnosticStatus.ERROR)
    assert "not configured" in status.message
    assert "there is no such model" in status.message
    assert state(observer) == "unconfigured"
    assert not change(observer, "configure")
    assert put(observer, "infer.model", "default").successful
    assert change(observer, "configure")
    assert state(observer) == "inactive"
    assert change(observer, "activate")
    values = observer.values("infer", lambda v: v.get("state") == "active")
    assert values["model"] == "default.onnx"
    assert observer.statuses["infer"][-1].level != DiagnosticStatus.ERROR


def test_it_starts_by_itself_and_goes_through_all_states(started: Callable[..., tuple[Any, Observer]]) -> None:
    node, observer = started()
    wait_for(lambda: node.active)
    assert state(observer) == "active"
    assert observer.node.count_subscribers("/depth/hand/image") == 1
    held = put(observer, "infer.model", "other.onnx")
    assert not held.successful
    assert "while the node is unconfigured" in held.reason
    assert change(observer, "deactivate")
    wait_for(lambda: observer.node.count_subscribers("/depth/hand/image") == 0)
    refused = observer.trigger("infer/flush")
    assert (refused.success, "the node is inactive" in refused.message) == (False, True)
    assert change(observer, "cleanup")
    assert put(observer, "infer.threads", 1).successful
    assert change(observer, "configure")
    assert change(observer, "activate")
    assert observer.trigger("infer/flush").success
    assert change(observer, "active_shutdown")
    assert state(observer) == "finalized"


def test_without_autostart_it_waits_and_an_impossible_transition_is_answered(started: Callable[..., tuple[Any, Observer]]) -> None:
    _, observer = started(live__autostart=False)
    assert state(observer) == "unconfigured"
    assert not change(observer, "activate")
    assert "unconfigured: nothing is heard" in observer.status("infer").message
    assert change(observer, "configure")


def test_a_destroyed_node_is_gone_from_the_graph_at_once(ros_domain: int) -> None:
    import gc

    from tof_infer.node import make_node
    from tof_ros.environment import ros_context
    from tof_ros.spin import spinning

    with ros_context(domain=ros_domain) as elsewhere:
        observer = Observer(elsewhere)
        gc.disable()
        try:
            with ros_context(domain=ros_domain) as context, spinning([make_node(context=context)]):
                wait_for(lambda: observer.node.count_services("infer/change_state") == 1)
            wait_for(lambda: observer.node.get_node_names() == ["observer"], 10.0)
        finally:
            gc.enable()
            observer.node.destroy_node()


def test_a_node_that_is_stopped_while_it_loads_ends_without_a_word(ros_domain: int, monkeypatch: pytest.MonkeyPatch) -> None:
    from tof_infer.node import InferNode, make_node
    from tof_ros.environment import ros_context

    with ros_context(domain=ros_domain) as context:
        node = make_node(context=context)
        load = InferNode.load

        def interrupted(self: Any) -> None:
            load(self)
            self.destroy_node()

        monkeypatch.setattr(InferNode, "load", interrupted)
        node._autostart()
        assert not node.active


def test_an_activation_that_fails_half_way_says_so_and_leaves_nothing_behind(ros_domain: int, monkeypatch: pytest.MonkeyPatch) -> None:
    from arm_correction.node import make_node
    from tof_ros.environment import parameter_overrides, ros_context
    from tof_ros.managed import FAILURE, SUCCESS

    with ros_context(domain=ros_domain) as context:
        node = make_node(context=context, parameter_overrides=parameter_overrides({"live.connect": "arm pose"}))
        idle = set(node.subscriptions)
        assert node.trigger_configure() == SUCCESS
        assert node.trigger_activate() == FAILURE
        assert node.trouble.startswith("not activated: InvalidTopicNameException: ")
        assert (node.state, set(node.subscriptions), tf_threads()) == ("inactive", idle, [])
        monkeypatch.setattr(node, "start", lambda: None)
        assert node.trigger_activate() == SUCCESS
        assert (node.state, node.trouble) == ("active", "")
        monkeypatch.undo()
        node.active = False
        node.destroy_node()


def tf_threads() -> list[str]:
    import threading

    return [t.name for t in threading.enumerate() if t.name.endswith("_tf")]


class Manager:
    """The other side of a bond, as nav2's lifecycle manager has it."""

    def __init__(self, node: Any, of: str) -> None:
        from bond.msg import Status

        from tof_ros import qos

        self.of, self.kind = of, Status
        self.beats: list[Any] = []
        self._publisher = node.create_publisher(Status, "bond", qos.OUTPUT)
        node.create_subscription(Status, "bond", self._take, qos.RECORD)

    def _take(self, message: Any) -> None:
        if message.id == self.of and message.instance_id != "manager":
            self.beats.append(message)

    def say(self, *, active: bool) -> None:
        self._publisher.publish(self.kind(id=self.of, instance_id="manager", active=active, heartbeat_timeout=4.0, heartbeat_period=0.25))

    @property
    def last(self) -> bool | None:
        """Whether the last beat was one of a living node."""
        return bool(self.beats[-1].active) if self.beats else None


def test_a_bond_beats_while_the_node_is_active_and_ends_with_it(started: Callable[..., tuple[Any, Observer]]) -> None:
    pytest.importorskip("bond.msg", reason="bond is not built here")
    node, observer = started(live__bond_s=0.05, live__autostart=False)
    manager = Manager(observer.node, "infer")
    assert change(observer, "configure")
    assert manager.beats == []
    assert change(observer, "activate")
    wait_for(lambda: len(manager.beats) > 5)
    assert {beat.instance_id for beat in manager.beats} == {manager.beats[0].instance_id}
    assert (manager.beats[0].active, manager.beats[0].heartbeat_period) == (True, pytest.approx(0.05))
    node.restart()
    manager.beats.clear()
    wait_for(lambda: len(manager.beats) > 2)
    assert all(beat.active for beat in manager.beats)
    assert change(observer, "deactivate")
    wait_for(lambda: manager.last is False)
    assert change(observer, "activate")
    wait_for(lambda: manager.last is True)
    manager.say(active=False)
    wait_for(lambda: manager.last is False)
    assert state(observer) == "active"
