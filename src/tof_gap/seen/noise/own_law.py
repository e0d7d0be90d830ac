# SPDX-License-Identifier: Apache-2.0
"""The photon law of a session's own noise, and of a camera that averages: from which noise on it takes in fewer neighbours."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tof_core.stats import robust_std
from tof_gap.seen.finding import most
from tof_gap.seen.noise.dwells import as_captures_differ, between_ratio
from tof_gap.seen.noise.photons import binned, code_step, fit_law, of_one_capture, quiet_law
from tof_gap.seen.noise.whole_average import without_structure
from tof_sensor.effects.photon_law import PhotonLaw

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float
    from tof_gap.limits.noise import NoiseLimits
    from tof_gap.seen.evidence.correlation import NoiseCorrelation
    from tof_gap.seen.evidence.view import ViewEvidence
    from tof_sensor.effect import Effect
    from tof_sensor.session import NoiseBins

WITHIN_M = tuple(np.geomspace(4e-3, 0.08, 14).tolist())
"""Thresholds of the average that are tried, in metres, a quarter apart: data sheets of twelve cameras know theirs to a fifth."""
BETTER = 0.85
"""Spread of ln variance about the law with a threshold, over that without, up to which the session shows the threshold: 0.34 to 0.84 in seven
sessions with noise near it, 0.91 and more in six without."""


def own_law(views: Sequence[ViewEvidence], named: Sequence[Effect], limits: NoiseLimits, wrong2: Float | None = None) -> PhotonLaw | None:
    """The photon law of the session's noise beside the named effects, None where there are too few bins.

    wrong2: (V,) m^2 along the ray by which the variance estimated from neighbours, in the mean of each view, is known to be too large.
    """
    b, step = binned(views, limits.bins, limits), code_step(views)
    if len(b.view) < limits.least_bins:
        return None
    if wrong2 is not None:
        wrong2 = wrong2 * [v.view.captures for v in views]
        b = replace(b, variance=np.maximum(b.variance - wrong2[b.view.astype(int)], views[0].limits.pattern.level_share * b.variance))
    b = of_one_capture(b, np.array([v.view.captures for v in views], float), step, limits)
    ratio = between_ratio(b)
    b = as_captures_differ(b, ratio)
    bursts = any(e.in_bursts for e in named)
    law = quiet_law(b, step, len(views), limits).law if bursts else law_beside_average(b, step, views[0].correlation, limits)
    apart2 = sum(e.constant_variance for e in named)
    floor_m = float(np.sqrt(max(law.floor_m**2 - apart2, 0.0)))
    return replace(law, floor_m=floor_m, window_px=views[0].correlation.window_px, between=min(ratio, most(PhotonLaw, "between")))


def law_beside_average(b: NoiseBins, step_m: float, correlation: NoiseCorrelation, limits: NoiseLimits) -> PhotonLaw:
    """The photon law of the bins, with the threshold of the camera's average where they show one; step_m: of the depth code, in metres."""
    usual = fit_law(b, step_m, limits).law
    if not correlation.correlated:
        return usual
    flat = without_structure(b, correlation)
    if len(flat.view) < limits.least_bins:
        return usual
    tried = [_with_threshold(flat, step_m, correlation.window_px, within, limits) for within in WITHIN_M]
    spread, law = min(((_spread(flat, law), law) for law in tried), key=lambda found: found[0])
    return law if spread < BETTER * _spread(flat, usual) else usual


def _with_threshold(b: NoiseBins, step_m: float, window_px: int, within_m: float, limits: NoiseLimits) -> PhotonLaw:
    """The law of a camera that averages over those neighbours in its window that differ by less than `within_m`."""
    average = PhotonLaw(floor_m=step_m / np.sqrt(12), window_px=window_px, within_m=within_m)
    whole = fit_law(replace(b, variance=average.of_whole(b.variance)), step_m, limits).law
    return replace(whole, window_px=window_px, within_m=within_m)


def _spread(b: NoiseBins, law: PhotonLaw) -> float:
    """Standard deviation of ln variance about the law, without outliers."""
    return float(robust_std(np.log(np.maximum(b.variance, 1e-14) / law.variance(b.amplitude, b.surroundings2))))
