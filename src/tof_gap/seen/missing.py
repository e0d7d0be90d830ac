# SPDX-License-Identifier: Apache-2.0
"""Missing and grossly wrong pixels as evidence: lost returns, wrapped phase, mixed edges."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tof_gap.seen.lost import dropout
from tof_gap.seen.mixed import flying_pixels
from tof_gap.seen.wrapped import phase_wrap

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_gap.limits.seen import MissingLimits
    from tof_gap.seen.finding import Finding
    from tof_gap.seen.residual import ViewEvidence


def missing_effects(views: Sequence[ViewEvidence], limits: MissingLimits, *, blurred: bool = False) -> list[Finding]:
    """`dropout`, `phase_wrap` and `flying_pixels` where the pixels show them; `blurred`: motion mixes edges of its own."""
    found = (dropout(views, limits), phase_wrap(views, limits), None if blurred else flying_pixels(views, limits))
    return [f for f in found if f is not None]
