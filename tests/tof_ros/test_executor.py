# SPDX-License-Identifier: Apache-2.0
"""One wait, then everything that is ready; other threads may meddle. With the installed rclpy, and with the layout of newer ones."""

from __future__ import annotations

import threading
import time
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip("rclpy", reason="no ROS 2 here")
if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rclpy.node import Node

pytestmark = pytest.mark.dds


@pytest.fixture(scope="module", params=["as installed", "as from 7.1.9 on"], autouse=True)
def layout(request: pytest.FixtureRequest) -> Iterator[None]:
    """Every test of this file runs with both."""
    from tests.tof_ros import newer_rclpy

    with pytest.MonkeyPatch.context() as patch:
        if request.param != "as installed":
            newer_rclpy.emulate(patch)
        yield


@pytest.fixture(scope="module")
def context(layout: None, ros_domain: int) -> Iterator[Any]:
    from tof_ros.environment import ros_context

    with ros_context(domain=ros_domain) as context:
        yield context


@contextmanager
def spun(context: Any, name: str) -> Iterator[tuple[Node, Any]]:
    import rclpy

    from tof_ros.spin import Spinner

    node = rclpy.create_node(name, context=context)
    spinner = Spinner(node)
    try:
        yield node, spinner
    finally:
        spinner.stop()
        assert not spinner.alive


def wait_for(done: Callable[[], object], seconds: float = 10.0) -> bool:
    end = time.monotonic() + seconds
    while not done() and time.monotonic() < end:
        time.sleep(0.01)
    return bool(done())


def test_every_message_of_every_topic_is_heard_in_order(context: Any) -> None:
    from std_msgs.msg import Header

    heard: dict[str, list[str]] = {"a": [], "b": []}
    with spun(context, "ears") as (ears, _), spun(context, "mouth") as (mouth, _):
        for topic, words in heard.items():
            ears.create_subscription(Header, topic, lambda m, words=words: words.append(m.frame_id), 100)
        out = [mouth.create_publisher(Header, topic, 100) for topic in heard]
        assert wait_for(lambda: all(p.get_subscription_count() for p in out))
        for k in range(50):
            for publisher in out:
                publisher.publish(Header(frame_id=str(k)))
        assert wait_for(lambda: all(len(words) == 50 for words in heard.values()))
    assert heard == {"a": [str(k) for k in range(50)], "b": [str(k) for k in range(50)]}


def test_a_guard_triggered_by_another_thread_is_not_missed(context: Any) -> None:
    calls: list[str] = []

    def called(times: int) -> bool:
        return len(calls) == times

    with spun(context, "woken") as (node, _):
        guard = node.create_guard_condition(lambda: calls.append(threading.current_thread().name))
        for k in range(20):
            guard.trigger()
            assert wait_for(partial(called, k + 1))
    assert set(calls) == {"woken"}


def test_a_service_answers_and_the_caller_s_future_is_told(context: Any) -> None:
    from std_srvs.srv import Trigger

    def answer(_: Any, response: Any) -> Any:
        response.success = True
        return response

    with spun(context, "server") as (server, _), spun(context, "caller") as (caller, _):
        server.create_service(Trigger, "ask", answer)
        client = caller.create_client(Trigger, "ask")
        assert client.wait_for_service(timeout_sec=10.0)
        assert client.call(Trigger.Request(), timeout_sec=10.0).success


def test_what_a_callback_destroys_is_called_no_more(context: Any) -> None:
    from rclpy.clock import Clock, ClockType

    calls = []
    with spun(context, "fading") as (node, spinner):

        def once() -> None:
            calls.append(1)
            node.destroy_timer(timer)

        timer = node.create_timer(0.01, once, clock=Clock(clock_type=ClockType.STEADY_TIME))
        later: list[int] = []
        node.create_timer(0.01, lambda: later.append(1), clock=Clock(clock_type=ClockType.STEADY_TIME))
        assert wait_for(lambda: len(later) > 5)
        assert spinner.alive
    assert calls == [1]


def test_a_timer_that_another_one_cancels_is_called_no_more(context: Any) -> None:
    from rclpy.clock import Clock, ClockType

    calls: list[int] = []
    with spun(context, "cancelling") as (node, spinner):
        timers: list[Any] = []

        def cancel_the_other(mine: int) -> None:
            calls.append(mine)
            time.sleep(0.05)  # both are due in every turn
            timers[1 - mine].cancel()

        clock = Clock(clock_type=ClockType.STEADY_TIME)
        timers += [node.create_timer(0.02, lambda k=k: cancel_the_other(k), clock=clock) for k in (0, 1)]
        assert wait_for(lambda: len(calls) > 3)
        assert spinner.alive
    assert len(set(calls)) == 1


