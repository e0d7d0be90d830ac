# SPDX-License-Identifier: Apache-2.0
"""Scores of methods over views: all pixels, pixels common to all methods, per view, and by range, incidence, albedo, edge and part."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from tof_core.metrics import DepthError, depth_error
from tof_eval.pooled import PooledError
from tof_scene.maps import edge_distance

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from tof_core.arrays import Image, Mask
    from tof_eval.methods import Estimate
    from tof_eval.reference import Judged
    from tof_scene.render import Rendering

BINS: dict[str, tuple[float, ...]] = {
    "range_m": (0, 0.3, 0.5, 0.7, 0.9, 1.2, 1.6, 2.2, 100),
    "incidence_deg": (0, 15, 30, 45, 60, 75, 90),
    "albedo": (0, 0.1, 0.25, 0.5, 0.75, 1.01),
    "edge_px": (0, 1.5, 3, 8, 10_000),
}
WRONG_M = 0.01
"""Depth error in metres beyond which a pixel is wrong."""
FAR_PX = 9_999.0
"""Distance to the next edge, in pixels, in a view without edges; it is in the last bin."""
FLYING_PX = 1.5
"""Largest distance of a flying pixel from an edge, in pixels."""


@dataclass(slots=True)
class MethodScore:
    """Scores of one method."""

    total: PooledError = field(default_factory=PooledError)
    common: PooledError = field(default_factory=PooledError)
    captures: list[DepthError] = field(default_factory=list)
    captures_common: list[DepthError] = field(default_factory=list)
    by: dict[str, dict[str, PooledError]] = field(default_factory=lambda: defaultdict(lambda: defaultdict(PooledError)))
    seconds: list[float] = field(default_factory=list)
    sigma: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    """Numbers of pixels: with a sigma; with an error within one sigma; within two."""
    flying_left: int = 0
    flying_raw: int = 0

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers for JSON: millimetres, shares, per cent."""
        n = self.sigma[0]
        return {
            "all": plain(self.total.error),
            "equal_coverage": plain(self.common.error),
            "equal_coverage_share": self.common.pixels / self.total.reference if self.total.reference else None,
            "captures": [plain(e) for e in self.captures],
            "captures_equal_coverage": [plain(e) for e in self.captures_common],
            "by": {axis: {name: plain(p.error) for name, p in sorted(bins.items())} for axis, bins in self.by.items()},
            "ms_per_frame": 1e3 * float(np.median(self.seconds)) if self.seconds else None,
            "sigma_pixels": int(n),
            "within_1_sigma": self.sigma[1] / n if n else None,
            "within_2_sigma": self.sigma[2] / n if n else None,
            "flying_left_wrong": self.flying_left / self.flying_raw if self.flying_raw else None,
        }


class Scores:
    """Collects the scores of several methods view by view."""

    def __init__(self, names: list[str], parts: tuple[str, ...]) -> None:
        self.methods = {name: MethodScore() for name in names}
        self.parts = parts
        self.views = 0

    def add(self, judged: Judged, estimates: Mapping[str, Estimate]) -> None:
        """Add one view."""
        self.views += 1
        true, rendering = judged.reference, judged.rendering
        common = np.logical_and.reduce([np.isfinite(e.depth) for e in estimates.values()])
        edge = np.minimum(edge_distance(rendering), FAR_PX)
        bins = list(_bins(true, rendering, edge, self.parts))
        raw = judged.captures[-1].depth
        flying = (edge <= FLYING_PX) & (np.abs(raw - true) > WRONG_M)
        for name, e in estimates.items():
            score = self.methods[name]
            score.total.add(e.depth, true)
            score.common.add(e.depth, true, common)
            score.captures.append(depth_error(e.depth, true))
            score.captures_common.append(depth_error(e.depth, true, common))
            score.seconds.append(e.seconds)
            for axis, bin_name, where in bins:
                score.by[axis][bin_name].add(e.depth, true, where)
            score.flying_raw += int(flying.sum())
            score.flying_left += int(((np.abs(e.depth - true) > WRONG_M) & (edge <= FLYING_PX)).sum())
            if e.sigma is not None:
                _count_sigma(score, e.depth - true, e.sigma)

    def to_dict(self) -> dict[str, Any]:
        """The scores of every method."""
        return {name: score.to_dict() for name, score in self.methods.items()}


def _count_sigma(score: MethodScore, error: Image, sigma: Image) -> None:
    both = np.isfinite(error) & np.isfinite(sigma) & (sigma > 0)
    ratio = np.abs(error[both]) / sigma[both]
    for k, count in enumerate((ratio.size, (ratio <= 1).sum(), (ratio <= 2).sum())):
        score.sigma[k] += float(count)


def _bins(true: Image, rendering: Rendering, edge: Image, parts: tuple[str, ...]) -> Iterator[tuple[str, str, Mask]]:
    values = {"range_m": true, "incidence_deg": np.degrees(rendering.incidence), "albedo": rendering.albedo, "edge_px": edge}
    for axis, limits in BINS.items():
        for low, high in pairwise(limits):
            where = (values[axis] >= low) & (values[axis] < high)
            if where.any():
                yield axis, _name(low, high), where
    for k, part in enumerate(parts):
        where = rendering.part == k
        if where.any():
            yield "part", part, where


def _name(low: float, high: float) -> str:
    return f"from {low:g}" if high > 99 else f"{low:g} to {min(high, 1.0) if high == 1.01 else high:g}"


def plain(e: DepthError) -> dict[str, float | int | None]:
    """Errors in millimetres; `std_mm` is the standard deviation about the bias; None where nothing was compared."""
    if not e.pixels:
        return {
            "pixels": 0,
            "reference": e.reference,
            "completeness": 0.0,
            "mae_mm": None,
            "bias_mm": None,
            "rmse_mm": None,
            "std_mm": None,
            "alignment": None,
        }
    return {
        "pixels": e.pixels,
        "reference": e.reference,
        "completeness": e.completeness,
        "mae_mm": 1e3 * e.mae,
        "bias_mm": 1e3 * e.bias,
        "rmse_mm": 1e3 * e.rmse,
        "std_mm": 1e3 * float(np.sqrt(max(e.rmse**2 - e.bias**2, 0.0))),
        "alignment": e.alignment,
    }
