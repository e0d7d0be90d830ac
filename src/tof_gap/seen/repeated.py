# SPDX-License-Identifier: Apache-2.0
"""Whether the captures of a dwell show the same bias: then the scene makes it, and no light that is not synchronised with the camera."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float
    from tof_gap.seen.residual import ViewEvidence


def repeated(views: Sequence[ViewEvidence], bias: Float | None, limit: float) -> bool:
    """Whether a bias that is attributed to another light is larger than captures of one dwell differ.

    A light of another clock has a new phase in each capture. The mean of n captures keeps 1 / n of the variance of such a bias, and n
    captures differ by as much: the standard error of the mean contains it.

    Args:
        views: of one camera. Only views of several captures are compared; False without any.
        bias: (V, H, W) metres of z, 0 in views without the light; None where it is not known.
        limit: of its variance over the squared standard error of the mean.
    """
    if bias is None:
        return False
    several = [(v, b) for v, b in zip(views, bias, strict=True) if v.view.captures > 1 and v.smooth.any() and b[v.smooth].any()]
    power, noise = (float(sum(x)) for x in zip(*(_squares(v, b) for v, b in several), strict=True)) if several else (0.0, 0.0)
    return power > limit * noise


def _squares(view: ViewEvidence, bias: Float) -> tuple[float, float]:
    """Square metres: mean square of the bias over the smooth pixels, and of the standard error of the view's mean."""
    return float(np.mean(bias[view.smooth] ** 2)), float(np.nanmean(view.view.sigma[view.smooth] ** 2))
