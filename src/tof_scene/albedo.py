# SPDX-License-Identifier: Apache-2.0
"""Albedo of the parts at the camera's wavelength, from the amplitude that it measured: CAD states it for visible light, if at all."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from tof_core.arrays import Float, Ints

RINGS = 8
"""Rings about the image's centre, each with a brightness of its own: the lamp of most cameras is weaker towards the border."""
ROUNDS = 4
"""Rounds of the median polish: more change the levels by less than a hundredth."""
LEAST_PIXELS = 50
"""Pixels of a part below which its stated albedo is kept."""
LOWEST, HIGHEST = 0.02, 0.98
"""Albedo of soot, and of fresh white paint."""


def albedo_by_amplitude(stated: Float, part: Ints, returned: Float, off_axis: Float) -> Float:
    """(P,) albedo of the parts, such that amplitude over cos(incidence) / r^2 is alike wherever a part is seen.

    An amplitude image has no absolute scale: the mean of ln albedo over the pixels stays the stated one.

    Args:
        stated: (P,) albedo of the parts in the scene.
        part: (n,) part that each pixel sees, of all views.
        returned: (n,) ln of amplitude times r^2 / cos(incidence); NaN where unknown.
        off_axis: (n,) distance from the image's centre, 1 in its corner.

    Robust against gloss and texture: levels of parts and of rings are medians (Tukey's median polish).
    """
    known = np.isfinite(returned)
    part, returned, ring = part[known], returned[known], np.minimum((RINGS * off_axis[known]).astype(np.int64), RINGS - 1)
    count = np.bincount(part, minlength=len(stated))
    seen = np.flatnonzero(count >= LEAST_PIXELS)
    if not len(seen):
        return np.asarray(stated, float)
    level, brightness = np.zeros(len(stated)), np.zeros(RINGS)
    for _ in range(ROUNDS):
        level = _medians(returned - brightness[ring], part, len(stated))
        brightness = _medians(returned - level[part], ring, RINGS)
    shift = float(count[seen] @ (np.log(stated[seen]) - level[seen]) / count[seen].sum())
    out = np.array(stated, float)
    out[seen] = np.clip(np.exp(level[seen] + shift), LOWEST, HIGHEST)
    return out


def _medians(values: Float, group: Ints, groups: int) -> Float:
    """(groups,) median of each group, 0 of an empty one."""
    order = np.argsort(group, kind="stable")
    parts = np.split(values[order], np.cumsum(np.bincount(group, minlength=groups))[:-1])
    return np.array([np.median(p) if len(p) else 0.0 for p in parts])
