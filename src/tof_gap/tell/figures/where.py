# SPDX-License-Identifier: Apache-2.0
"""Where the gap lies: regions of the CAD with their share of it, and what it varies with."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import distance_transform_edt
from scipy.special import ndtr

from tof_core.stats import blocks, joined
from tof_gap.seen.evidence.residual import single

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from tof_core.arrays import Float, Ints, Mask
    from tof_gap.limits.report import ReportLimits
    from tof_gap.seen.evidence.view import ViewEvidence
    from tof_scene.scene import Scene


@dataclass(frozen=True, slots=True)
class Region:
    """A patch of one part's surface; share: of the whole gap's energy above the floor."""

    id: int
    name: str
    part: str
    share: float
    gap_mm: float
    rmse_mm: float
    bias_mm: float
    pixels: int


@dataclass(frozen=True, slots=True)
class Bin:
    """The gap over one interval of a quantity: its ends, mean, RMS and floor in mm, pixels."""

    low: float
    high: float
    bias_mm: float
    rmse_mm: float
    floor_mm: float
    pixels: int


def regions(
    views: Sequence[ViewEvidence],
    gap: Sequence[Float],
    floor2: Sequence[Float],
    region: Sequence[Ints],
    scene: Scene,
    limits: ReportLimits,
) -> list[Region]:
    """Regions whose gap is significant, largest share first; `gap` (H, W) metres per view.

    The chi-square of the means of a region's blocks (`block_px` a side) against the floor gives a p-value; the false discovery rate
    over all regions is controlled.
    """
    ids = np.unique(np.concatenate([np.unique(r[r >= 0]) for r in region]))
    rows = [_region_sums(int(i), views, gap, floor2, region, limits.block_px) for i in ids]
    excess = np.array([max(r[1] - r[2], 0.0) for r in rows])
    whole = max(float(excess.sum()), 1e-18)
    named = _discoveries(np.array([r[4] for r in rows]), limits.where.false_discovery)
    out = []
    for i, (n, e2, _, mean, _, part), over, share, seen in zip(ids, rows, excess, excess / whole, named, strict=True):
        if seen and share > 0:
            name = scene.parts[part].name
            above, rmse = (1e3 * float(np.sqrt(square / n)) for square in (over, e2))
            out.append(Region(int(i), f"{name}, face {int(i)}", name, float(share), above, rmse, 1e3 * mean, int(n)))
    return sorted(out, key=lambda r: -r.share)


def _region_sums(
    i: int,
    views: Sequence[ViewEvidence],
    gap: Sequence[Float],
    floor2: Sequence[Float],
    region: Sequence[Ints],
    block_px: int,
) -> tuple[float, float, float, float, float, int]:
    """(pixels, sum e^2, sum floor^2, mean e, p-value, part) of one region."""
    sums, z, part = np.zeros(4), [], 0
    for v, g, f, r in zip(views, gap, floor2, region, strict=True):
        here = (r == i) & np.isfinite(g)
        if not here.any():
            continue
        squares, e, f2 = blocks(here, block_px), g[here], f[here]
        z.append(squares.mean(e) ** 2 / (squares.sum(f2) / squares.count**2))
        sums += [len(e), (e**2).sum(), f2.sum(), e.sum()]
        part = int(np.bincount(v.rendering.part[here].astype(np.int64)).argmax())
    if not z:
        return 1.0, 0.0, 0.0, 0.0, 1.0, part
    chi2 = np.concatenate(z)
    # Sum of chi-squares by Wilson and Hilferty's cube root.
    m = len(chi2)
    cube = (chi2.sum() / m) ** (1 / 3)
    p = float(ndtr((1 - 2 / (9 * m) - cube) / np.sqrt(2 / (9 * m))))
    pixels, e2, floor, total = (float(s) for s in sums)
    return pixels, e2, floor, total / pixels, p, part


def _discoveries(p: Float, rate: float) -> Float:
    """(n,) bool: hypotheses that are rejected at a false discovery rate (Benjamini and Hochberg 1995)."""
    order = np.argsort(p, kind="stable")
    below = p[order] <= rate * np.arange(1, len(p) + 1) / max(len(p), 1)
    last = np.flatnonzero(below).max() + 1 if below.any() else 0
    out = np.zeros(len(p), bool)
    out[order[:last]] = True
    return out


def by_quantity(
    views: Sequence[ViewEvidence],
    gap: Sequence[Float],
    floor2: Sequence[Float],
    bins: int,
) -> dict[str, list[Bin]]:
    """The gap against each quantity that may cause it, in bins of equal pixel numbers."""
    return {name: _bins(value, views, gap, floor2, bins) for name, value in QUANTITIES.items()}


def _constant(view: ViewEvidence, value: float) -> Float:
    return np.broadcast_to(value, view.residual.shape)


QUANTITIES: dict[str, Callable[[ViewEvidence], Float]] = {
    "range_m": lambda v: v.frame.radial,
    "incidence_deg": lambda v: np.degrees(v.rendering.incidence.astype(np.float64)),
    "amplitude": lambda v: v.frame.amplitude.astype(np.float64),
    "edge_px": lambda v: np.asarray(distance_transform_edt(~v.edge)),
    "time_s": lambda v: _constant(v, v.frame.context.time_s),
    "temperature_c": lambda v: _constant(v, v.frame.context.temperature),
    "speed_m_s": lambda v: _constant(v, float(np.linalg.norm(v.frame.context.twist[:3]))),
    "column": lambda v: np.broadcast_to(np.arange(v.residual.shape[1], dtype=float), v.residual.shape),
    "row": lambda v: np.broadcast_to(np.arange(v.residual.shape[0], dtype=float)[:, None], v.residual.shape),
    "concavity": lambda v: v.concavity.astype(np.float64),
}
"""Quantities that the gap may vary with, (H, W) per view."""


def _bins(
    value: Callable[[ViewEvidence], Float], views: Sequence[ViewEvidence], gap: Sequence[Float], floor2: Sequence[Float], bins: int
) -> list[Bin]:
    """The gap by one quantity. The quantity is computed twice for each view, since the images of all views take gigabytes."""
    q = joined((_known(value(v), g)[0] for v, g in zip(views, gap, strict=True)), sum(g.size for g in gap))
    if len(q) == 0 or np.ptp(q) == 0:
        return []
    edges = np.unique(np.quantile(q, np.linspace(0, 1, bins + 1), overwrite_input=True))
    del q
    n, sums = np.zeros(len(edges) - 1, np.int64), np.zeros((3, len(edges) - 1))
    for v, g, f in zip(views, gap, floor2, strict=True):
        here, seen = _known(value(v), g)
        which = np.clip(np.searchsorted(edges, here, side="right") - 1, 0, len(n) - 1)
        n += np.bincount(which, minlength=len(n))
        e = g[seen]
        sums += [np.bincount(which, w, len(n)) for w in (e, e * e, f[seen])]
    mean, square, floor = sums / np.maximum(n, 1)
    return [
        Bin(float(a), float(b), 1e3 * float(m), 1e3 * float(np.sqrt(s)), 1e3 * float(np.sqrt(fl)), int(k))
        for a, b, m, s, fl, k in zip(edges[:-1], edges[1:], mean, square, floor, np.maximum(n, 1), strict=True)
    ]


def _known(quantity: Float, gap: Float) -> tuple[Float, Mask]:
    """(n,) the quantity of the pixels where it and the gap are known, in single precision, and the mask of these pixels (H, W)."""
    seen = np.isfinite(quantity) & np.isfinite(gap)
    return single(quantity[seen]), seen
