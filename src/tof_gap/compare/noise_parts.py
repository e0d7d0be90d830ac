# SPDX-License-Identifier: Apache-2.0
"""Noise of whole rows, of whole columns and of single pixels in two sessions, which the median noise of a pixel does not show."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tof_gap.compare.levels import Level
from tof_gap.seen.evidence.pattern import beside_pixels, single_pixels
from tof_gap.seen.evidence.residual import over_mean
from tof_gap.seen.noise.effects import BY, median_m, of_their_own, stand_out
from tof_gap.seen.noise.lines import line_noise, line_noise_by_view
from tof_gap.seen.noise.pixels import noise_by_view, noisy_pixels
from tof_sensor.effects.noise import Noise

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float
    from tof_gap.limits.noise import NoiseLimits
    from tof_gap.seen.evidence.view import ViewEvidence

OF_PIXELS = "of single pixels"
SURE = 2.0
"""Standard errors by which the noise of two sessions must differ: 1 in 20 by chance, of a difference that also exceeds a factor."""
LEAST_VIEWS = 3
"""Fewest views with the noise from which its spread over the views is known."""


class Measured(NamedTuple):
    """A part of a session's noise.

    size_mm: of one capture along the ray; shown: whether it is more than chance; named: whether it is also more than a diagnosis leaves
    unnamed; by_view (V,): size in each view, in a unit of its own; light (V,): median amplitude of each view.
    """

    size_mm: float
    shown: bool
    named: bool
    by_view: Float
    light: Float

    def logarithms(self, unit: float = 1.0) -> tuple[Float, Float]:
        """(n,) of size and of light over `unit`, of the views that show the noise."""
        seen = (self.by_view > 0.0) & (self.light > 0.0)
        return np.log(self.by_view[seen]), np.log(self.light[seen] / unit)


def measured(views: Sequence[ViewEvidence], limits: NoiseLimits) -> dict[str, Measured]:
    """The parts of a session's noise; views: less all smooth bias."""
    usual_mm, ratio = 1e3 * median_m(views), 1e3 * over_mean(views)
    if usual_mm == 0.0:
        return {}
    # A part of a quarter of the noise changes the total by 3 %; single pixels stand out by as much where light is weak.
    little_mm = limits.line_share * usual_mm
    light = np.array([float(np.median(v.frame.amplitude[v.smooth])) if v.smooth.any() else np.nan for v in views])
    out = {}
    for axis in (1, 0):
        lines = line_noise(views, axis, limits.lines)
        size_mm = ratio * lines.size_m
        shown = lines.sigma > limits.lines.sigma
        named = shown and size_mm > max(limits.line_mm, little_mm)
        out[BY[axis]] = Measured(size_mm, shown, named, line_noise_by_view(views, axis, limits.lines), light)
    offsets = single_pixels(views)
    beside = beside_pixels(views, offsets)
    pixels = noisy_pixels(beside, limits.pixels)
    size_mm = ratio * pixels.rms_m
    shown = stand_out(pixels, limits)
    large = ratio * pixels.size_m > limits.pixels.own_mm and size_mm > little_mm
    named = shown and large and of_their_own(pixels, beside, offsets, limits)
    out[OF_PIXELS] = Measured(size_mm, shown, named, noise_by_view(beside, pixels.where), light)
    return out


def part_apart(
    real: Sequence[ViewEvidence], simulated: Sequence[ViewEvidence], limits: NoiseLimits, factor: float, absent: float, unit: float | None
) -> tuple[str, Level] | None:
    """The part of the noise in which two sessions differ most, and its size in mm in both; None where none differs.

    A part differs if it would be named in a session, if the sizes differ by `factor`, also at equal light (`apart`), and by more than a diagnosis leaves unnamed. A session
    has it if its views show it, also where it is too little to be named, and it is not less than a share of `absent` of the other's.

    Args:
        real: the camera's views, less all smooth bias.
        simulated: the simulator's.
        limits: when noise is more than chance.
        factor: ratio of two noises from which they differ.
        absent: share of the larger size up to which the smaller one is none.
        unit: the simulator's unit of amplitude over the camera's; None where the amplitudes are not comparable.
    """
    one, other = measured(real, limits), measured(simulated, limits)
    least_mm = {OF_PIXELS: limits.pixels.own_mm * float(np.sqrt(limits.pixel_share))} | dict.fromkeys(BY, limits.line_mm)
    found: dict[str, tuple[float, Level]] = {}
    for part in one.keys() & other.keys():
        a, b = one[part], other[part]
        has = a.shown and a.size_mm >= absent * b.size_mm, b.shown and b.size_mm >= absent * a.size_mm
        level = Level(Noise.NAME, a.size_mm, b.size_mm, {}, has)
        excess_mm = float(np.sqrt(abs(a.size_mm**2 - b.size_mm**2)))
        if (a.named or b.named) and not level.within(factor) and excess_mm > least_mm[part] and apart(a, b, factor, unit):
            found[part] = (excess_mm, level)
    most = max(found, key=lambda part: found[part][0], default=None)
    return None if most is None else (most, found[most][1])


def apart(one: Measured, other: Measured, factor: float, unit: float | None) -> bool:
    """Whether two noises differ by `factor` and by more than chance, whether they are constant in metres or in electrons.

    Two sessions see other light. Noise of the supply or of unstable pixels is constant in electrons: in metres it is proportional to
    1 / amplitude, and it varies by the content of each view. So the logarithms of the views' sizes are compared, as they are and times
    the light, where its `unit` in the other session over that in the one is known. Noise that a session hardly shows is compared by its size alone.
    """
    sides = [one.logarithms(), other.logarithms(unit or 1.0)]
    if min(len(size) for size, _ in sides) < LEAST_VIEWS:
        return True
    differences = []
    for power in (0.0,) if unit is None else (0.0, 1.0):
        values = [size + power * light for size, light in sides]
        error = float(np.sqrt(sum(v.var(ddof=1) / len(v) for v in values)))
        difference = float(values[1].mean() - values[0].mean())
        differences.append(np.sign(difference) * (abs(difference) > max(np.log(factor), SURE * error)))
    return bool(abs(sum(differences)) == len(differences))
