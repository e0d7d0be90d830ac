# SPDX-License-Identifier: Apache-2.0
"""Timeline of a session: moves, dwells and pauses; poses at any time; times of the captures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tof_core import se3

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from tof_core.arrays import Float
    from tof_virtual.config import PlanConfig
    from tof_virtual.plan import Stop

SETTLE_S = 0.25
DRIVE_S = 3.0


@dataclass(frozen=True, slots=True, eq=False)
class Segment:
    """An interval in which body and hand move straight from one pose to another (or stand still)."""

    start_s: float
    end_s: float
    T_cell_body: tuple[Float, Float]
    T_body_hand: tuple[Float, Float]
    stop: int
    smooth: bool

    def poses(self, time_s: float) -> tuple[Float, Float]:
        """`T_cell_body` and `T_body_hand` at a time within the segment (minimum jerk where `smooth`)."""
        share = float(np.clip((time_s - self.start_s) / max(self.end_s - self.start_s, 1e-9), 0, 1))
        if self.smooth:
            share = share**3 * (10 - 15 * share + 6 * share**2)
        body, hand = self.T_cell_body, self.T_body_hand
        return (
            body[0] if body[0] is body[1] else se3.interpolate(*body, share),
            hand[0] if hand[0] is hand[1] else se3.interpolate(*hand, share),
        )

    def ticks(self, rate_hz: float) -> Iterator[float]:
        """Times at which TF is sent: both ends and every period between."""
        count = max(int(np.ceil((self.end_s - self.start_s) * rate_hz - 1e-9)), 1)
        yield from np.linspace(self.start_s, self.end_s, count + 1)


@dataclass(frozen=True, slots=True, eq=False)
class Shutter:
    """One capture: when (seconds from the start), at which stop of the plan, within which segment."""

    time_s: float
    stop: int
    segment: Segment


def schedule(stops: Sequence[Stop], config: PlanConfig, rng: np.random.Generator) -> tuple[list[Segment], list[Shutter]]:
    """Segments in order of time, and the captures within them."""
    segments: list[Segment] = []
    shutters: list[Shutter] = []
    dwell = 2 * SETTLE_S + (config.captures - 1) / config.rate_hz
    body, hand, now = stops[0].T_cell_body, stops[0].T_body_hand, 0.0
    for k, stop in enumerate(stops):
        sweep = _sweep(stop.T_body_hand, config, dwell, rng)
        if stop.T_cell_body is not body:
            segments.append(Segment(now, now + DRIVE_S, (body, stop.T_cell_body), (hand, hand), k, smooth=True))
            body, now = stop.T_cell_body, now + DRIVE_S
        if k:
            segments.append(Segment(now, now + config.move_s, (body, body), (hand, sweep[0]), k, smooth=True))
            now += config.move_s
        still = Segment(now, now + dwell, (body, body), sweep, k, smooth=False)
        segments.append(still)
        shutters += [Shutter(now + SETTLE_S + i / config.rate_hz, k, still) for i in range(config.captures)]
        hand, now = sweep[1], now + dwell + config.pause_s
    return segments, shutters


def _sweep(T_body_hand: Float, config: PlanConfig, dwell_s: float, rng: np.random.Generator) -> tuple[Float, Float]:
    """Hand poses at the ends of a dwell: the same, or either side of the planned one where captures are taken in motion."""
    if not config.capture_moving:
        return T_body_hand, T_body_hand
    way, turn = rng.normal(0, 1, 3), rng.normal(0, 1, 3)
    twist = (
        np.concatenate([config.speed_m_s * way / np.linalg.norm(way), np.radians(config.turn_deg_s) * turn / np.linalg.norm(turn)])
        * dwell_s
        / 2
    )
    return T_body_hand @ se3.exp(-twist), T_body_hand @ se3.exp(twist)
