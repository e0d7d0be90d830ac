# SPDX-License-Identifier: Apache-2.0
"""Offsets of areas of the array, alike in every view: blocks of pixels that share a clock or a converter."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_gap.seen.pattern import local_mean

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float, Ints
    from tof_gap.seen.residual import ViewEvidence


def area_map(views: Sequence[ViewEvidence]) -> Float:
    """(H, W) metres along the ray: mean over the views of what varies over `window_px` to `area_px` pixels; 0 where no view has a pixel.

    Finer offsets are those of lines and single pixels, wider ones a smooth field.
    """
    return _mean(*_sums(views))


def area_maps_of_others(views: Sequence[ViewEvidence], folds: Ints) -> list[Float]:
    """For each view, the map of the views in all other folds; folds (V,): fold of each view."""
    names, fold = np.unique(folds, return_inverse=True)
    sums = [_sums([v for v, mine in zip(views, fold, strict=True) if mine == f]) for f in range(len(names))]
    none = np.zeros(views[0].residual.shape)
    maps = []
    for f in range(len(names)):
        others = [of_one for g, of_one in enumerate(sums) if g != f]
        maps.append(_mean(sum((t for t, _ in others), none), sum((w for _, w in others), none)))
    return [maps[f] for f in fold]


def _sums(views: Sequence[ViewEvidence]) -> tuple[Float, Float]:
    """(H, W) sums over the views of the residual's band, weighted by inverse variance, and of the weights."""
    total = np.zeros(views[0].residual.shape)
    weight = np.zeros_like(total)
    for view in views:
        limits = view.limits.pattern
        band = local_mean(view, limits.window_px) - local_mean(view, limits.area_px)
        inverse = np.where(view.smooth, 1.0 / view.sigma**2, 0.0)
        total += inverse * band
        weight += inverse
    return total, weight


def _mean(total: Float, weight: Float) -> Float:
    return np.asarray(np.where(weight > 0, total / np.maximum(weight, 1e-12), 0.0))
