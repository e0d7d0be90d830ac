# SPDX-License-Identifier: Apache-2.0
"""Late stamps beside motion: a lateness longer than the frame is an effect of its own."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from tof_sensor.effects.motion import Motion
from tof_sensor.effects.time_sync import TimeSync

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_gap.solved import Named


def late_apart(found: Sequence[Named], frame_taps: float, *, asked: bool = True) -> tuple[Named, ...]:
    """The named effects with `time_sync` apart from `motion`, where the mean time of motion's taps lies outside of the frame.

    Depth from taps that are exposed one after another is that of their mean time, and the stamp is any time within the frame. So motion
    has a lateness of up to half of `frame_taps` taps. A longer one is named `time_sync`, if `asked` for. If taps make no error, the
    remaining `motion` is below its tolerance.
    """
    at = next((k for k, one in enumerate(found) if one.name == Motion.NAME), None)
    if at is None or not asked:
        return tuple(found)
    motion, std = found[at].effects[0], found[at].std[0]
    if not isinstance(motion, Motion) or abs(motion.axial_s) <= 0.5 * frame_taps * motion.apart_s:
        return tuple(found)
    both = found[at].divided(replace(motion, axial_s=0.0), TimeSync(delay_s=motion.axial_s), {"delay_s": std["axial_s"]})
    return tuple(sorted((*found[:at], *both, *found[at + 1 :]), key=lambda one: one.name))
