# SPDX-License-Identifier: Apache-2.0
"""Steps of a camera's own code, from the jumps of single pixels over the captures of a dwell.

A register that counts time or phase is often rounded before offsets of the pixels are subtracted and range is turned into depth. No grid is
then common to the pixels of an image, but each pixel still jumps by whole steps of the code. Where the register holds a ratio of charges, a
step is longer at some ranges than at others; still, no pixel jumps by less than one.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_preproc.quantum import FINEST

if TYPE_CHECKING:
    from tof_core.arrays import Float, Image
    from tof_preproc.stack import Stack

BLOCKS = 12
"""Blocks of pixels that are looked at: some 3000 pixels, in a fortieth of the time that a frame takes."""
ROUNDED = 1.5
"""A jump beyond this multiple of the message's own step is more than rounding; a jump may be off by as much."""
COARSER = 5.0
"""Least ratio of the code's step to the message's: jumps that follow no code would lie within `ROUNDED` of its multiples to 60 %."""
LONGEST_M = 0.1
"""Longest step, metres: longer jumps are wrapped phases."""
ON_CODE = 0.95
"""Share of the jumps that must be whole steps, or no shorter than `SHORTEST`; the others are outliers."""
SHORTEST = 0.5
"""Least jump over the usual one, where steps differ with range. Of jumps by noise alone, a fifth or more are shorter."""
LEAST_JUMPS, LEAST_SHARE = 300, 0.01
"""Fewest jumps, and their least share in all differences: outliers jump too."""


def step_over_time(stack: Stack, ray_length: Float, message_m: float) -> float:
    """Metres along the ray between the codes of single pixels; 0 where these are not coarser than the message's, or depth is continuous.

    The mean where steps are longer at some ranges.

    Args:
        stack: the captures of a dwell.
        ray_length: (H, W) range along the ray over z.
        message_m: step of the depth in the message, 0 where it is continuous (`quantum_of`).
    """
    if stack.captures < 2:
        return 0.0
    jumps = _differences(stack, ray_length)
    least = max(message_m, FINEST)
    moved = jumps[jumps > ROUNDED * least]
    if len(moved) < max(LEAST_JUMPS, LEAST_SHARE * len(jumps)):
        return 0.0
    step = float(np.median(moved))
    steps = np.maximum(np.round(moved / step), 1.0)
    step = float(moved.sum() / steps.sum())
    whole = np.mean(np.abs(moved - steps * step) < ROUNDED * least)
    none_shorter = np.mean(moved > SHORTEST * step)
    return step if COARSER * least < step < LONGEST_M and max(whole, none_shorter) > ON_CODE else 0.0


def _differences(stack: Stack, ray_length: Float) -> Image:
    """(n,) metres along the ray between a pixel's depths and the next larger ones, of evenly spaced blocks of pixels."""
    blocks, _, lanes = stack.ordered.shape
    taken = np.unique(np.linspace(0, blocks - 1, min(blocks, BLOCKS)).astype(int))
    pixels = taken[:, None] * lanes + np.arange(lanes)
    length = ray_length.ravel()[np.minimum(pixels, ray_length.size - 1)]
    with np.errstate(invalid="ignore"):  # behind the last depth, both are infinite
        apart = np.diff(stack.ordered[taken, : stack.captures], axis=1) * length[:, None]
    inside = np.isfinite(apart) & (pixels < ray_length.size)[:, None]
    return np.asarray(apart[inside])
