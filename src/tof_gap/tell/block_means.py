# SPDX-License-Identifier: Apache-2.0
"""Mean errors of blocks of pixels: neighbours share bias and structure, but not noise."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tof_core.stats import blocks
from tof_gap.seen.evidence.residual import single
from tof_sensor.effect import Evidence

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float, Ints, Mask
    from tof_gap.limits.report import UnexplainedLimits
    from tof_gap.seen.evidence.view import ViewEvidence
    from tof_gap.tell.account import Account


@dataclass(frozen=True, slots=True, eq=False)
class BlockMeans:
    """Per block of one part (b,): pixels, mean error in metres, its variance in m^2 if errors were noise alone, the part, and the view.

    A block counts by its information, the inverse of that variance, as in the fit: pixels of low amplitude may have ten times the noise
    of others, and then show no error of millimetres.
    """

    pixels: Ints
    mean: Float
    white2: Float
    part: Ints
    view: Ints

    @property
    def excess2(self) -> Float:
        """(b,) m^2 by which the squared mean exceeds that of white errors."""
        return np.asarray(self.mean**2 - self.white2)

    @property
    def size2(self) -> float:
        """m^2: mean of `excess2`, weighted by information."""
        return max(float(np.average(self.excess2, weights=1.0 / self.white2)), 0.0)

    def of_parts(self, parts: int, views: int) -> tuple[Float, Float]:
        """(views, parts) sums of excess times information (no unit), and of information (1/m^2)."""
        return self._sums(self.excess2 / self.white2, parts, views), self._sums(1.0 / self.white2, parts, views)

    def pixels_of(self, parts: int, views: int) -> Float:
        """(parts,) pixels."""
        return np.asarray(self._sums(self.pixels, parts, views).sum(axis=0))

    def _sums(self, each: Float | Ints, parts: int, views: int) -> Float:
        """(views, parts) sums over the blocks."""
        return np.asarray(np.bincount(self.view * parts + self.part, each, views * parts), float).reshape(views, parts)


def block_means(views: Sequence[ViewEvidence], left: Sequence[Float], floor2: Sequence[Float], block_px: int, least: int) -> BlockMeans:
    """Means of errors `left` (H, W metres per view) over squares of `block_px` pixels, each part apart; blocks of `least` pixels and more."""
    found: list[tuple[Ints, Float, Float, Ints, Ints]] = []
    for k, (v, e, f) in enumerate(zip(views, left, floor2, strict=True)):
        seen = np.isfinite(e) & (v.rendering.part >= 0)
        by_block = blocks(seen, block_px, v.rendering.part[seen].astype(np.int64))
        n, part = by_block.count, by_block.keys[-1]
        enough = n >= least
        mean, white2 = by_block.mean(e[seen]), v.correlation.area * by_block.sum(f[seen]) / n**2
        found.append((n[enough], mean[enough], white2[enough], part[enough], np.full(int(enough.sum()), k)))
    return BlockMeans(*(np.concatenate(column) for column in zip(*found, strict=True)))


def unbiased2(found: Account, views: Sequence[int]) -> list[Float]:
    """(H, W) m^2 for each of these views of error that is no bias: the floor, the named noise, and the variance of the fixed pattern's map."""
    named = [f.share for f in found.findings if f.effect.EVIDENCE is Evidence.NOISE and f.share is not None]
    floors, unsure2 = found.figures.floors, found.figures.unsure2
    return [single(sum((np.nan_to_num(s[v]) ** 2 for s in named), np.asarray(floors[v], float)) + unsure2) for v in views]


def off_parts(left: BlockMeans, before: BlockMeans, parts: int, views: int, limit: UnexplainedLimits, least_m: float) -> Mask:
    """(parts,) parts whose RMS error above the floor exceeds `least_m`, `noise_share` of their noise, and `share` of the squared error before.

    All three without the view that contributes most.
    """
    (after, known), pixels = left.of_parts(parts, views), left.pixels_of(parts, views)
    most = np.argmax(after, axis=0), np.arange(parts)
    enough = pixels > limit.part_pixels * pixels.sum()
    least = 1.0  # 1/m^2, of a part without a block: else 0 is divided by 0.
    size2 = (after.sum(axis=0) - after[most]) / np.maximum(known.sum(axis=0) - known[most], least)
    was2 = before.of_parts(parts, views)[0].sum(axis=0) / np.maximum(known.sum(axis=0), least)
    noise2 = pixels / np.maximum(known.sum(axis=0), least)
    return np.asarray(enough & (size2 > least_m**2) & (size2 > limit.noise_share**2 * noise2) & (size2 > limit.share * was2))
