# SPDX-License-Identifier: Apache-2.0
"""Late stamps beside motion: a lateness that is longer than the frame takes is none of the taps'."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from tof_gap.solved import Named
from tof_sensor.effects.motion import Motion
from tof_sensor.effects.time_sync import TimeSync

if TYPE_CHECKING:
    from collections.abc import Sequence


def late_apart(found: Sequence[Named], frame_taps: float, *, asked: bool = True) -> tuple[Named, ...]:
    """The named effects with `time_sync` apart from `motion`, where motion's mean time lies outside of the frame that its taps make.

    Depth of taps that look one after another is that of their mean time, and the stamp is any time within the frame: motion has a
    lateness of its own, of up to half of `frame_taps` taps. Stamps that are later than that have another cause, and where taps do not
    err at all, what is left of motion is below every tolerance. Unless `time_sync` is `asked` for, it is not named.
    """
    at = next((k for k, one in enumerate(found) if one.name == Motion.NAME), None)
    if at is None or not asked:
        return tuple(found)
    motion, std = found[at].effects[0], found[at].std[0]
    if not isinstance(motion, Motion) or abs(motion.axial_s) <= 0.5 * frame_taps * motion.apart_s:
        return tuple(found)
    # Each is what the other was taken for: beside each other they are no tie.
    ties = tuple(name for name in found[at].ties if name != TimeSync.NAME)
    late = Named(TimeSync.NAME, (TimeSync(delay_s=motion.axial_s),), ({"delay_s": std["axial_s"]},), ties, found[at].confidence)
    taps = replace(found[at], effects=(replace(motion, axial_s=0.0),), ties=ties)
    return tuple(sorted((*found[:at], taps, *found[at + 1 :], late), key=lambda one: one.name))
