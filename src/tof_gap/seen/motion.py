# SPDX-License-Identifier: Apache-2.0
"""Whether a session was recorded in motion."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tof_sensor.session import Session, SessionView

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_gap.seen.residual import ViewEvidence


def moving(views: Sequence[ViewEvidence]) -> bool:
    """Whether a view was taken in motion (`tof_sensor.frame` states from which speed)."""
    return Session(tuple(SessionView(v.frame, v.pixels) for v in views)).moving
