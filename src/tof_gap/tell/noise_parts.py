# SPDX-License-Identifier: Apache-2.0
"""Noise of whole rows, of whole columns and of single pixels in two sessions, which the median noise of a pixel does not show."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tof_gap.seen.line_noise import line_noise
from tof_gap.seen.noise import BY, median_m, of_their_own, stand_out
from tof_gap.seen.pattern import beside_pixels, single_pixels
from tof_gap.seen.pixel_noise import noisy_pixels
from tof_gap.seen.residual import over_mean
from tof_gap.tell.levels_apart import Level
from tof_sensor.effects.noise import Noise

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_gap.limits.noise import NoiseLimits
    from tof_gap.seen.residual import ViewEvidence

OF_PIXELS = "of single pixels"


class Measured(NamedTuple):
    """A part of a session's noise.

    size_mm: of one capture along the ray; shown: whether it is more than chance; named: whether it is also more than a diagnosis leaves
    unnamed.
    """

    size_mm: float
    shown: bool
    named: bool


def measured(views: Sequence[ViewEvidence], limits: NoiseLimits) -> dict[str, Measured]:
    """The parts of a session's noise; views: less all smooth bias."""
    usual_mm, ratio = 1e3 * median_m(views), 1e3 * over_mean(views)
    if usual_mm == 0.0:
        return {}
    # A part of a quarter of the noise changes the total by 3 %; single pixels stand out by as much where light is weak.
    little_mm = limits.line_share * usual_mm
    out = {}
    for axis in (1, 0):
        lines = line_noise(views, axis, limits.lines)
        size_mm = ratio * lines.size_m
        shown = lines.sigma > limits.lines.sigma
        out[BY[axis]] = Measured(size_mm, shown, shown and size_mm > max(limits.line_mm, little_mm))
    offsets = single_pixels(views)
    beside = beside_pixels(views, offsets)
    pixels = noisy_pixels(beside, limits.pixels)
    size_mm = ratio * pixels.rms_m
    shown = stand_out(pixels, limits)
    large = ratio * pixels.size_m > limits.pixels.own_mm and size_mm > little_mm
    out[OF_PIXELS] = Measured(size_mm, shown, shown and large and of_their_own(pixels, beside, offsets, limits))
    return out


def part_apart(
    real: Sequence[ViewEvidence], simulated: Sequence[ViewEvidence], limits: NoiseLimits, factor: float, absent: float
) -> tuple[str, Level] | None:
    """The part of the noise in which two sessions differ most, and its size in mm in both; None where none differs.

    A part differs if it would be named in a session, if the sizes differ by `factor`, and by more than a diagnosis leaves unnamed. A session
    has it if its views show it, also where it is too little to be named, and it is not less than a share of `absent` of the other's.

    Args:
        real: the camera's views, less all smooth bias.
        simulated: the simulator's.
        limits: when noise is more than chance.
        factor: ratio of two noises from which they differ.
        absent: share of the larger size up to which the smaller one is none.
    """
    one, other = measured(real, limits), measured(simulated, limits)
    least_mm = {OF_PIXELS: limits.pixels.own_mm * float(np.sqrt(limits.pixel_share))} | dict.fromkeys(BY, limits.line_mm)
    found: dict[str, tuple[float, Level]] = {}
    for part in one.keys() & other.keys():
        a, b = one[part], other[part]
        has = a.shown and a.size_mm >= absent * b.size_mm, b.shown and b.size_mm >= absent * a.size_mm
        level = Level(Noise.NAME, a.size_mm, b.size_mm, {}, has)
        excess_mm = float(np.sqrt(abs(a.size_mm**2 - b.size_mm**2)))
        if (a.named or b.named) and not level.within(factor) and excess_mm > least_mm[part]:
            found[part] = (excess_mm, level)
    most = max(found, key=lambda part: found[part][0], default=None)
    return None if most is None else (most, found[most][1])
