# SPDX-License-Identifier: Apache-2.0
"""Places of the cell that foreign light falls on, such as a patch of sun: there, and in every view, noise exceeds the photon law."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tof_core import se3
from tof_core.shares import in_percent
from tof_core.stats import CHI2_MEDIAN, second_differences
from tof_gap.seen.finding import CONFIDENT, Finding, most
from tof_sensor.effects.ambient import Ambient

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float, Ints, Mask
    from tof_gap.limits.foreign import LitLimits
    from tof_gap.seen.evidence.view import ViewEvidence
    from tof_sensor.effects.photon_law import PhotonLaw

FAR = 1 << 20
"""More cubes than any cell has along an axis: with it, three indices make one number."""
QUIETEST = 0.25
"""Quantile of the cubes' noise that is the level of quiet places, which must keep to the law."""


@dataclass(frozen=True, slots=True, eq=False)
class Places:
    """Cubes of the cell as single views see them, one row per view and cube.

    view, cube (n,) indices; pixels (n,) their number; ratio (n,) variance of noise over the photon law's, by the median of the pixels.
    """

    view: Ints
    cube: Ints
    pixels: Ints
    ratio: Float

    def of_cubes(self, rows: Mask) -> Float:
        """(cubes,) mean of ln ratio over the views of a mask, weighted by pixels; NaN for a cube that none of them sees."""
        weight = np.bincount(self.cube[rows], self.pixels[rows], self.cube.max() + 1)
        total = np.bincount(self.cube[rows], self.pixels[rows] * np.log(self.ratio[rows]), self.cube.max() + 1)
        return np.where(weight > 0, total / np.maximum(weight, 1), np.nan)


def lit_places(views: Sequence[ViewEvidence], law: PhotonLaw, limits: LitLimits) -> Finding | None:
    """`ambient` where noise exceeds the stated law at some places of the cell, the same in all views, and keeps to it at others.

    The camera's own noise follows amplitude, range and the pixel, not the place: light that falls on a part of the cell does.
    """
    seen = places(views, law, limits)
    if seen is None:
        return None
    even, odd = (seen.of_cubes(seen.view % 2 == k) for k in (0, 1))
    both = np.isfinite(even) & np.isfinite(odd)
    if both.sum() < limits.cubes:
        return None
    ln_ratio, pixels = seen.of_cubes(np.ones(len(seen.view), bool)), np.bincount(seen.cube, seen.pixels)
    level = float(np.quantile(ln_ratio[both], QUIETEST))
    lit, quiet = (both & beyond for beyond in (ln_ratio > level + np.log(limits.lit), ln_ratio < level + np.log(limits.quiet)))
    share = float(pixels[lit].sum() / pixels[both].sum())
    enough = min(share, float(pixels[quiet].sum() / pixels[both].sum())) >= limits.share
    if not enough or abs(level) > np.log(limits.quiet) or np.corrcoef(even[both], odd[both])[0, 1] < limits.alike:
        return None
    times = float(np.exp(np.average(ln_ratio[lit], weights=pixels[lit]) - level))
    reached = seen.view[lit[seen.cube]]
    size_m = _surface_m(views, law, share * (times - 1.0))
    light = Ambient(surface_m=size_m, reference=law.reference)
    noise = [np.where(v.smooth, light.noise(v.frame) / np.sqrt(v.view.captures), np.nan) for v in views]
    note = f"noise {np.sqrt(times):.1f} times that of the photon law in --sensor on {in_percent(share)} of the pixels, at the same places in {len(np.unique(reached))} views"
    return Finding(light, CONFIDENT, share=np.stack(noise), note=note, beside=law, structure=True)


def places(views: Sequence[ViewEvidence], law: PhotonLaw, limits: LitLimits) -> Places | None:
    """The cubes that the views see with `pixels` and more; None without any."""
    rows = [_of_view(v, law, limits) for v in views]
    cube = np.concatenate([c for c, *_ in rows])
    if not len(cube):
        return None
    view = np.repeat(np.arange(len(views)), [len(c) for c, *_ in rows])
    cube = np.unique(cube, return_inverse=True)[1]
    return Places(view, cube, np.concatenate([n for _, n, _ in rows]), np.concatenate([r for *_, r in rows]))


def _of_view(view: ViewEvidence, law: PhotonLaw, limits: LitLimits) -> tuple[Ints, Ints, Float]:
    """Cubes (n,) of one view, pixels in each, and the ratio of variances there."""
    d2 = second_differences(np.where(view.smooth, view.residual * view.frame.length, np.nan), axis=1)
    expected = law.variance(view.frame.amplitude, view.frame.surroundings_m2)[:, 1:-1] / view.view.captures
    seen = np.isfinite(d2) & (view.frame.amplitude[:, 1:-1] > 0)
    points = se3.apply(view.rendering.T_cell_camera, view.frame.points[:, 1:-1][seen])
    index = np.floor(points / (limits.cube_mm * 1e-3)).astype(np.int64) + FAR // 2
    cube, which, count = np.unique(index @ [FAR * FAR, FAR, 1], return_inverse=True, return_counts=True)
    relative = d2[seen] ** 2 / np.maximum(expected[seen], 1e-14)
    order = np.lexsort((relative, which))
    ends = np.cumsum(count)
    median = relative[order][ends - count + count // 2] / CHI2_MEDIAN
    enough = (count >= limits.pixels) & (median > 0)
    return cube[enough], count[enough], median[enough]


def _surface_m(views: Sequence[ViewEvidence], law: PhotonLaw, excess: float) -> float:
    """Metres: `Ambient.surface_m` whose variance is, in the median, `excess` times the law's."""
    ratios = []
    for v in views:
        amplitude, around2 = v.frame.amplitude[v.smooth], v.frame.surroundings_m2[v.smooth]
        ratios.append(Ambient(surface_m=1.0, reference=law.reference).variance(amplitude, around2) / law.variance(amplitude, around2))
    return min(float(np.sqrt(excess / np.median(np.concatenate(ratios)))), most(Ambient, "surface_m"))