def test_nodes_stop_at_once_whatever_they_are_about(context: Any) -> None:
    for k in range(8):
        with spun(context, f"brief_{k}") as (node, _):
            node.create_guard_condition(lambda: None).trigger()
            begun = time.monotonic()
        assert time.monotonic() - begun < 2.0


def test_a_guard_that_another_one_destroys_in_the_same_turn_is_not_called(context: Any) -> None:
    calls = []
    with spun(context, "closing") as (node, _):
        begun, release = threading.Event(), threading.Event()

        def hold() -> None:
            begun.set()
            release.wait(10.0)

        node.create_guard_condition(hold).trigger()
        assert begun.wait(10.0)
        guards: list[Any] = []

        def close_the_other(mine: int) -> None:
            calls.append(mine)
            node.destroy_guard_condition(guards[1 - mine])

        guards += [node.create_guard_condition(lambda k=k: close_the_other(k)) for k in (0, 1)]
        for guard in guards:
            guard.trigger()
        release.set()
        assert wait_for(lambda: calls)
        time.sleep(0.1)
    assert len(calls) == 1


def test_what_a_callback_raises_stops_the_node_and_is_kept(context: Any) -> None:
    def fail() -> None:
        raise ZeroDivisionError("on purpose")

    with spun(context, "failing") as (node, spinner):
        node.create_guard_condition(fail).trigger()
        assert wait_for(lambda: not spinner.alive)
        assert isinstance(spinner.error, ZeroDivisionError)


def test_a_coroutine_that_waits_goes_on_once_its_future_is_done(context: Any) -> None:
    from rclpy.task import Future

    said: list[str] = []
    with spun(context, "waiting") as (node, spinner):
        awaited: Future = Future()

        async def wait() -> None:
            said.append(str(await awaited))

        node.create_guard_condition(wait).trigger()
        time.sleep(0.05)
        assert said == []
        awaited.set_result("done")
        assert wait_for(lambda: said == ["done"])
        assert spinner.alive


def test_a_callback_that_waits_holds_its_group_and_no_other(context: Any) -> None:
    from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
    from rclpy.task import Future

    order: list[str] = []
    with spun(context, "grouped") as (node, _):
        awaited: Future = Future()

        async def wait() -> None:
            order.append("begins")
            await awaited
            order.append("ends")

        group = MutuallyExclusiveCallbackGroup()
        first = node.create_guard_condition(wait, callback_group=group)
        same = node.create_guard_condition(lambda: order.append("same group"), callback_group=group)
        other = node.create_guard_condition(lambda: order.append("other group"), callback_group=MutuallyExclusiveCallbackGroup())
        first.trigger()
        assert wait_for(lambda: order == ["begins"])
        same.trigger()
        other.trigger()
        assert wait_for(lambda: order == ["begins", "other group"])
        time.sleep(0.05)
        assert order == ["begins", "other group"]
        awaited.set_result(None)
        assert wait_for(lambda: len(order) == 4)
    assert order == ["begins", "other group", "ends", "same group"]


def test_a_task_gives_its_result_and_one_that_is_cancelled_ends(context: Any) -> None:
    from rclpy.task import Future

    with spun(context, "tasks") as (node, spinner):
        never: Future = Future()
        closed: list[str] = []

        async def wait() -> None:
            try:
                await never
            finally:
                closed.append("closed")

        async def add(a: int, *, b: int) -> int:
            return a + b

        executor = node.executor
        total, product, waiting = executor.create_task(add, 1, b=2), executor.create_task(lambda: 6), executor.create_task(wait)
        assert wait_for(lambda: total.done() and product.done())
        assert (total.result(), product.result()) == (3, 6)
        waiting.cancel()
        executor.wake()
        assert wait_for(lambda: closed == ["closed"])
        assert spinner.alive


def test_what_a_coroutine_raises_after_its_wait_stops_the_node(context: Any) -> None:
    from rclpy.task import Future

    with spun(context, "failing_late") as (node, spinner):
        awaited: Future = Future()

        async def fail() -> None:
            await awaited
            raise ZeroDivisionError("on purpose")

        node.create_guard_condition(fail).trigger()
        time.sleep(0.05)
        awaited.set_result(None)
        assert wait_for(lambda: not spinner.alive)
        assert isinstance(spinner.error, ZeroDivisionError)


def test_spin_until_a_future_is_done_ends_then_and_at_its_deadline(context: Any) -> None:
    import rclpy
    from rclpy.task import Future

    from tof_ros.executor import DirectExecutor

    node = rclpy.create_node("until", context=context)
    executor = DirectExecutor(context=context)
    executor.add_node(node)
    try:
        done, never = Future(), Future()
        node.create_guard_condition(lambda: done.set_result(7)).trigger()
        executor.spin_until_future_complete(done, timeout_sec=10.0)
        assert done.result() == 7
        begun = time.monotonic()
        executor.spin_until_future_complete(never, timeout_sec=0.1)
        assert 0.1 <= time.monotonic() - begun < 2.0
        assert not never.done()
    finally:
        executor.shutdown()
        node.destroy_node()


