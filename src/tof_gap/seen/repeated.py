# SPDX-License-Identifier: Apache-2.0
"""Whether the captures of a dwell show the same bias: then the scene makes it, and no light that is not synchronised with the camera."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float
    from tof_gap.seen.residual import ViewEvidence


def repeated(views: Sequence[ViewEvidence], bias: Float | None, limit: float, steps2: Float | float = 0.0) -> bool:
    """Whether a bias that is attributed to another light is larger than captures of one dwell differ.

    A light of another clock has a new phase in each capture. The mean of n captures keeps 1 / n of the variance of such a bias, and n
    captures differ by as much: the standard error of the mean contains it.

    Args:
        views: of one camera. Only views of several captures are compared; False without any.
        bias: (V, H, W) metres of z, 0 in views without the light; None where it is not known.
        limit: of its variance over the squared standard error of the mean.
        steps2: (V,) square metres, squared steps of the camera along its axis that the light makes besides.
    """
    if bias is None:
        return False
    step2 = np.broadcast_to(steps2, len(views))
    several = [
        (_bias2(v, b) + s, _error2(v))
        for v, b, s in zip(views, bias, step2, strict=True)
        if v.view.captures > 1 and v.smooth.any() and (s > 0 or b[v.smooth].any())
    ]
    return bool(sum(power for power, _ in several) > limit * sum(noise for _, noise in several))


def _bias2(view: ViewEvidence, bias: Float) -> float:
    return float(np.mean(bias[view.smooth] ** 2))


def _error2(view: ViewEvidence) -> float:
    return float(np.nanmean(view.view.sigma[view.smooth] ** 2))
