# SPDX-License-Identifier: Apache-2.0
"""The closed loop: correct and capture again, until within tolerance, no longer improving, or refused."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from arm_correction.correction import Correction, propose
from tof_core import se3
from tof_core.errors import RefusedError

if TYPE_CHECKING:
    from collections.abc import Callable

    from arm_correction.config import CorrectConfig
    from arm_correction.first import First
    from tof_core.arrays import Float
    from tof_core.capture import View


@dataclass(frozen=True, slots=True)
class LoopConfig:
    """When a loop ends: inside the tolerance, or after so many moves; captures of each look."""

    moves: int = 3
    captures: int = 10
    tolerance_mm: float = 0.5
    tolerance_deg: float = 0.05


class Arm(Protocol):
    """A robot arm that moves to a pose with its own error."""

    def goto(self, T_body_hand: Float) -> None:
        """Move the hand to a pose in the body."""


@dataclass(frozen=True, slots=True, eq=False)
class Closed:
    """End of a loop: done (within tolerance, or as near as the arm can get), refused, or out of moves; with all corrections."""

    done: bool
    moves: int
    reason: str
    corrections: tuple[Correction, ...]


def close_loop(
    arm: Arm, look: Callable[[], View], first: First, config: CorrectConfig, T_hand_camera: Float, loop: LoopConfig | None = None
) -> Closed:
    """Move until the view equals the reference view.

    The view after the last move decides, compared with the reference itself; the CAD only serves to come near.
    A step of more than half the previous one is the arm's own repeatability: the loop stops there.
    """
    loop = loop or LoopConfig()
    made: list[Correction] = []
    moves = 0
    while True:
        view = look()
        assert view.robot is not None
        try:
            found = first.register(view, config)
        except RefusedError as error:
            return Closed(done=False, moves=moves, reason=error.what, corrections=tuple(made))
        made.append(propose(found, view.robot, config, T_hand_camera=T_hand_camera))
        last = made[-1]
        if not last.accepted:
            return Closed(done=False, moves=moves, reason=last.reason, corrections=tuple(made))
        by_reference = last.by == "reference"
        if by_reference and last.step[0] <= loop.tolerance_mm and last.step[1] <= loop.tolerance_deg:
            return Closed(done=True, moves=moves, reason="inside tolerance", corrections=tuple(made))
        if moves and by_reference and _no_better(made[-2], last, loop):
            return Closed(done=True, moves=moves, reason="as near as the arm gets", corrections=tuple(made))
        if moves == loop.moves:
            return Closed(done=by_reference and _near(last, loop), moves=moves, reason="moves used up", corrections=tuple(made))
        arm.goto(last.T_frame_hand)
        moves += 1


def _near(last: Correction, loop: LoopConfig) -> bool:
    """Within twice the tolerance."""
    return last.step[0] <= 2 * loop.tolerance_mm and last.step[1] <= 2 * loop.tolerance_deg


def _no_better(before: Correction, last: Correction, loop: LoopConfig) -> bool:
    """Whether another move would only repeat the arm's random error: near already, and hardly nearer than before."""
    return _near(last, loop) and last.step[0] > 0.5 * before.step[0]


def leftover(T_wanted: Float, T_camera: Float) -> tuple[float, float]:
    """Distance of a camera from the wanted pose: millimetres, degrees. For evaluation."""
    metres, degrees = se3.distance(np.asarray(T_wanted), np.asarray(T_camera))
    return 1e3 * metres, degrees
