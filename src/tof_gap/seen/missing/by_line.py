# SPDX-License-Identifier: Apache-2.0
"""Loss of the noisy rows or columns of each capture: a filter in the camera takes a line that stands out of its neighbours for edges."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_gap.seen.missing.lost import losses_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float, Mask
    from tof_gap.limits.missing import MissingLimits
    from tof_gap.seen.evidence.view import ViewEvidence
    from tof_gap.seen.noise.lines import LineNoise

PIECE = 8
"""Pixels of a piece of a line: wider than the holes of a filter. Every other piece is compared with those between them."""
APART = 6
"""Lines between two that no hole of a filter joins, but that see the same surfaces."""
LEAST_SEEN = 16
"""Pixels of a line in either half of its pieces that should return light, from which its loss counts."""


def lost_by_lines(views: Sequence[ViewEvidence], noisy: Sequence[LineNoise], limits: MissingLimits) -> bool:
    """Whether lost pixels follow noisy lines: some lines of a view lose many pixels along their whole length, and those near by do not.

    Loss by light, by a part or by chance is alike in lines near by. noisy: the session's noise of whole rows and columns.
    """
    found = (_spread(views, of.axis, limits) for of in noisy)
    return any(own > limits.filter.line_loss**2 * usual and far < limits.filter.line_near * own for own, far, usual in found)


def _spread(views: Sequence[ViewEvidence], axis: int, limits: MissingLimits) -> Float:
    """Of the shares that lines along `axis` lose: variance that both halves of a line share, covariance with lines `APART`, squared mean."""
    losses = losses_of(views, limits)
    found = np.zeros(3)
    for share, inside in zip(losses.share, losses.inside, strict=True):
        seen, gone = (image if axis == 1 else image.T for image in (inside, np.where(inside, share, 0.0)))
        odd = np.arange(seen.shape[1]) // PIECE % 2 == 1
        count, lost = (np.array([image[:, half].sum(axis=1) for half in (odd, ~odd)]) for image in (seen, gone))
        known: Mask = np.all(count >= LEAST_SEEN, axis=0)
        if known.any():
            mean = lost[:, known].sum() / count[:, known].sum()
            one, other = np.where(known, lost / np.maximum(count, 1) - mean, 0.0)
            number = int(known.sum())
            far = known[APART:] & known[:-APART]
            products = one[APART:] * other[:-APART], one[:-APART] * other[APART:]
            found += one @ other, np.mean([p[far].sum() for p in products]) * number / max(int(far.sum()), 1), number * mean**2
    return found
