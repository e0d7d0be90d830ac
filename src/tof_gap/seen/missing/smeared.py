# SPDX-License-Identifier: Apache-2.0
"""Edges that a filter in the camera smears: pixels between two surfaces, farther from the edge than mixed light reaches."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import distance_transform_edt

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float
    from tof_gap.limits.missing import MissingLimits
    from tof_gap.seen.evidence.view import ViewEvidence

HALF = 0.5
"""Of a pixel: distances are rounded to whole ones."""


def smeared(views: Sequence[ViewEvidence], limits: MissingLimits) -> bool:
    """Whether a filter mixed the depths of neighbours across edges: pixels lie between two surfaces too far from an edge, and noise is smooth.

    Light of two surfaces mixes in the pixels on an edge and, by the lens's blur and half a pixel of pose error, in the next ones; the
    noise of pixels stays independent. A filter mixes depths within its whole window, and neighbours share the remaining noise. Both signs
    are needed: a lens out of focus reaches as far, and a filter that stops at edges smooths noise too.
    """
    shared = any(v.correlation.growth > v.limits.correlation.growth for v in views)
    return shared and mixed_afar(views, limits) > limits.smear.afar


def mixed_afar(views: Sequence[ViewEvidence], limits: MissingLimits) -> float:
    """Share of pixels between two surfaces among those too far from an edge to see both; 0 where these are few.

    By noise alone as many pixels lie on the far side of their surface as on the near side: this number is subtracted.
    """
    lying = np.concatenate([_lying_afar(v, limits) for v in views])
    if len(lying) < limits.mixed_pixels:
        return 0.0
    least, most = limits.between, 1.0 - limits.between
    inside, beyond = ((side * lying > least) & (side * lying < most) for side in (1.0, -1.0))
    return float(inside.sum() - beyond.sum()) / len(lying)


def _lying_afar(view: ViewEvidence, limits: MissingLimits) -> Float:
    """(n,) place between the surfaces of the nearest edge (0 own, 1 the other), of measured pixels too far from it to see both."""
    rendering, own = view.rendering, view.frame.depth.astype(np.float64)
    mixed = rendering.mixed > 0
    if not mixed.any():
        return np.zeros(0)
    away, (row, column) = distance_transform_edt(~mixed, return_indices=True)
    surfaces = np.stack([own[row, column], rendering.second[row, column].astype(np.float64)]) - own
    order = np.argsort(np.abs(surfaces), axis=0, kind="stable")
    nearer, step = (np.take_along_axis(surfaces, order[k : k + 1], axis=0)[0] for k in (0, 1))
    clear = np.abs(step) > np.maximum(limits.step_mm * 1e-3, limits.step_sigma * view.sigma)
    clear &= (np.abs(nearer) < limits.smear.own * np.abs(step)) & np.isfinite(view.residual)
    clear &= np.abs(away - limits.smear.away_px) < HALF
    return np.asarray(view.residual[clear] / step[clear])
