# SPDX-License-Identifier: Apache-2.0
"""Whether a session was recorded in motion."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_gap.seen.evidence.view import ViewEvidence


def moving(views: Sequence[ViewEvidence]) -> bool:
    """Whether a view was taken in motion (`tof_sensor.frame` states from which speed)."""
    return any(v.frame.context.moving for v in views)
