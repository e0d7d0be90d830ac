# SPDX-License-Identifier: Apache-2.0
"""Offsets of areas of the array, alike in every view: blocks of pixels that share a clock or a converter."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_gap.seen.evidence.pattern import local_mean, of_others, weighted_sums

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float, Ints
    from tof_gap.seen.evidence.view import ViewEvidence


def area_map(views: Sequence[ViewEvidence]) -> Float:
    """(H, W) metres along the ray: mean over the views of what varies over `window_px` to `area_px` pixels; 0 where no view has a pixel.

    Finer offsets are those of lines and single pixels, wider ones a smooth field.
    """
    return _mean(*weighted_sums(views, _band))


def area_maps_of_others(views: Sequence[ViewEvidence], folds: Ints) -> list[Float]:
    """For each view, the map of the views in all other folds; folds (V,): fold of each view."""
    return of_others(views, folds, _band, _mean)


def _band(view: ViewEvidence) -> Float:
    """(H, W) metres along the ray: what of the residual varies over `window_px` to `area_px` pixels; NaN off the smooth pixels."""
    limits = view.limits.pattern
    return np.where(view.smooth, local_mean(view, limits.window_px) - local_mean(view, limits.area_px), np.nan)


def _mean(total: Float, weight: Float) -> Float:
    return np.asarray(np.where(weight > 0, total / np.maximum(weight, 1e-12), 0.0))
