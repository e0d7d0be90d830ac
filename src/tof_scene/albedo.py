# SPDX-License-Identifier: Apache-2.0
"""Albedo of the parts at the camera's wavelength, estimated from measured amplitude: CAD states albedo for visible light, if at all."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_core.stats import group_medians

if TYPE_CHECKING:
    from tof_core.arrays import Float, Ints

RINGS = 8
"""Rings about the image's centre, each with its own brightness: most illuminations are weaker towards the border of the image."""
ROUNDS = 4
"""Rounds of the median polish: further rounds change the levels by less than one per cent."""
LEAST_PIXELS = 50
"""Fewest pixels of a part for an estimate; with fewer, its stated albedo is kept."""
LOWEST, HIGHEST = 0.02, 0.98
"""Albedo of soot, and of fresh white paint."""


def albedo_by_amplitude(stated: Float, part: Ints, returned: Float, off_axis: Float) -> Float:
    """(P,) albedo of the parts with which amplitude divided by albedo cos(incidence) / r^2 is the same for all parts.

    An amplitude image has no absolute scale: the mean of ln albedo over the pixels stays the stated one.

    Args:
        stated: (P,) albedo of the parts in the scene.
        part: (n,) part in each pixel, over all views.
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
        level = group_medians(returned - brightness[ring], part, len(stated))
        brightness = group_medians(returned - level[part], ring, RINGS)
    shift = float(count[seen] @ (np.log(stated[seen]) - level[seen]) / count[seen].sum())
    out = np.array(stated, float)
    out[seen] = np.clip(np.exp(level[seen] + shift), LOWEST, HIGHEST)
    return out
