# SPDX-License-Identifier: Apache-2.0
"""Pixels that have no depth since too much light returns to them: no effect of the camera, but a recording to repeat."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_core.reasons import Reason
from tof_core.shares import in_percent
from tof_gap.seen.missing.lost import brightest, saturating
from tof_gap.tell.unexplained import by_part

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Mask
    from tof_gap.limits.missing import MissingLimits
    from tof_gap.seen.evidence.view import ViewEvidence

MOST = 0.5
"""Share of the over-exposed pixels from which one part is named as their place."""


def over_exposed(views: Sequence[ViewEvidence], names: Sequence[str], limits: MissingLimits, least: float) -> str:
    """What to record again where `least` of the pixels that see the CAD are over-exposed; empty where fewer are.

    names: of the scene's parts, in their order.
    """
    too_bright = brightest(views, limits)
    seeing = [v.frame.valid & ~v.edge for v in views]
    gone = [saturated(v, too_bright) & s for v, s in zip(views, seeing, strict=True)]
    count = sum(int(g.sum()) for g in gone)
    share = count / max(sum(int(s.sum()) for s in seeing), 1)
    if share < least:
        return ""
    of_part = by_part(views, [g.astype(float) for g in gone], len(names))
    worst = int(np.argmax(of_part))
    where = f", most of them on {names[worst]}" if of_part[worst] > MOST * count else ""
    return (
        f"the same with a shorter exposure or from farther away, since {in_percent(share)} of the pixels that see the CAD "
        f"are over-exposed and have no depth{where}"
    )


def saturated(view: ViewEvidence, too_bright: float) -> Mask:
    """(H, W) pixels without depth that have the code of saturation, or an amplitude of `too_bright` and more there or all around."""
    seen = view.view
    return np.asarray((seen.reason == Reason.SATURATED) | (~seen.valid & saturating(view, too_bright)))
