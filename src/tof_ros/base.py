# SPDX-License-Identifier: Apache-2.0
"""Base of every node of the graph: parameters, counts, diagnostics, services, and a clock that may be set back."""

from __future__ import annotations

import time
from contextlib import contextmanager
from threading import Lock
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import Clock, ClockType, JumpThreshold
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos_overriding_options import QoSOverridingOptions
from sensor_msgs.msg import TimeReference
from std_srvs.srv import Trigger

from tof_core.errors import RefusedError, ToftwinError
from tof_core.jump import JUMP_NS
from tof_ros import messages, qos
from tof_ros.diagnostics import Diagnostics, Tally
from tof_ros.ending import Endings
from tof_ros.hearing import Hearing
from tof_ros.interfaces import MISSING, own_message
from tof_ros.mismatch import Mismatches
from tof_ros.news import News
from tof_ros.parameters import Parameters

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from rclpy.publisher import Publisher
    from rclpy.qos import QoSProfile
    from rclpy.subscription import Subscription
    from rclpy.timer import Timer

    from tof_ros.spin import Spinner

C = TypeVar("C")

ONE_JUMP_S = 2.0
"""`/clock`, and messages that queued before it was set back, follow late stamps of the same jump within this time (wall clock)."""
LISTED_S = 20
"""So long a process that was killed is listed: the lease of a participant of Fast DDS."""
RESET, LEFT_OVER = "reset", "before the jump"
"""Why a frame has no outputs: it waited at a reset, or it was sent before the clock was set back and received after it."""


