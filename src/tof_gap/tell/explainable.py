# SPDX-License-Identifier: Apache-2.0
"""The most that any model could explain: what the named effects do, and on what they leave a ridge on random features of everything known."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_core.stats import blocks
from tof_sensor.geometry import cell_points

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float
    from tof_gap.limits.report import ExplainableLimits
    from tof_gap.seen.residual import ViewEvidence
    from tof_gap.solved import Split
    from tof_gap.tell.shrink import Shrink

WIDTHS = (0.3, 1.0, 3.0)
"""Scales of the features, in standard deviations of the inputs (Rahimi and Recht 2007)."""
RIDGES = (3.0, 0.3, 0.03, 0.003)
"""Strengths of the ridge, relative to the data's weight; no regression at all is tried too."""


def explainable(views: Sequence[ViewEvidence], left: Sequence[Float], split: Split, gap: Shrink, limits: ExplainableLimits) -> float | None:
    """Share of the held-out gap above the floor that the best known model explains, None where there is no gap.

    Args:
        views: all views.
        left: (H, W) metres that the named effects leave in each view.
        split: views to fit, and held-out views to judge on.
        gap: shrink that the named effects reach on the held-out views.
        limits: features and cells of the regression.
    """
    fit_views, held = split.fit, split.held_out
    if gap.shrink is None or not fit_views:
        return gap.shrink
    cells = [_cells(v, e, limits.cell_px) for v, e in zip(views, left, strict=True)]
    X, y, n = (np.concatenate([cells[i][k] for i in fit_views]) for k in range(3))
    half = np.concatenate([np.full(len(cells[i][1]), place % 2 == 0) for place, i in enumerate(fit_views)])
    if half.all() or not half.any():
        return gap.shrink  # Views that see nothing of the CAD judge nothing.
    features = _Features(X, limits)
    F = features(X)
    halves = [(_normal(F[~test], y[~test], n[~test]), F[test], y[test], n[test]) for test in (half, ~half)]
    best, ridge = 0.0, None
    for trial in RIDGES:
        removed = sum(_removed(f @ _ridge(*normal, trial), its_y, its_n) for normal, f, its_y, its_n in halves)
        if removed > best:
            best, ridge = removed, trial
    more = 0.0
    if ridge is not None:
        c = _ridge(*_normal(F, y, n), ridge)
        pixels = sum(int(np.isfinite(left[i]).sum()) for i in held)
        more = sum(_removed(features(cells[i][0]) @ c, cells[i][1], cells[i][2]) for i in held) / max(pixels, 1)
    above = (gap.before.rmse**2 - gap.floor_mm**2) * 1e-6
    return float(np.clip(gap.shrink + max(more, 0.0) / above, 0.0, 1.0))


class _Features:
    """Cosines of random combinations of a few inputs each, so that one alone can be followed finely."""

    def __init__(self, X: Float, limits: ExplainableLimits) -> None:
        rng = np.random.default_rng(0)
        self._mean, self._scale = X.mean(axis=0), X.std(axis=0) + 1e-9
        few = rng.random((X.shape[1], limits.features)) < limits.inputs
        self._W = rng.standard_normal((X.shape[1], limits.features)) * rng.choice(WIDTHS, limits.features) * few
        self._b = rng.uniform(0, 2 * np.pi, limits.features)

    def __call__(self, X: Float) -> Float:
        Z = (X - self._mean) / self._scale
        return np.concatenate([np.cos(Z @ self._W + self._b), Z, np.ones((len(Z), 1))], axis=1)


def _normal(F: Float, y: Float, n: Float) -> tuple[Float, Float, float]:
    """Normal equations A, b of a weighted fit, and the mean weight of a feature."""
    return (F * n[:, None]).T @ F, F.T @ (n * y), n.sum() / F.shape[1]


def _ridge(A: Float, b: Float, weight: float, strength: float) -> Float:
    return np.asarray(np.linalg.solve(A + strength * weight * np.eye(len(A)), b))


def _removed(p: Float, y: Float, n: Float) -> float:
    """m^2 summed over pixels: squared error that a prediction removes."""
    return float((n * (2 * y * p - p * p)).sum())


def _cells(view: ViewEvidence, left: Float, cell_px: int) -> tuple[Float, Float, Float]:
    """Inputs (c, 9), mean gap (c,) and pixels (c,) of the view's cells: range, incidence, log amplitude, row, column, time, cell position."""
    seen = np.isfinite(left) & view.smooth
    row, column = np.nonzero(seen)
    cells = blocks(seen, cell_px)
    n = cells.count.astype(float)
    points = cell_points(view.frame)[row, column]
    light = np.log(np.maximum(view.frame.amplitude[row, column], 1e-12))
    columns = [view.frame.radial[row, column], view.rendering.incidence[row, column], light, row, column, *points.T, left[row, column]]
    means = [cells.mean(c) for c in columns]
    time = np.full(len(n), view.frame.context.time_s)
    return np.stack([*means[:-1], time], axis=1), means[-1], n
