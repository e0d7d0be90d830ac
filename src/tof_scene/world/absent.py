# SPDX-License-Identifier: Apache-2.0
"""Absent parts of the CAD: the views measure the surfaces behind the part."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from tof_scene.raycast import Raycaster
from tof_scene.render import render
from tof_scene.world.contradiction import allowance

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float, Mask
    from tof_scene.world.limits import WorldLimits
    from tof_scene.world.seen import Seen

CANDIDATE = 0.4
"""Share of a part's pixels measured behind it from which its absence is tested."""

AGREES = 0.3
"""Largest distance of a measurement from the surface behind the part, as a share of the gap between that surface and the part."""


@dataclass(frozen=True, slots=True)
class Missing:
    """An absent part of the CAD.

    part: its index; views: indices of the views that measure surfaces behind it; pixels: number of these pixels; share: of the pixels
    that distinguish the part from the surface behind it, those that measured the latter.
    """

    part: int
    views: tuple[int, ...]
    pixels: int
    share: float


def missing_parts(
    views: Sequence[Seen], behind: Sequence[Mask], measured: Sequence[Float], spread: float, caster: Raycaster, limits: WorldLimits
) -> tuple[Missing, ...]:
    """The absent parts.

    Args:
        views: views of the session.
        behind: (H, W) pixels of each view that were measured behind the CAD.
        measured: (H, W) depth of each view without the sensor's errors, metres.
        spread: standard deviation of the smooth part of the session's residuals, metres.
        caster: the scene.
        limits: fewest pixels and least share for an absent part.
    """
    candidates = _candidates(views, behind, limits)
    rest = tuple(p for k, p in enumerate(caster.scene.parts) if k not in candidates)
    if not candidates or not rest:
        return ()
    bare = Raycaster(replace(caster.scene, parts=rest, digest=""))
    there, gone = np.zeros((2, len(views), len(caster.scene.parts)), int)
    for number, (seen, z) in enumerate(zip(views, measured, strict=True)):
        mine = np.isin(seen.part, candidates) & np.isfinite(z)
        if not mine.any():
            continue
        without = render(bare, seen.camera, seen.T_cell_camera, footprints=False).depth
        allowed = allowance(seen, spread, limits)
        gap = without - seen.cad
        tells = mine & (gap > 2 * allowed)
        agrees = np.abs(z - without) < np.maximum(1e-3 * limits.agree_mm + allowed, AGREES * gap)
        empty = tells & (z - seen.cad > allowed) & (np.abs(z - without) < z - seen.cad) & agrees
        for k in candidates:
            gone[number, k] = int((empty & (seen.part == k)).sum())
            there[number, k] = int((tells & ~empty & (seen.part == k)).sum())
    found = []
    for k in candidates:
        pixels, share = int(gone[:, k].sum()), gone[:, k].sum() / max(gone[:, k].sum() + there[:, k].sum(), 1)
        if pixels >= limits.absent_px and share >= limits.absent_share:
            views_of = tuple(int(v) for v in np.flatnonzero(gone[:, k] >= limits.object_view_px))
            found.append(Missing(k, views_of, pixels, float(share)))
    return tuple(found)


def _candidates(views: Sequence[Seen], behind: Sequence[Mask], limits: WorldLimits) -> list[int]:
    """Parts with many pixels measured behind the CAD."""
    parts = 1 + max(int(v.part.max(initial=-1)) for v in views)
    every, empty = np.zeros(parts), np.zeros(parts)
    for seen, far in zip(views, behind, strict=True):
        on = (seen.part >= 0) & np.isfinite(seen.depth)
        every += np.bincount(seen.part[on], minlength=parts)
        empty += np.bincount(seen.part[on & far], minlength=parts)
    return [int(k) for k in np.flatnonzero((empty >= limits.absent_px / 2) & (empty > CANDIDATE * every))]
