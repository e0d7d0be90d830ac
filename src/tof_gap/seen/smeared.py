# SPDX-License-Identifier: Apache-2.0
"""Edges that a filter in the camera smears: pixels between two surfaces, farther from the edge than light mixes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import distance_transform_edt

from tof_core.stats import second_differences, trimmed_std
from tof_gap.seen.lost import expected

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float
    from tof_gap.limits.missing import MissingLimits
    from tof_gap.seen.residual import ViewEvidence

HALF = 0.5
"""Of a pixel: distances are rounded to whole ones."""


def smeared(views: Sequence[ViewEvidence], limits: MissingLimits) -> bool:
    """Whether a filter over neighbours mixed their depths across edges: pixels lie between two surfaces where no light mixes, and noise is smoothed.

    Light of two surfaces meets in the pixels that an edge passes through; the lens's blur and half a pixel of pose reach the next one,
    and the noise of each pixel stays its own. A filter mixes as far as its window reaches, and neighbours share what noise it leaves.
    One sign alone is none: a lens out of focus reaches as far, and a filter that stops at edges smooths noise.
    """
    return mixed_afar(views, limits) > limits.smear.afar and smoothing(views, limits) > limits.smear.smoothing


def mixed_afar(views: Sequence[ViewEvidence], limits: MissingLimits) -> float:
    """Share of pixels that lie between two surfaces, of those too far from an edge to see both; 0 where these are few.

    As many pixels lie beyond their own surface as before it by noise alone: they are taken off.
    """
    lying = np.concatenate([_lying_afar(v, limits) for v in views])
    if len(lying) < limits.mixed_pixels:
        return 0.0
    least, most = limits.between, 1.0 - limits.between
    inside, beyond = ((side * lying > least) & (side * lying < most) for side in (1.0, -1.0))
    return float(inside.sum() - beyond.sum()) / len(lying)


def smoothing(views: Sequence[ViewEvidence], limits: MissingLimits) -> float:
    """Noise against the pixels two away, over that against next neighbours: 1 where pixels are independent, above where neighbours share noise."""
    near, far = (np.concatenate([_differences(v, step, limits) for v in views]) for step in (1, 2))
    return trimmed_std(far) / max(trimmed_std(near), 1e-12) if len(near) and len(far) else 1.0


def _differences(view: ViewEvidence, step: int, limits: MissingLimits) -> Float:
    """(n,) second differences of the residual along rows and columns, in standard deviations of the view's noise; away from edges, where mixing bends depth."""
    r = np.where(view.smooth & expected(view, limits), view.residual / view.sigma, np.nan)
    every = np.concatenate([second_differences(r, axis, step).ravel() for axis in (0, 1)])
    return np.asarray(every[np.isfinite(every)])


def _lying_afar(view: ViewEvidence, limits: MissingLimits) -> Float:
    """(n,) place between the two surfaces of the nearest edge, 0 own and 1 the other, of measured pixels that are too far from it to see both."""
    rendering, own = view.rendering, view.frame.depth.astype(np.float64)
    mixed = rendering.mixed > 0
    if not mixed.any():
        return np.zeros(0)
    away, (row, column) = distance_transform_edt(~mixed, return_indices=True)
    surfaces = np.stack([own[row, column], rendering.second[row, column].astype(np.float64)]) - own
    order = np.argsort(np.abs(surfaces), axis=0)
    nearer, step = (np.take_along_axis(surfaces, order[k : k + 1], axis=0)[0] for k in (0, 1))
    clear = np.abs(step) > np.maximum(limits.step_mm * 1e-3, limits.step_sigma * view.sigma)
    clear &= (np.abs(nearer) < limits.smear.own * np.abs(step)) & np.isfinite(view.residual)
    clear &= np.abs(away - limits.smear.away_px) < HALF
    return np.asarray(view.residual[clear] / step[clear])
