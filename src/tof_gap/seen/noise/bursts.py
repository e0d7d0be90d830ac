# SPDX-License-Identifier: Apache-2.0
"""Views that are noisier than the others: another light in some captures, or noise that comes in bursts."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_gap.seen.finding import CONFIDENT, Finding, most
from tof_gap.seen.noise.photons import least_mm, of_means, quiet_law, view_ratio
from tof_scene.world.words import of_views
from tof_sensor.effects.interference import Interference
from tof_sensor.effects.noise import Noise

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float, Mask
    from tof_gap.limits.noise import NoiseLimits
    from tof_gap.seen.evidence.view import ViewEvidence
    from tof_gap.seen.noise.photons import LawFit
    from tof_sensor.session import NoiseBins

BURST_ROUNDS = 3
"""Rounds in which views that do not stand out from the quiet ones join them."""


def bursts(views: Sequence[ViewEvidence], b: NoiseBins, step: float, limits: NoiseLimits, bright: Float | None) -> Finding | None:
    """Noise of some views above that of the quiet ones; where exposure is automatic, above that of views as bright.

    bright: (V,) `brightness` of each view where exposure is automatic, else None.
    """
    quiet = quiet_law(b, step, len(views), limits)
    ratio = view_ratio(b, quiet, len(views), limits, bright)
    # A filter that stops at edges averages fewer pixels in some views than in others.
    hit = _stand_out(np.log(ratio), limits, limits.burst_filtered if views[0].correlation.correlated else limits.burst)
    several = hit.sum() > 1 or (hit.any() and ratio.max() > limits.alone)
    if not several or hit.sum() > (1 - limits.quiet_share) * len(views):
        return None
    return _burst(views, b, quiet, hit, limits)


def _stand_out(ln_variance: Float, limits: NoiseLimits, burst: float) -> Mask:
    """(V,) views whose noise exceeds that of the quiet views by the factor `burst`, and by more than quiet views differ from each other.

    Quiet views differ by scene, range and albedo, since the photon law is not exact.
    """
    quiet = np.sort(ln_variance)[: max(len(ln_variance) // 2, 2)]
    hit = ln_variance > np.median(quiet) + 2.0 * np.log(burst)
    for _ in range(BURST_ROUNDS):
        quiet = ln_variance[~hit]
        if len(quiet) < 2:
            break
        apart = max(2.0 * float(np.log(burst)), limits.burst_sigma * float(np.std(quiet, ddof=1)))
        hit &= ln_variance > float(quiet.mean()) + apart
    return np.asarray(hit)


def _burst(views: Sequence[ViewEvidence], b: NoiseBins, fitted: LawFit, hit: Mask, limits: NoiseLimits) -> Finding | None:
    """Views noisier than the others: `interference` where the excess falls with the camera's own light, else `noise` in bursts.

    None where the excess is less than is named of constant noise.
    """
    note = f"{int(hit.sum())} of {len(views)} views hit ({of_views(np.flatnonzero(hit).tolist())})"
    in_hit = hit[b.view.astype(int)]
    excess = (b.variance - fitted.law.variance(b.amplitude, b.surroundings2))[in_hit]
    weak = (fitted.law.reference / b.amplitude[in_hit]) ** 2
    # Relative misfit of an excess variance that is constant, and of one proportional to 1 / amplitude^2.
    relative = [np.log(np.maximum(excess, 1e-12) / x) for x in (np.ones_like(weak), weak)]
    constant, foreign = (float(np.median(np.abs(x - np.median(x)))) for x in relative)
    duty, steady = float(hit.mean()), constant < foreign
    size = float(np.sqrt(np.exp(np.median(relative[0 if steady else 1]))))
    if size < 1e-3 * least_mm(views, limits):
        return None
    share = of_means(views, size) * hit[:, None, None]
    if steady:
        return Finding(Noise(extra_m=min(size, most(Noise, "extra_m")), duty=duty), CONFIDENT, share=share, note=f"in bursts: {note}")
    effect = Interference(burst_m=min(size, most(Interference, "burst_m")), duty=duty, reference=fitted.law.reference)
    return Finding(effect, CONFIDENT, share=share, note=note)
