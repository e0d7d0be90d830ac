# SPDX-License-Identifier: Apache-2.0
"""How far the gap shrinks: RMS on held-out views before and after, against the floor, with its 95 % interval."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tof_core.stats import blocks as squares

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float
    from tof_gap.limits.report import ShrinkLimits


ENDS95 = (0.025, 0.975)
"""Quantiles at the ends of a 95 % interval."""
DRAWN = 50
"""Bootstrap sets of blocks that are drawn at once: a thousand sets of a long session take a third of a gigabyte."""


@dataclass(frozen=True, slots=True)
class Errors:
    """Errors over pixels in mm: root mean square, mean absolute, mean."""

    rmse: float
    mae: float
    bias: float


@dataclass(frozen=True, slots=True)
class Shrink:
    """1 - (after^2 - floor^2 + healthy^2) / (before^2 - floor^2 + healthy^2) on RMSE, None where before is at the floor.

    healthy: error of a healthy camera that the poses absorb. The residuals do not show it, and no named effect removes it.
    off_edges_mm: RMS in mm above the noise before and after, of the pixels that neither lie at edges nor wrap; None where those do not count.
    """

    before: Errors
    after: Errors
    floor_mm: float
    shrink: float | None
    ci95: tuple[float, float] | None
    off_edges_mm: tuple[float, float] | None = None

    @property
    def shown_mm(self) -> tuple[float, float]:
        """RMS in mm above the noise before and after, as pictures show it: without pixels at edges and wrapped ones, if these count."""
        return self.off_edges_mm or (self.above_mm(self.before), self.above_mm(self.after))

    @property
    def off_edges(self) -> float | None:
        """Shrink without pixels at edges and wrapped ones; None where these do not count, or where there is no gap without them."""
        if self.off_edges_mm is None or not self.off_edges_mm[0] > 0.0:
            return None
        return 1.0 - (self.off_edges_mm[1] / self.off_edges_mm[0]) ** 2

    def above_mm(self, errors: Errors) -> float:
        """RMS in mm of errors on the held-out views, without noise and pose uncertainty."""
        return above_noise_mm(errors.rmse, self.floor_mm)


@dataclass(frozen=True, slots=True, eq=False)
class HeldOut:
    """Sums over the pixels of each block of the held-out views, from which all figures here are computed.

    Each array is (blocks,): n, and the sums of e, |e|, e^2 before and after, and of floor^2.
    """

    n: Float
    before: Float
    after: Float
    floor2: Float

    def errors(self, which: str, weights: Float | None = None) -> Errors:
        """RMSE, MAE and bias in mm; `weights` (blocks,): how often each block counts."""
        sums = (self.before if which == "before" else self.after) @ (np.ones(len(self.n)) if weights is None else weights)
        n = self.n.sum() if weights is None else self.n @ weights
        mean, absolute, square = sums / max(n, 1.0)
        return Errors(1e3 * float(np.sqrt(square)), 1e3 * float(absolute), 1e3 * float(mean))

    @property
    def floor_mm(self) -> float:
        """RMS in mm of the floor."""
        return 1e3 * float(np.sqrt(self.floor2.sum() / max(self.n.sum(), 1.0)))

    @property
    def above_mm(self) -> tuple[float, float]:
        """RMS in mm before and after, above the floor."""
        before, after = (above_noise_mm(self.errors(which).rmse, self.floor_mm) for which in ("before", "after"))
        return before, after


def above_noise_mm(rmse_mm: float, floor_mm: float) -> float:
    """RMS in mm without noise and pose uncertainty."""
    return float(np.sqrt(max(rmse_mm**2 - floor_mm**2, 0.0)))


def blocks(before: Sequence[Float], after: Sequence[Float], floor2: Sequence[Float], block_px: int) -> HeldOut:
    """Sum errors (H, W) of each held-out view by squares of `block_px` pixels; NaN pixels do not count."""
    parts = [_block_sums(b, a, f, block_px) for b, a, f in zip(before, after, floor2, strict=True)]
    joined = [np.concatenate(p, axis=-1) for p in zip(*parts, strict=True)]
    return HeldOut(*joined)


def _block_sums(before: Float, after: Float, floor2: Float, block_px: int) -> tuple[Float, Float, Float, Float]:
    seen = np.isfinite(before) & np.isfinite(after) & np.isfinite(floor2)
    by_block = squares(seen, block_px)

    def total(values: Float) -> Float:
        return by_block.sum(values[seen])

    def moments(e: Float) -> Float:
        return np.stack([total(e), total(np.abs(e)), total(e * e)])

    return total(seen.astype(float)), moments(before), moments(after), total(floor2)


def measure(held_out: HeldOut, rng: np.random.Generator, limits: ShrinkLimits, unsure2: float = 0.0) -> Shrink:
    """RMS, MAE and bias before and after; the shrink, and a 95 % interval of the shrink by the true effects.

    The interval is that of a block bootstrap, widened by the error of the floor. Its upper end also contains the error of the fitted
    maps: coefficients estimated from few views give maps an error of variance `unsure2` (m^2), by which the true effects would remove
    more. It may exceed 1. Its lower end also contains the error of a healthy camera that poses may absorb beyond the usual, which the
    true effects would not remove. The shrink is 0 where nothing is removed.
    """
    before, after = held_out.errors("before"), held_out.errors("after")
    floor2 = (1e-3 * held_out.floor_mm) ** 2
    healthy2 = (limits.healthy_mm * 1e-3) ** 2
    value = _shrink(before.rmse, after.rmse, floor2, healthy2, limits.above_floor)
    ci = None
    if value is not None and np.array_equal(held_out.before, held_out.after):
        ci = (0.0, 0.0)
    elif value is not None:
        b2, a2, f2 = _drawn(held_out, rng, limits.rounds)
        above = (before.rmse * 1e-3) ** 2 - floor2
        whole = above + healthy2
        # A draw of blocks without a gap has no shrink.
        ratios = ((b2 - a2) / (b2 - f2 + healthy2))[b2 - f2 > limits.drawn_share * above]
        low, high = np.quantile(ratios, ENDS95) if len(ratios) else (value, value)
        floor = abs(value) * limits.noise_known * floor2 / whole
        half = [float(np.hypot(max(side, limits.resolution), floor)) for side in (value - low, high - value)]
        hidden = max((limits.healthy_most_mm * 1e-3) ** 2 - healthy2, 0.0) / whole
        ci = (value - half[0] - hidden, max(value + half[1] + unsure2 / whole, 1.0))
    return Shrink(before, after, held_out.floor_mm, value, ci)


def surely_removed(held_out: HeldOut, rng: np.random.Generator, limits: ShrinkLimits) -> bool:
    """Whether the squared error is less after than before in 97.5 % of the draws of a block bootstrap.

    The interval of a shrink answers another question, of which share is removed: it also contains the errors of the floor and of what
    poses absorb, neither of which changes whether anything is.
    """
    before2, after2, _ = _drawn(held_out, rng, limits.rounds)
    low, _ = np.quantile(before2 - after2, ENDS95)
    return bool(low > 0.0)


def _drawn(held_out: HeldOut, rng: np.random.Generator, rounds: int) -> Float:
    """(3, rounds) m^2: mean squares of error before, error after and floor, over blocks drawn with replacement."""
    sums, count = np.stack([held_out.before[2], held_out.after[2], held_out.floor2, held_out.n], axis=1), len(held_out.n)
    out = np.empty((rounds, 4))
    for start in range(0, rounds, DRAWN):
        some = slice(start, min(start + DRAWN, rounds))
        out[some] = rng.multinomial(count, np.full(count, 1 / count), size=some.stop - start) @ sums
    return np.asarray(out.T[:3] / out.T[3])


def _shrink(before_mm: float, after_mm: float, floor2: float, healthy2: float, above_floor: float) -> float | None:
    """The shrink, or None where the RMS before exceeds the floor by less than the share `above_floor`.

    The floor is known to a few per cent, so the error after may seem to lie below it; the shrink is 1 at most.
    """
    b2, a2 = (before_mm * 1e-3) ** 2, (after_mm * 1e-3) ** 2
    if not b2 > floor2 * (1.0 + above_floor) ** 2:
        return None
    return float((b2 - max(a2, floor2)) / (b2 - floor2 + healthy2))