class RoomNode(Node, Generic[C]):
    """A node whose parameters are a typed configuration.

    Each input frame ends as one message on `<room>/done`: its stamp, and `kept` or the reason why
    it was skipped. Replay waits for this message, and a user reads from it what happened to a frame.
    `trouble` says why the node does nothing at all; `threads` is how many the node is spun with, `rest_s` how
    long it pauses after each turn, so that one turn takes all messages of a frame; `helpers` are small nodes of its own
    (the transform listener), without which it would do nothing and say nothing: where one dies, the node is dead.
    """

    trouble = ""
    threads = 1
    rest_s = 0.0

    def __init__(
        self,
        name: str,
        room: str,
        config: type[C],
        *,
        fixed: tuple[str, ...] = (),
        locked: Callable[[], bool] | None = None,
        **options: Any,
    ) -> None:
        """`room` prefixes the topics; parameters whose names begin with one of `fixed` are set at the start, or while not `locked`."""
        super().__init__(name, **options)
        self.room = room
        self.tally = Tally()
        self._busy, self._beside = Lock(), ReentrantCallbackGroup()
        self._mismatches = Mismatches(self)
        self.hearing = Hearing(self, self.tally)
        self.helpers: list[Spinner] = []
        self._endings, self._news = Endings(self), News()
        self.warns: list[Callable[[], list[str]]] = [self._mismatches.current, self._namesakes]
        self.at_end: list[Callable[[], None]] = []
        self._settings = Parameters(self, config, fixed=fixed, locked=locked, on_change=self.on_config)
        self._done = self.output("done", TimeReference)
        self._diagnostics = Diagnostics(self, self.tally, self.reported, self.complaints, lambda: self.trouble, self.hearing.silence)
        self._last_jump = float("-inf")
        threshold = JumpThreshold(min_forward=None, min_backward=Duration(nanoseconds=-1), on_clock_change=False)
        self._clock_jump = self.get_clock().create_jump_callback(threshold, post_callback=lambda _: self._clock_jumped())
        self.service("reset", self.reset)

    @property
    def config(self) -> C:
        """The parameters, whole and valid."""
        return self._settings.config

    def on_config(self, config: C) -> None:
        """Act on changed parameters."""

    def reset(self) -> str:
        """Forget what was accumulated; returns what to tell the caller."""
        return "forgotten"

    def figures(self) -> Mapping[str, str]:
        """More values for the diagnostics."""
        return {}

    def warnings(self) -> list[str]:
        """What is wrong right now."""
        return []

    def reported(self) -> Mapping[str, str]:
        """All values for the diagnostics beside the tally."""
        return self.figures()

    def complaints(self) -> list[str]:
        """All that is wrong: what the node's helpers say (`warns`), then its own warnings."""
        return [*(line for warn in self.warns for line in warn()), *self.warnings()]

    def _namesakes(self) -> list[str]:
        """Another node of this name: whoever hears the one hears the other too."""
        name = (self.get_name(), self.get_namespace())
        if (number := self.get_node_names_and_namespaces().count(name)) < 2:
            return []
        todo = f"stop the others, or start each in a --namespace of its own (one that was killed is listed for {LISTED_S} s more)"
        return [f"{number} nodes are named {self.get_fully_qualified_name()}: their topics, services and /tf_static are mixed; {todo}"]

    def destroy_node(self) -> None:
        """Finish what is open, then go."""
        for finish in self.at_end:
            finish()
        super().destroy_node()

    def output(self, topic: str, kind: type[Any], profile: QoSProfile = qos.OUTPUT) -> Publisher:
        """A publisher of `<room>/<topic>` whose QoS a user may override."""
        return self.shared(f"{self.room}/{topic}", kind, profile)

    def typed(self, topic: str, name: str) -> Publisher | None:
        """A publisher of `<room>/<topic>` with a message of toftwin_msgs; None where that is not installed, which is logged once."""
        kind = own_message(name)
        if kind is None:
            self.get_logger().warning(MISSING, once=True)
            return None
        return self.output(topic, kind)

    def offer(self, publisher: Publisher | None, make: Callable[[], Any], *, now: str = "") -> None:
        """Publish what `make` returns, which is made only while somebody is subscribed.

        `now` names the typed topic that takes this one's place: a topic that stays for one release says so to its subscriber.
        """
        if publisher is None or not publisher.get_subscription_count():
            return
        if now:
            self._endings.tell(publisher, self.resolve_topic_name(f"{self.room}/{now}"))
        publisher.publish(make())

    def shared(self, topic: str, kind: type[Any], profile: QoSProfile = qos.LATCHED) -> Publisher:
        """A publisher of a topic that is no room's own, latched unless another profile is given."""
        options, events = QoSOverridingOptions.with_default_policies(), self._mismatches.of_publisher(topic)
        return self.create_publisher(kind, topic, profile, qos_overriding_options=options, event_callbacks=events)

    def input(
        self,
        topic: str,
        kind: type[Any],
        take: Callable[[Any], None],
        profile: QoSProfile,
        *,
        frames: str | None = None,
        about: Callable[[Any, Mapping[str, Any]], None] | None = None,
    ) -> Subscription:
        """A subscription whose QoS a user may override; a message that cannot be read is logged, and the node continues.

        `frames` marks the topic whose messages are the node's frames: the parameter that names another, empty where none does.
        `about` receives each message first, with what the middleware says of it (number, time of arrival).
        """
        self.hearing.add(topic, kind, frames)
        options, events = QoSOverridingOptions.with_default_policies(), self._mismatches.of_subscription(topic)

        def guarded(message: Any) -> None:
            try:
                take(message)
            except ToftwinError as error:
                self.get_logger().error(f"{topic}: {error}", throttle_duration_sec=5.0)

        def informed(message: Any, info: Mapping[str, Any]) -> None:
            if about is not None:
                about(message, info)
            guarded(message)

        callback = guarded if about is None else informed
        return self.create_subscription(kind, topic, callback, profile, qos_overriding_options=options, event_callbacks=events)

    def service(self, name: str, action: Callable[[], str], *, slow: bool = False) -> None:
        """A `~/name` Trigger: its message is what `action` returns, or the one line of its error.

        A `slow` one runs beside the frames, in a node that has `threads` for it; while it does, a second call of any slow one is
        refused, not queued.
        """
        if slow:
            action = self._alone(action)

        def answer(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            try:
                response.success, response.message = True, action()
            except (ToftwinError, OSError) as error:
                response.success, response.message = False, str(error)
            return response

        self.create_service(Trigger, f"~/{name}", answer, callback_group=self._beside if slow else None)

    @contextmanager
    def alone(self) -> Iterator[None]:
        """Slow work, one at a time.

        Raises:
            RefusedError: another one runs.
        """
        if not self._busy.acquire(blocking=False):
            raise RefusedError("busy with another command", where=self.get_name(), todo="ask again once it is answered")
        try:
            yield
        finally:
            self._busy.release()

    def _alone(self, action: Callable[[], str]) -> Callable[[], str]:
        def alone() -> str:
            with self.alone():
                return action()

        return alone

    def timer(self, seconds: float, action: Callable[[], None]) -> Timer:
        """Call `action` on the wall clock, whatever the data's clock does."""
        return self.create_timer(seconds, action, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def answer(self, stamp_ns: int, fate: str) -> None:
        """Say what became of a frame."""
        self._done.publish(messages.time_reference(stamp_ns, stamp_ns, fate))

    def done(self, stamp_ns: int, arrived: float, fate: str = "kept") -> None:
        """A frame's outputs are all published."""
        self.tally.done(arrived)
        self.answer(stamp_ns, fate)

    def skip(self, stamp_ns: int, reason: str, why: str = "") -> None:
        """A frame has no outputs: count it, say why (once, as long as no frame is kept), go on."""
        self.tally.skip(reason)
        self.answer(stamp_ns, reason)
        if why and self._news.worth(f"{reason}: {why}", self.tally.kept):
            self.get_logger().warning(f"frame {stamp_ns} skipped, {reason}: {why}")

    def jumped(self) -> None:
        """The clock was set back: the accumulated state belongs to another time."""
        self._last_jump = time.monotonic()
        self.get_logger().warning("the clock was set back: starting afresh")
        self.reset()

    def _clock_jumped(self) -> None:
        """`/clock` was set back: discard the state, unless stamps have shown the same jump within the last `ONE_JUMP_S`."""
        if time.monotonic() - self._last_jump > ONE_JUMP_S:
            self.jumped()

    def left_over(self, stamp_ns: int) -> bool:
        """Whether a message was sent before the clock was set back and is received after it: stamped ahead of simulated time."""
        if time.monotonic() - self._last_jump > ONE_JUMP_S:
            return False
        clock = self.get_clock()
        return bool(clock.ros_time_is_active) and stamp_ns > clock.now().nanoseconds + JUMP_NS

    def forget_frames(self, arrivals: dict[int, float]) -> None:
        """Give each waiting frame its end on `done`: it has no outputs, because of a reset."""
        for stamp in sorted(arrivals):
            self.skip(stamp, RESET)
        arrivals.clear()
