# SPDX-License-Identifier: Apache-2.0
"""The first gate: a camera that gives distance along the ray where z was declared."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_core.flat.wide_plane import wide_bend
from tof_gap.seen.evidence.residual import with_codes
from tof_gap.seen.finding import Finding
from tof_gap.solve.start import Start, start
from tof_sensor.effects.radial_depth import RadialDepth

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_align.config import AlignConfig
    from tof_core.arrays import Float
    from tof_core.capture import View
    from tof_gap.config import GapConfig
    from tof_gap.seen.evidence.view import ViewEvidence
    from tof_scene.raycast import Raycaster


def gate(
    views: Sequence[View],
    caster: Raycaster,
    config: GapConfig,
    align: AlignConfig,
    *,
    asked: bool = True,
) -> tuple[Start, Finding | None]:
    """The views as z, brought to the CAD, and `radial_depth` where they were not z.

    Views spread over the session are registered to the CAD as distances, too; the reading with the smaller median residual is believed.
    The poses of few views adapt to either reading; then wide planes in the views decide, which appear bent if distances are read as z.
    Unless `asked`, depth is z.
    """
    views = with_codes(views, config.evidence.level)
    begun = start(views, caster, config, align)
    if not asked:
        return begun, None
    as_z = median_miss(begun.evidence)
    if as_z < config.solve.gate.least_mm * 1e-3:
        return begun, None
    some = np.unique(np.linspace(0, len(views) - 1, config.solve.gate.views).round().astype(int))
    tried = start([views[k].as_z() for k in some], caster, config, align)
    better = median_miss(tried.evidence) <= config.solve.gate.better * median_miss([begun.evidence[k] for k in some])
    if not better and not all(_bends(v) for v in views):
        return begun, None
    begun.hand_over()  # Frees the images of one reading before those of the other are made.
    converted = [v.as_z() for v in views]
    if len(some) < len(views):
        tried.hand_over()
        tried = start(converted, caster, config, align)
    share = np.stack([(v.depth - c.depth).astype(np.float64) for v, c in zip(views, converted, strict=True)])
    note = "the depth image holds distance along the ray"
    return tried, Finding(RadialDepth(share=1.0), 1.0, share=share, corrects=True, note=note)


def _bends(view: View) -> bool:
    """Whether the widest plane of a view appears bent as distances read as z do."""
    found = wide_bend(view.depth, view.camera)
    return found is not None and found.radial


def median_miss(evidence: Sequence[ViewEvidence]) -> float:
    """Metres: median over the session of |measured - rendered|."""
    miss: list[Float] = [np.abs(v.residual[np.isfinite(v.residual) & ~v.edge]) for v in evidence]
    every = np.concatenate(miss)
    return float(np.median(every)) if len(every) else 0.0
