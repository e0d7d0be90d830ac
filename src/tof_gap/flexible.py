# SPDX-License-Identifier: Apache-2.0
"""The most that any smooth model could explain: ridge on random features of everything known."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_sensor.geometry import cell_points

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float
    from tof_gap.evidence import ViewEvidence

FEATURES = 500
WIDTHS = (0.3, 1.0, 3.0)
"""Scales of the features, in standard deviations of the inputs (Rahimi and Recht 2007)."""


class Flexible:
    """Regression of the gap on range, incidence, amplitude, image and cell position, and time."""

    def __init__(self, views: Sequence[ViewEvidence], gap: Sequence[Float], rng: np.random.Generator) -> None:
        """Fit to the drawn pixels of `views`; `gap` (H, W) metres each."""
        X = np.concatenate([inputs(v) for v in views])
        y = np.concatenate([g.ravel()[v.pixels] for v, g in zip(views, gap, strict=True)])
        self._mean, self._scale = X.mean(axis=0), X.std(axis=0) + 1e-9
        width = rng.choice(WIDTHS, FEATURES)
        # Each feature looks at a few inputs only, so that one alone can be followed finely.
        mask = rng.random((X.shape[1], FEATURES)) < 0.4
        self._W = rng.standard_normal((X.shape[1], FEATURES)) * width * mask
        self._b = rng.uniform(0, 2 * np.pi, FEATURES)
        F = self._features(X)
        seen = np.isfinite(y)
        A = F[seen].T @ F[seen] + 1e-3 * seen.sum() * np.eye(F.shape[1])
        self._c = np.linalg.solve(A, F[seen].T @ y[seen])

    def _features(self, X: Float) -> Float:
        Z = (X - self._mean) / self._scale
        return np.concatenate([np.cos(Z @ self._W + self._b), Z, np.ones((len(Z), 1))], axis=1)

    def predict(self, view: ViewEvidence) -> Float:
        """(n,) metres on the view's drawn pixels."""
        return self._features(inputs(view)) @ self._c


def inputs(view: ViewEvidence) -> Float:
    """(n, 9) range, incidence, log amplitude, image and cell position, time on the drawn pixels."""
    at = view.pixels
    row, column = np.divmod(at, view.residual.shape[1])
    cell = cell_points(view.frame).reshape(-1, 3)[at]
    light = np.log(np.maximum(view.frame.amplitude.ravel()[at], 1e-12))
    time = np.full(len(at), view.frame.context.time_s)
    columns: list[Float] = [
        view.frame.radial.ravel()[at],
        view.rendering.incidence.ravel()[at].astype(np.float64),
        light,
        row,
        column,
        time,
    ]
    return np.concatenate([np.stack(columns, axis=1), cell], axis=1)


def explainable(
    fit_views: Sequence[ViewEvidence],
    fit_gap: Sequence[Float],
    views: Sequence[ViewEvidence],
    gap: Sequence[Float],
    floor: Sequence[Float],
    rng: np.random.Generator,
) -> float | None:
    """Share of the held-out gap above the floor that the regression explains, None where none is."""
    model = Flexible(fit_views, fit_gap, rng)
    before = after = ground = 0.0
    for v, g, f in zip(views, gap, floor, strict=True):
        e = g.ravel()[v.pixels]
        left = e - model.predict(v)
        seen = np.isfinite(left)
        before += float((e[seen] ** 2).sum())
        after += float((left[seen] ** 2).sum())
        ground += float(f.ravel()[v.pixels][seen].sum())
    if before <= ground * 1.04:
        return None
    return float(np.clip(1 - (after - ground) / (before - ground), 0.0, 1.0))
