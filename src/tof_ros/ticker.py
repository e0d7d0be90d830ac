# SPDX-License-Identifier: Apache-2.0
"""A timer that runs while something waits: a node without frames is not woken by it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from tof_ros.patience import PERIOD_S

if TYPE_CHECKING:
    from collections.abc import Callable

    from tof_ros.base import RoomNode


class Ticker:
    """Calls an action every `period_s` seconds of the wall clock, from `start` until the action says that nothing waits."""

    def __init__(self, node: RoomNode[Any], action: Callable[[], bool], period_s: float = PERIOD_S) -> None:
        """`action` returns whether something still waits; it runs in the node's thread."""
        self._action = action
        self._timer = node.timer(period_s, self._tick)
        self._timer.cancel()

    def start(self) -> None:
        """Something waits from now on."""
        if self._timer.is_canceled():
            self._timer.reset()

    def _tick(self) -> None:
        if not self._action():
            self._timer.cancel()
