# SPDX-License-Identifier: Apache-2.0
"""Whether the captures of a dwell show the same bias: then the scene makes it, and no light that is not synchronised with the camera."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tof_core.stats import robust_std

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float
    from tof_gap.limits.foreign import RepeatedLimits
    from tof_gap.seen.evidence.view import ViewEvidence


@dataclass(frozen=True, slots=True)
class _Power:
    """Of one view: mean square of the bias and squared standard error of the mean by its captures, in m^2, and over the variance by neighbours."""

    bias2: float
    error2: float
    bias_ratio: float
    error_ratio: float


def repeated(views: Sequence[ViewEvidence], bias: Float | None, limits: RepeatedLimits, steps2: Float | float = 0.0) -> bool:
    """Whether a bias that is attributed to another light is larger than captures of one dwell differ.

    A light of another clock has a new phase in each capture. The mean of n captures keeps 1 / n of the variance of such a bias, and n
    captures differ by as much: the standard error of the mean contains it. It exceeds the noise that neighbours show, which the bias is
    too smooth for, by more than in the views without the bias. (The mean of captures may lack it by chance where each of them has it.)

    Args:
        views: of one camera. Only views of several captures are compared; False without any.
        bias: (V, H, W) metres of z, 0 in views without the light; None where it is not known.
        limits: from which it is.
        steps2: (V,) square metres, squared steps of the camera along its axis that the light makes besides.
    """
    if bias is None:
        return False
    several = [
        _power(v, b, float(s))
        for v, b, s in zip(views, bias, np.broadcast_to(steps2, len(views)), strict=True)
        if v.view.captures > 1 and v.smooth.any()
    ]
    lit, quiet = [p for p in several if p.bias2 > 0], [p.error_ratio for p in several if p.bias2 == 0]
    if sum(p.bias2 for p in lit) > limits.ratio * sum(p.error2 for p in lit):
        return True
    usual = float(np.median(quiet)) if len(quiet) >= limits.views else np.inf
    if not lit or usual > limits.without:
        return False
    shown = sum(p.error_ratio for p in lit) - len(lit) * usual
    return shown + limits.sigma * robust_std(np.array(quiet)) * len(lit) < limits.share * sum(p.bias_ratio for p in lit)


def _power(view: ViewEvidence, bias: Float, step2: float) -> _Power:
    error2, near2 = view.view.sigma[view.smooth].astype(float) ** 2, view.sigma[view.smooth].astype(float) ** 2
    bias2 = bias[view.smooth] ** 2 + step2
    return _Power(float(bias2.mean()), float(np.nanmean(error2)), float((bias2 / near2).mean()), float(np.nanmean(error2 / near2)))