def test_a_node_that_rests_takes_all_messages_of_its_rest_in_one_turn(context: Any) -> None:
    import rclpy
    from std_msgs.msg import Header

    from tof_ros.executor import DirectExecutor
    from tof_ros.spin import Spinner

    heard: list[tuple[str, str, int]] = []
    turns = [0]

    class Counted(DirectExecutor):
        def _turn(self, timeout_ns: int, rest_s: float = 0.0) -> None:
            turns[0] += 1
            super()._turn(timeout_ns, rest_s)

    with spun(context, "mouth_of_many") as (mouth, _), pytest.MonkeyPatch.context() as patch:
        patch.setattr("tof_ros.trial.CHOICE.executor", lambda context: Counted(context=context))
        ears = rclpy.create_node("rested_ears", context=context, start_parameter_services=False)
        spinner = Spinner(ears, rest_s=0.3)
        try:
            for topic in ("depth", "amplitude"):
                ears.create_subscription(Header, topic, lambda m, topic=topic: heard.append((topic, m.frame_id, turns[0])), 100)
            out = [mouth.create_publisher(Header, topic, 100) for topic in ("depth", "amplitude")]
            assert wait_for(lambda: all(p.get_subscription_count() for p in out))
            for k in range(12):
                for publisher in out:
                    publisher.publish(Header(frame_id=str(k)))
            assert wait_for(lambda: len(heard) == 24)
        finally:
            spinner.stop()
    for wanted in ("depth", "amplitude"):
        assert [word for topic, word, _ in heard if topic == wanted] == [str(k) for k in range(12)]
    assert len({turn for _, _, turn in heard}) <= 2
    ahead = [sum(1 if topic == "depth" else -1 for topic, *_ in heard[:n]) for n in range(24)]
    assert max(map(abs, ahead)) <= 3  # no topic is emptied before the others have their turn


def test_a_turn_after_a_rest_ends_though_messages_keep_coming(context: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    import rclpy
    from std_msgs.msg import Header

    from tof_ros.executor import DirectExecutor

    monkeypatch.setattr("tof_ros.executor.LONGEST_S", 0.0)
    executor, heard = DirectExecutor(context=context), list[str]()
    executor.rest_s = 0.1
    with spun(context, "mouth_without_end") as (mouth, _):
        ears = rclpy.create_node("patient_ears", context=context, start_parameter_services=False)
        executor.add_node(ears)
        ears.create_subscription(Header, "without_end", lambda m: heard.append(m.frame_id), 100)
        out = mouth.create_publisher(Header, "without_end", 100)
        assert wait_for(out.get_subscription_count)
        for k in range(5):
            out.publish(Header(frame_id=str(k)))
        counts, end = list[int](), time.monotonic() + 10.0
        while len(heard) < 5 and time.monotonic() < end:
            executor.spin_once(0.5)
            counts.append(len(heard))
        executor.shutdown()
        ears.destroy_node()
    assert heard == ["0", "1", "2", "3", "4"]
    assert max(b - a for a, b in zip([0, *counts], counts, strict=False)) == 1


def test_a_busy_node_looks_for_events_of_dds_too(context: Any) -> None:
    from rclpy.qos import QoSProfile, ReliabilityPolicy
    from std_msgs.msg import Header

    from tof_ros.mismatch import Mismatches

    with spun(context, "busy_ears") as (ears, _), spun(context, "best_effort_mouth") as (mouth, _):
        ears.create_timer(0.002, lambda: None)
        mismatches = Mismatches(ears)
        ears.create_subscription(Header, "unheard", lambda _: None, 10, event_callbacks=mismatches.of_subscription("unheard"))
        time.sleep(0.7)  # a look at the events has passed
        mouth.create_publisher(Header, "unheard", QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT))
        assert wait_for(mismatches.current)
        assert "reliability" in mismatches.current()[0]


def test_a_busy_node_answers_services_too(context: Any) -> None:
    from std_srvs.srv import Trigger

    with spun(context, "busy_server") as (server, _), spun(context, "caller") as (caller, _):
        server.create_timer(0.002, lambda: None)
        server.create_service(Trigger, "ask_busy", lambda _, response: response)
        client = caller.create_client(Trigger, "ask_busy")
        assert client.wait_for_service(timeout_sec=10.0)
        assert all(client.call(Trigger.Request(), timeout_sec=10.0) is not None for _ in range(3))
