# SPDX-License-Identifier: Apache-2.0
"""Which parts the measurements confirm and which they contradict: from the labels' own reasons, over the last views."""

from __future__ import annotations

from collections import deque
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np

from tof_sim_label.reasons import WORLD, LabelReason

if TYPE_CHECKING:
    from tof_core.arrays import Ints, Mask
    from tof_core.capture import View
    from tof_sim_label.label import Label

VIEWS = 20
"""Accepted views that count: as many as `inspect` judges together; from one direction alone a displaced part may look right."""
LEAST_PIXELS = 20
"""Measured pixels of a part, of all these views, below which nothing is known of it."""
SOME, MOST = 0.05, 0.5
"""Share of a part's measured pixels that contradict the CAD: that of a part in its place is below 1 %, that of an absent one above 90 %."""


class Standing(StrEnum):
    """What the views say of a part."""

    CONFIRMED = "confirmed"
    """Measured where the CAD has it."""
    PARTLY = "contradicted in part"
    """Some of it is measured elsewhere, or something else is in its place: displaced, or partly hidden by what the CAD lacks."""
    CONTRADICTED = "contradicted"
    """Most of it is: absent, displaced by more than its size, or hidden."""
    REFUSED = "seen by refused views alone"
    """The pose of each view that shows it was refused: nothing is known."""


class Standings:
    """The standing of each part of a scene, by its index."""

    def __init__(self, parts: int) -> None:
        """No view yet."""
        self._parts = parts
        self._counts: deque[tuple[Ints, Ints]] = deque(maxlen=VIEWS)
        self._refused = np.zeros(parts, np.bool_)

    def add(self, view: View, label: Label) -> None:
        """Count a view's pixels on each part: those whose measurement contradicts the CAD, and those that agree."""
        if not label.posed.accepted:
            self._refused |= self._on_parts(label, label.part >= 0) > 0
            return
        against = np.isin(label.reason, WORLD)
        agrees = (label.reason == LabelReason.USABLE) & np.isfinite(view.depth)
        self._counts.append((self._on_parts(label, against), self._on_parts(label, agrees)))

    def all(self) -> dict[int, Standing]:
        """The parts of which something is known."""
        against, agrees = (sum(c, np.zeros(self._parts, np.int64)) for c in (zip(*self._counts, strict=True) if self._counts else ((), ())))
        known = against + agrees >= LEAST_PIXELS
        share = against / np.maximum(against + agrees, 1)
        levels = np.select([share >= MOST, share >= SOME], [2, 1], 0)
        names = (Standing.CONFIRMED, Standing.PARTLY, Standing.CONTRADICTED)
        out = dict.fromkeys(np.flatnonzero(self._refused).tolist(), Standing.REFUSED)
        return out | {int(n): names[levels[n]] for n in np.flatnonzero(known)}

    def _on_parts(self, label: Label, chosen: Mask) -> Ints:
        """Number of chosen pixels on each part."""
        return np.bincount(label.part[chosen & (label.part >= 0)], minlength=self._parts)
