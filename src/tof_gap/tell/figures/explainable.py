# SPDX-License-Identifier: Apache-2.0
"""The most that any model could explain: the named effects, and a ridge regression of the remaining gap on everything known of a pixel."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tof_core.stats import blocks
from tof_sensor.geometry import cell_points

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float
    from tof_gap.limits.report import ExplainableLimits
    from tof_gap.seen.evidence.view import ViewEvidence
    from tof_gap.solved import Split
    from tof_gap.tell.figures.shrink import Shrink

WIDTHS = (0.3, 1.0, 3.0)
"""Scales of the features, in standard deviations of the inputs (Rahimi and Recht 2007)."""
RIDGES = (3.0, 0.3, 0.03, 0.003)
"""Strengths of the ridge, relative to the data's weight; no regression is tried too."""


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
    halves = [[cells[i] for i in fit_views[start::2]] for start in (0, 1)]
    if not all(any(len(c.mean) for c in half) for half in halves):
        return gap.shrink  # Views that see nothing of the CAD judge nothing.
    features = _Features(np.concatenate([cells[i].inputs for i in fit_views]), limits)
    normals = [_normal(features, half) for half in halves]
    trials = [np.stack([_ridge(normal, strength) for strength in RIDGES]) for normal in normals]
    removed = _removed(features, halves[0], trials[1]) + _removed(features, halves[1], trials[0])
    best, more = int(np.argmax(removed)), 0.0
    if removed[best] > 0.0:
        whole = _Normal(*(a + b for a, b in zip(*normals, strict=True)))
        pixels = sum(int(np.isfinite(left[i]).sum()) for i in held)
        more = float(_removed(features, [cells[i] for i in held], _ridge(whole, RIDGES[best])[None])[0]) / max(pixels, 1)
    above = (gap.before.rmse**2 - gap.floor_mm**2) * 1e-6
    return float(np.clip(gap.shrink + max(more, 0.0) / above, 0.0, 1.0))


class _Features:
    """Random Fourier features: cosines of random combinations of a few inputs each, so that a function of one input is fitted too."""

    def __init__(self, X: Float, limits: ExplainableLimits) -> None:
        rng = np.random.default_rng(0)
        self._mean, self._scale = X.mean(axis=0), X.std(axis=0) + 1e-9
        few = rng.random((X.shape[1], limits.features)) < limits.inputs
        self._W = rng.standard_normal((X.shape[1], limits.features)) * rng.choice(WIDTHS, limits.features) * few
        self._b = rng.uniform(0, 2 * np.pi, limits.features)
        self.count = limits.features + X.shape[1] + 1

    def __call__(self, X: Float) -> Float:
        Z = (X - self._mean) / self._scale
        return np.concatenate([np.cos(Z @ self._W + self._b), Z, np.ones((len(Z), 1))], axis=1)


class _Normal(NamedTuple):
    """Normal equations of a weighted fit: A (f, f), b (f,), and the mean weight of a feature."""

    A: Float
    b: Float
    weight: float


class _Cells(NamedTuple):
    """Cells of a view: inputs (c, 9), their mean gap (c,) in metres, and their pixels (c,)."""

    inputs: Float
    mean: Float
    pixels: Float


def _normal(features: _Features, cells: Sequence[_Cells]) -> _Normal:
    """The normal equations of all cells. One view after the other, as the features of a long session take gigabytes."""
    A, b, weight = np.zeros((features.count, features.count)), np.zeros(features.count), 0.0
    for view in cells:
        F = features(view.inputs)
        A += (F * view.pixels[:, None]).T @ F
        b += F.T @ (view.pixels * view.mean)
        weight += view.pixels.sum() / features.count
    return _Normal(A, b, weight)


def _ridge(normal: _Normal, strength: float) -> Float:
    return np.asarray(np.linalg.solve(normal.A + strength * normal.weight * np.eye(len(normal.A)), normal.b))


def _removed(features: _Features, cells: Sequence[_Cells], trials: Float) -> Float:
    """(k,) m^2 summed over pixels: squared error that the predictions of coefficients (k, f) remove."""
    out = np.zeros(len(trials))
    for view in cells:
        p = features(view.inputs) @ trials.T
        out += view.pixels @ (2 * view.mean[:, None] * p - p * p)
    return out


def _cells(view: ViewEvidence, left: Float, cell_px: int) -> _Cells:
    """The view's cells with range, incidence, log amplitude, row, column, cell position and time."""
    seen = np.isfinite(left) & view.smooth
    row, column = np.nonzero(seen)
    cells = blocks(seen, cell_px)
    n = cells.count.astype(float)
    points = cell_points(view.frame)[row, column]
    light = np.log(np.maximum(view.frame.amplitude[row, column], 1e-12))
    columns = [view.frame.radial[row, column], view.rendering.incidence[row, column], light, row, column, *points.T, left[row, column]]
    means = [cells.mean(c) for c in columns]
    time = np.full(len(n), view.frame.context.time_s)
    return _Cells(np.stack([*means[:-1], time], axis=1), means[-1], n)
