# SPDX-License-Identifier: Apache-2.0
"""Exposures that change between views or pixels: noise then is no function of amplitude and range."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.special import stdtr

from tof_gap.seen.photons import of_views, view_ratio

if TYPE_CHECKING:
    from tof_gap.limits.seen import NoiseLimits
    from tof_gap.seen.photons import LawFit
    from tof_sensor.session import NoiseBins

GROUPS = 12
"""Groups of bins by amplitude, among which noise is compared."""


def exposed(b: NoiseBins, fitted: LawFit, limits: NoiseLimits) -> bool:
    """Whether exposure is automatic, or long and short exposures are merged."""
    return _merged(b, limits) or _automatic(b, fitted, limits)


def _merged(b: NoiseBins, limits: NoiseLimits) -> bool:
    """Whether noise rises with amplitude: noise of one exposure never does.

    A camera that merges exposures takes pixels that saturate in the long one from the short one. From there on, fewer photons are behind
    the same amplitude. Two neighbouring groups of bins must be noisier than a darker one.
    """
    edges = np.unique(np.quantile(b.amplitude, np.linspace(0, 1, GROUPS + 1)))
    which = np.searchsorted(edges[1:-1], b.amplitude, side="right")
    level = np.array([np.median(b.variance[which == g]) for g in np.unique(which)])
    if len(level) < GROUPS:
        return False
    both = np.minimum(level[1:-1], level[2:])
    return bool((both > limits.exposure_rise * np.minimum.accumulate(level)[:-2]).any())


def _automatic(b: NoiseBins, fitted: LawFit, limits: NoiseLimits) -> bool:
    """Whether views are noisier the brighter they are, at the same amplitude.

    Automatic exposure shortens the exposure of a bright view. If the camera states amplitudes per exposure, fewer photons are behind the
    same amplitude there. The noise then is no function of amplitude and range: neither its constant part nor that of a view can be
    judged by the photon law. By rank correlation over views, which single noisy views hardly change.
    """
    seen = np.unique(b.view.astype(int))
    free = len(seen) - 2
    if free < 1:
        return False
    noise, light = (
        np.argsort(np.argsort(x[seen], kind="stable"), kind="stable")
        for x in (view_ratio(b, fitted, int(seen[-1]) + 1, limits), of_views(b))
    )
    r = float(np.corrcoef(noise, light)[0, 1])
    return bool(stdtr(free, -r * np.sqrt(free / max(1.0 - r**2, 1e-12))) < limits.exposure_chance)
