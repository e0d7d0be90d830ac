# SPDX-License-Identifier: Apache-2.0
"""A node that loads a mesh or a model: configured, activated, deactivated and cleaned up as ROS 2 manages nodes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from lifecycle_msgs.srv import ChangeState
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNodeMixin, LifecycleState, TransitionCallbackReturn

from tof_core.errors import RefusedError, ToftwinError
from tof_ros.base import RoomNode
from tof_ros.bond import Bond

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from rclpy.qos import QoSProfile
    from rclpy.subscription import Subscription
    from rclpy.timer import Timer

    from tof_core.live import ManagedOptions

SUCCESS, FAILURE = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE


class Managed(Protocol):
    """A configuration that says whether its node starts by itself."""

    @property
    def live(self) -> ManagedOptions:
        """The options of the running node."""


M = TypeVar("M", bound=Managed)


class ManagedNode(LifecycleNodeMixin, RoomNode[M]):
    """Loads scenes and models when it is configured, and subscribes to its topics while it is active.

    A node writes `load` (files to memory), its inverse `unload`, and `start`. Subscriptions and timers that `start` makes end by
    themselves; what else it begins it puts on `at_stop`, which is run, last first, where the node ends or where `start` fails half-way.
    What `load` raises is the answer to the transition: the node stays unconfigured, says why in its diagnostics (`trouble`), and can be
    configured again once its parameters are set right.
    """

    def __init__(self, name: str, room: str, config: type[M], *, fixed: tuple[str, ...] = (), **options: Any) -> None:
        """Unconfigured; with `live.autostart` it configures and activates itself as soon as it is spun."""
        self.loaded = self.active = self._starting = self._gone = False
        self._bond: Bond | None = None
        self._subscribed: list[Subscription] = []
        self._ticking: list[Timer] = []
        self.at_stop: list[Callable[[], None]] = []
        RoomNode.__init__(self, name, room, config, fixed=fixed, locked=lambda: self.loaded, **options)
        LifecycleNodeMixin.__init__(self)
        self._answer_impossible_transitions()
        self._starting = self.config.live.autostart
        if self._starting:
            self._starter = super().timer(0.01, self._autostart)

    def load(self) -> None:
        """Read files; raises a `ToftwinError` that says what is wrong."""

    def start(self) -> None:
        """Subscribe."""

    def unload(self) -> None:
        """Let go of what `load` made."""

    def retune(self, config: M) -> None:
        """Act on parameters changed while configured."""

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Load; a failure leaves the node unconfigured."""
        try:
            self.load()
        except Exception as error:  # noqa: BLE001  (rclpy would swallow it and tell nobody)
            return self._fail("configured", error)
        self.loaded, self.trouble = True, ""
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Hear."""
        try:
            self.start()
            self._bond = Bond(self, period) if (period := self.config.live.bond_s) else None
        except Exception as error:  # noqa: BLE001  (as above)
            self._end()
            return self._fail("activated", error)
        self.active, self.trouble = True, ""
        self.hearing.begin()
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Hear no more; what was loaded stays."""
        self._end()
        self._unbind()
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Forget what was loaded; parameters can be set again."""
        self._let_go()
        return super().on_cleanup(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """End, from whatever state."""
        self._let_go()
        return super().on_shutdown(state)

    def restart(self) -> None:
        """Begin the session anew with what is loaded."""
        if not self.active:
            return
        self._end()
        try:
            self.start()
        except Exception as error:  # noqa: BLE001  (as on activation)
            self._end()
            self._unbind()
            self._fail("activated", error)
            return
        self.active = True
        self.hearing.begin()

    def on_config(self, config: M) -> None:
        """Changed parameters matter once something is loaded; until then `load` will see them."""
        if self.loaded:
            self.retune(config)

    def input(self, topic: str, kind: type[Any], take: Callable[[Any], None], profile: QoSProfile, **options: Any) -> Subscription:
        """A subscription that ends when the node is deactivated; `options` as of any node's."""
        self._subscribed.append(super().input(topic, kind, take, profile, **options))
        return self._subscribed[-1]

    def timer(self, seconds: float, action: Callable[[], None]) -> Timer:
        """A timer that ends when the node is deactivated."""
        self._ticking.append(super().timer(seconds, action))
        return self._ticking[-1]

    def service(self, name: str, action: Callable[[], str], *, slow: bool = False) -> None:
        """A service that is refused while the node is not active."""

        def guarded() -> str:
            if not self.active:
                raise RefusedError(f"the node is {self.state}", where=self.get_name(), todo=self.trouble or "activate it first")
            return action()

        super().service(name, guarded, slow=slow)

    def jumped(self) -> None:
        """Start afresh, where there is something to forget."""
        if self.active:
            super().jumped()

    @property
    def state(self) -> str:
        """State of the life cycle."""
        return "active" if self.active else "inactive" if self.loaded else "unconfigured"

    def reported(self) -> Mapping[str, str]:
        """The state, and once something is loaded the node's own figures."""
        return {"state": self.state, **(self.figures() if self.loaded else {})}

    def complaints(self) -> list[str]:
        """Faults for the diagnostics; of a node that is not active, those of its helpers and its state."""
        if self.active:
            return super().complaints()
        state = [] if self._starting else [f"{self.state}: nothing is heard until the node is activated"]
        return [*(line for warn in self.warns for line in warn()), *state]

    def destroy_node(self) -> None:
        """Release files and subscriptions, then destroy the node."""
        self._gone = True
        self._let_go()
        super().destroy_node()
        # It holds the node's handle, which rclpy frees when the garbage collector comes by: until then peers see the node, and its services.
        self._state_machine.destroy_when_not_in_use()

    def _autostart(self) -> None:
        self._starter.destroy()
        self._starting = False
        try:
            if self.trigger_configure() == SUCCESS:
                self.trigger_activate()
        except rclpy_implementation.RCLError:
            if not self._gone:  # a node that was stopped while it was loading has no state any more
                raise

    def _fail(self, what: str, error: Exception) -> TransitionCallbackReturn:
        known = isinstance(error, ToftwinError | OSError)
        self.trouble = f"not {what}: {error if known else f'{type(error).__name__}: {error}'}"
        self.get_logger().error(self.trouble)
        return FAILURE

    def _end(self) -> None:
        """Inverse of `start`."""
        for subscription in self._subscribed:
            self.destroy_subscription(subscription)
        for timer in self._ticking:
            self.destroy_timer(timer)
        self._subscribed.clear()
        self._ticking.clear()
        self.active = False
        self.hearing.end()
        while self.at_stop:
            self.at_stop.pop()()

    def _unbind(self) -> None:
        """End the bond to the lifecycle manager; it outlives a restart of the session."""
        bond, self._bond = self._bond, None
        if bond is not None:
            bond.close()

    def _let_go(self) -> None:
        self._end()
        self._unbind()
        if self.loaded:
            self.loaded = False
            self.unload()

    def _answer_impossible_transitions(self) -> None:
        """Rclpy lets a transition that the state does not have (activate before configure) end the executor; answer it instead."""
        for service in self.services:
            if service.srv_type is ChangeState:
                service.callback = self._answered(service.callback)

    def _answered(self, change: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
        def answer(request: Any, response: Any) -> Any:
            try:
                return change(request, response)
            except rclpy_implementation.RCLError as error:
                self.get_logger().warning(f"a node that is {self.state} cannot do that: {str(error).splitlines()[0]}")
                response.success = False
                return response

        return answer
