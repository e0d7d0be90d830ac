# SPDX-License-Identifier: Apache-2.0
"""Diagnostics of a node, once a second: rate, latency, frames received, kept and skipped by reason."""

from __future__ import annotations

import time
from collections import Counter, deque
from typing import TYPE_CHECKING

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType

from tof_ros import qos

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from rclpy.node import Node

AGAIN_S = 60.0
"""A fault that comes and goes with single frames is logged once a minute at most; the diagnostics show it each time."""


class Tally:
    """Counts and times of the frames that pass a node; times in seconds of a monotonic clock."""

    def __init__(self, window: int = 256) -> None:
        """Keep the last `window` arrivals and latencies."""
        self.seen = self.kept = 0
        self.first_arrival = self.last_arrival = float("-inf")
        self.skipped: Counter[str] = Counter()
        self._arrivals: deque[float] = deque(maxlen=window)
        self._latencies: deque[float] = deque(maxlen=window)

    def arrived(self) -> float:
        """Count a frame; returns its time of arrival."""
        now = time.monotonic()
        self.first_arrival = now if self.seen == 0 else self.first_arrival
        self.last_arrival = now
        self.seen += 1
        self._arrivals.append(now)
        return now

    def done(self, arrived: float) -> None:
        """Count a frame whose outputs are published."""
        self.kept += 1
        self._latencies.append(time.monotonic() - arrived)

    def skip(self, reason: str) -> None:
        """Count a frame without outputs."""
        self.skipped[reason] += 1

    def lose(self, reason: str, frames: int) -> None:
        """Count frames that were sent to the node and never reached it."""
        self.seen += frames
        self.skipped[reason] += frames

    def rate(self) -> float:
        """Arrivals per second over the last ten seconds, 0 when none came."""
        recent = [t for t in self._arrivals if t > time.monotonic() - 10.0]
        span = recent[-1] - recent[0] if len(recent) > 1 else 0.0
        return (len(recent) - 1) / span if span > 0 else 0.0

    def silence(self) -> float:
        """Seconds since the last arrival, infinite before the first."""
        return time.monotonic() - self.last_arrival

    def latency(self, percentile: float) -> float:
        """A percentile of the times from arrival to the last output, NaN before the first."""
        return float(np.percentile(self._latencies, percentile)) if self._latencies else float("nan")

    def values(self) -> dict[str, str]:
        """The figures as text."""
        out = {
            "rate_hz": f"{self.rate():.2f}",
            "latency_p50_ms": f"{1e3 * self.latency(50):.1f}",
            "latency_p95_ms": f"{1e3 * self.latency(95):.1f}",
            "seen": str(self.seen),
            "kept": str(self.kept),
            "skipped": str(self.skipped.total()),
        }
        return out | {f"skipped.{reason}": str(count) for reason, count in sorted(self.skipped.items())}


class Diagnostics:
    """Publishes a node's tally on `/diagnostics`, on the wall clock whatever the data's clock does."""

    def __init__(
        self,
        node: Node,
        tally: Tally,
        more: Callable[[], Mapping[str, str]],
        warnings: Callable[[], list[str]],
        error: Callable[[], str],
        silence: Callable[[], str],
    ) -> None:
        """`more` gives further values, `warnings` what is wrong right now, one phrase each; `error` why nothing works, `silence` why no frame comes."""
        self._node, self._tally, self._more, self._warnings, self._error = node, tally, more, warnings, error
        self._silence = silence
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", qos.OUTPUT)
        self._last_skipped = 0
        self._warned: dict[str, float] = {}
        self._silent = False
        node.create_timer(1.0, self.publish, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def publish(self) -> None:
        """Send the status now; a warning is logged when it comes, and again where it was gone for `AGAIN_S`; a silence each time."""
        warnings, silence, now = self._warnings() + self._new_skips(), self._silence(), time.monotonic()
        if silence and not self._silent:
            self._node.get_logger().warning(silence)
        self._silent = bool(silence)
        for warning in warnings:
            kind = warning.split(":")[0]
            if now - self._warned.get(kind, float("-inf")) > AGAIN_S:
                self._node.get_logger().warning(warning)
            self._warned[kind] = now
        message = DiagnosticArray(status=[self._status(warnings, silence)])
        message.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(message)

    def _new_skips(self) -> list[str]:
        total = self._tally.skipped.total()
        new, self._last_skipped = total - self._last_skipped, total
        if new <= 0:
            return []
        reasons = ", ".join(f"{reason} {count}" for reason, count in self._tally.skipped.most_common(4))
        return [f"frames skipped: {new} in the last second (in all: {reasons})"]

    def _status(self, warnings: list[str], silence: str) -> DiagnosticStatus:
        level = DiagnosticStatus.OK
        message = "frames flow"
        if error := self._error():
            level, message = DiagnosticStatus.ERROR, error
        elif warnings:
            level, message = DiagnosticStatus.WARN, "; ".join(warnings)
        elif silence:
            level, message = DiagnosticStatus.STALE, silence
        return status(level, self._node.get_fully_qualified_name().lstrip("/"), message, {**self._tally.values(), **self._more()})


def status(level: bytes, name: str, message: str, values: Mapping[str, str]) -> DiagnosticStatus:
    """A `diagnostic_msgs/DiagnosticStatus`."""
    pairs = [KeyValue(key=k, value=v) for k, v in values.items()]
    return DiagnosticStatus(level=level, name=name, message=message, hardware_id="", values=pairs)
