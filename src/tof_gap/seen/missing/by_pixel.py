# SPDX-License-Identifier: Apache-2.0
"""Loss of the same pixels in every view: a filter in the camera takes offsets of pixels for edges, whatever the pixels see."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.ndimage import uniform_filter

from tof_gap.seen.missing.lost import losses_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float
    from tof_gap.limits.missing import MissingLimits
    from tof_gap.seen.evidence.view import ViewEvidence

AROUND_PX = 7
"""Width of the window whose mean loss is taken off: lenses and lamps lose pixels towards the rim of the image, over wider areas."""
DEAD = 0.5
"""Share of either half of the views, beyond what is predicted, from which a pixel is lost as such: dead, or in a corner of the image."""
MOST = 0.5
"""Share of all loss at dead pixels from which loss is by pixels. A few dead ones, which most cameras have, say nothing about the rest."""
LEAST_VIEWS = 4
"""Views of a half in which a pixel should return light, from which its loss counts."""


def lost_by_pixels(views: Sequence[ViewEvidence], limits: MissingLimits, predicted: Sequence[Float] | Float | None = None) -> bool:
    """Whether even and odd views lose the same pixels, beside what the pixels around lose.

    Loss by light, by a part or by chance goes with what the views see. Neighbouring views may see the same dark surface at the same
    place in the image: what its light predicts is taken off.

    predicted: (H, W) per view, share of loss by light, NaN where there is none; None: nothing is predicted.
    """
    if len(views) < 2 * LEAST_VIEWS:
        return False
    known_loss = np.zeros(len(views)) if predicted is None else predicted
    halves = [_own_loss(views[half::2], limits, known_loss[half::2]) for half in (0, 1)]
    even, odd = (h.share for h in halves)
    known = np.isfinite(even) & np.isfinite(odd)
    dead = known & (even > DEAD) & (odd > DEAD)
    if sum(float(h.lost[dead].sum()) for h in halves) > MOST * sum(float(h.lost.sum()) for h in halves):
        return True
    rest = known & ~dead
    one, other = ((h.share - h.around)[rest] for h in halves)
    size = np.sqrt((one @ one) * (other @ other))
    return bool(size > 0 and one @ other > limits.filter.same_pixels * size)


class _OwnLoss(NamedTuple):
    """(H, W) of some views: number in which a pixel is lost; share beyond what is predicted, NaN where few views should see it; its mean around."""

    lost: Float
    share: Float
    around: Float


def _own_loss(views: Sequence[ViewEvidence], limits: MissingLimits, predicted: Sequence[Float] | Float) -> _OwnLoss:
    losses = losses_of(views, limits)
    seen = np.sum(losses.inside, axis=0, dtype=float)
    lost = np.sum([np.where(i, g, 0.0) for i, g in zip(losses.inside, losses.share, strict=True)], axis=0)
    own = lost - np.sum([np.where(i, np.nan_to_num(p), 0.0) for i, p in zip(losses.inside, predicted, strict=True)], axis=0)
    around = uniform_filter(own, AROUND_PX) / np.maximum(uniform_filter(seen, AROUND_PX), 1e-9)
    return _OwnLoss(lost, np.where(seen >= LEAST_VIEWS, own / np.maximum(seen, 1.0), np.nan), around)
