# SPDX-License-Identifier: Apache-2.0
"""Exposures that change between views or pixels: noise then is no function of amplitude and range."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_gap.seen.noise.photons import rises, trends

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_gap.limits.noise import NoiseLimits
    from tof_gap.seen.noise.photons import LawFit
    from tof_sensor.session import NoiseBins

LEAST_VIEWS = 4
"""Views that show a dependence on brightness: three always lie near a line with a bend."""
DEALS = 2000
"""Random orders of the views: probabilities down to 1 in 2000 are measured."""
LEAST_RATIO = 1e-12
"""Replaces 0 before a logarithm or a division."""
GROUPS = 12
"""Groups of bins by amplitude, among which noise is compared."""


def exposed(b: NoiseBins, fitted: LawFit, limits: NoiseLimits, bright: Float) -> bool:
    """Whether exposure is automatic, or long and short exposures are merged; bright (V,): `brightness` of each view."""
    return _merged(b, limits) or _automatic(b, fitted, limits, bright)


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


def _automatic(b: NoiseBins, fitted: LawFit, limits: NoiseLimits, bright: Float) -> bool:
    """Whether views are noisier the brighter they are, at the same amplitude.

    Automatic exposure shortens the exposure of a bright view. If the camera states amplitudes per time, fewer photons are behind the same
    amplitude there. The noise then is no function of amplitude and range: neither its constant part nor that of a view can be judged by
    the photon law. Up to some brightness the exposure is the longest; beyond, ln variance rises with ln brightness. What such a rise
    explains is compared with what it explains where the views' brightnesses are dealt at random.
    """
    seen, view = np.unique(b.view.astype(int), return_inverse=True)
    if len(seen) < LEAST_VIEWS:
        return False
    of_view = np.eye(len(seen))[view]
    base, _ = np.linalg.qr(trends(b, limits))
    beside = of_view - base @ (base.T @ of_view)
    products, with_noise = beside.T @ beside, beside.T @ np.log(np.maximum(fitted.ratio(b), LEAST_RATIO))

    def explained(rise: Float) -> tuple[Float, Float]:
        """(..., knees) chi-square that rises (..., views, knees) explain, 0 where noise falls with brightness, and d ln variance / d ln brightness."""
        along, square = rise.swapaxes(-1, -2) @ with_noise, np.maximum((rise * (products @ rise)).sum(axis=-2), LEAST_RATIO)
        return np.maximum(along, 0.0) ** 2 / square, along / square

    of_light = rises(np.log(bright[seen]))
    found, slope = explained(of_light)
    if slope[np.argmax(found)] < limits.exposure_slope:
        return False
    dealt = np.random.default_rng(0).random((DEALS, len(seen))).argsort(axis=1)
    by_chance = explained(of_light[dealt])[0].max(axis=-1) >= found.max()
    return bool((1 + by_chance.sum()) / (1 + DEALS) < limits.exposure_chance)
