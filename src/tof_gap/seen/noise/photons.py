# SPDX-License-Identifier: Apache-2.0
"""The photon law, noise variance as a function of amplitude and range, fitted to bins of a session."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import median_filter
from scipy.optimize import nnls

from tof_core.stats import by_group, hats, least_deviations, robust_std, second_differences, trimmed_std
from tof_gap.seen.evidence.level import DARK
from tof_gap.seen.evidence.residual import single
from tof_gap.seen.noise.dwells import between_captures2
from tof_sensor.effects.photon_law import PhotonLaw
from tof_sensor.session import LN_AGREES, NoiseBins

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float
    from tof_gap.limits.noise import NoiseLimits
    from tof_gap.seen.evidence.view import ViewEvidence

ROUNDS = 4
"""Fits of the law, each without the outliers of the previous fit."""
BRIGHTEST = 0.99
"""Quantile of a view's amplitudes that automatic exposure keeps below the full well."""
KNEES = (0.0, 0.25, 0.5, 0.75)
"""Quantiles of the views' brightness up to which the exposure may be the longest."""
VIEWS_A_KNOT, MOST_KNOTS = 4, 9
"""Views for each knot of the noise's dependence on range beyond `burst_knots`, and most knots: a factory table that straightens a wave changes noise
by a fifth within 0.2 m, at which two views of 36 stood out in two healthy sessions. More knots than that follow single views."""
QUIET_ROUNDS = 2
"""Fits of the quiet views' law, each to the views that are quiet by the previous fit."""


def binned(views: Sequence[ViewEvidence], bins: int, limits: NoiseLimits) -> NoiseBins:
    """Variance of the noise of one capture in `bins` amplitude bins of every view, from second differences along rows.

    The mean of a dwell has the noise of one capture over the square root of their number. Where neighbours share noise, differences of
    pixels two apart are compared with those of next neighbours (`NoiseCorrelation.variance`).
    """
    rows = []
    for i, v in enumerate(views):
        along = (v.residual * v.frame.length, v.frame.amplitude, v.frame.radial**2, v.frame.surroundings_m2, between_captures2(v))
        shown = [_by_rows(v, along, step) for step in v.correlation.steps]
        _, a, r2, around2, between2 = shown[0]
        if len(a) < limits.view_samples:
            continue
        edges = np.quantile(a, np.linspace(0, 1, bins + 1))[1:-1]
        which = [np.searchsorted(edges, light, side="right") for _, light, *_ in shown]
        parts = [by_group(d2, of, bins) for (d2, *_), of in zip(shown, which, strict=True)]
        count = np.bincount(which[0], minlength=bins)
        means = [np.bincount(which[0], values, bins) / np.maximum(count, 1) for values in (a, r2, around2)]
        between = by_group(between2, which[0], bins)
        for b in range(bins):
            own = [part[b] for part in parts]
            if min(map(len, own)) >= limits.bin_samples:
                shown2 = [trimmed_std(d2) ** 2 for d2 in own]
                own2 = v.correlation.variance(shown2)
                grown = shown2[-1] / max(shown2[0], 1e-14)
                rows.append((i, *(mean[b] for mean in means), v.view.captures * own2, count[b], np.median(between[b]), grown))
    table = np.array(rows, float).reshape(-1, 8)
    return NoiseBins(*table.T)


def _by_rows(view: ViewEvidence, along: Sequence[Float], step: int) -> list[Float]:
    """Second differences of the first of some images (H, W) between smooth pixels `step` apart along rows, and the others between, (n,) each."""
    d2 = second_differences(np.where(view.smooth, along[0], np.nan), axis=1, step=step)
    others = [image[:, step:-step] for image in along[1:]]
    seen = np.isfinite(d2) & (others[0] > 0)
    return [image[seen] for image in (d2, *others)]


@dataclass(frozen=True, slots=True)
class LawFit:
    """The photon law, the standard error of its floor in metres, and its misfit (standard deviation of ln variance)."""

    law: PhotonLaw
    floor_std: float
    misfit: float

    def ratio(self, b: NoiseBins) -> Float:
        """(n,) variance of each bin over the law's."""
        return np.asarray(b.variance / np.maximum(self.law.variance(b.amplitude, b.surroundings2), 1e-14))


def fit_law(b: NoiseBins, step_m: float, limits: NoiseLimits, *, floor: bool = True) -> LawFit:
    """Photon law by non-negative least squares on relative errors; the variance of the depth code's own step is known.

    floor: whether noise may have a constant part.
    """
    reference = float(np.median(b.amplitude))
    ratio = reference / b.amplitude
    own = step_m**2 / 12
    # Weighted by the variance of bins of like amplitude: a bin whose depth code hardly ever changes would outweigh all others.
    order = np.argsort(b.amplitude, kind="stable")
    usual = np.empty_like(b.variance)
    usual[order] = median_filter(b.variance[order], size=limits.smoothed_bins, mode="mirror")
    target = np.maximum(b.variance - own, 0.0)
    weight = np.sqrt(b.samples / 2) / np.maximum(usual, 1e-12)
    keep, c, log = np.ones(len(target), bool), np.zeros(4), np.zeros(len(target))
    X = np.stack([np.full_like(ratio, floor), ratio, ratio * b.surroundings2, ratio**2], axis=1)
    for _ in range(ROUNDS):
        c, _ = nnls(X[keep] * weight[keep, None], target[keep] * weight[keep])
        log = np.log(np.maximum(b.variance, 1e-14) / np.maximum(X @ c + own, 1e-14))
        keep = log < max(limits.outlier_sigma * robust_std(log), limits.outlier_least) + np.median(log)
    cov = np.linalg.pinv((X[keep] * weight[keep, None]).T @ (X[keep] * weight[keep, None]))
    floor2 = c[0] + own
    shot, far, ambient = (float(np.sqrt(x)) for x in c[1:])
    darkest = min(b.amplitude.tolist(), default=0.0)
    law = PhotonLaw(floor_m=float(np.sqrt(floor2)), shot_m=shot, ambient_m=ambient, far_m=far, reference=reference, darkest=darkest)
    spread = float(np.sqrt(cov[0, 0]) / max(2 * np.sqrt(c[0]), 1e-6))
    return LawFit(law, spread, float(np.std(log[keep])))


def variance_of_mean(law: PhotonLaw, view: ViewEvidence) -> Float:
    """(H, W) m^2 along the ray: variance of the mean of a view's captures, by the law of one capture."""
    return law.variance(view.frame.amplitude, view.frame.surroundings_m2) / view.view.captures


def over_law(b: NoiseBins, law: PhotonLaw) -> float:
    """Median variance over that of a stated law: of all bins that it holds for, or of the brighter half if that is less; 1 without any.

    Noise at every amplitude shows in bright light most, where the law leaves least; a law that is wrong in weak light does not.
    """
    b = b.of(law.holds(b.amplitude))
    if not len(b.view):
        return 1.0
    ratio = b.variance / law.variance(b.amplitude, b.surroundings2)
    return float(min(np.median(ratio), np.median(ratio[b.amplitude >= np.median(b.amplitude)])))


def constant_part(fitted: LawFit, step_m: float) -> float:
    """Metres: standard deviation of the noise at infinite amplitude, less that of the depth code's step."""
    return float(np.sqrt(max(fitted.law.floor_m**2 - step_m**2 / 12, 0.0)))


def constant_beside_range(b: NoiseBins, step_m: float, limits: NoiseLimits) -> float:
    """Metres: `constant_part` of the noise that a smooth factor over range leaves.

    A factory table that straightens the camera's wave stretches noise at some ranges and shrinks it at others. Where near surfaces are
    the bright ones, that looks like noise at every amplitude.
    """
    columns = _over_range(b, limits)
    log = np.log(np.maximum(fit_law(b, step_m, limits, floor=False).ratio(b), 1e-12))
    factor = columns @ least_deviations(columns, log, LN_AGREES)
    level = replace(b, variance=b.variance * np.exp(np.median(factor) - factor))
    return constant_part(fit_law(level, step_m, limits), step_m)


def view_ratio(b: NoiseBins, fitted: LawFit, views: int, limits: NoiseLimits, bright: Float | None = None) -> Float:
    """(V,) median ratio of the variance of each view's bins to the law and to the usual trends over range and amplitude; 1 for a view without bins.

    The noise of a gated or pulsed camera depends on where in its gates the pulse arrives, and so on range as well as on amplitude.
    Far views may therefore be noisier without a burst, and dark ones where weak signals are noisier than by the law, as where two
    frequencies hardly merge. So may bright ones where exposure is automatic: bright (V,) is each view's `brightness` then.
    """
    log = np.log(np.maximum(fitted.ratio(b), 1e-12))
    columns = trends(b, limits)
    trend = columns @ least_deviations(columns, log, LN_AGREES)
    if bright is not None:
        view = b.view.astype(int)
        rising = (np.column_stack([columns, rise[view]]) for rise in rises(np.log(bright)).T)
        fits = [(X, least_deviations(X, log, LN_AGREES)) for X in rising]
        trend = min([trend, *(X @ c for X, c in fits if c[-1] > 0.0)], key=lambda of: float(np.abs(log - of).sum()))
    ratio = np.exp(log - trend + np.median(trend))
    return np.array([np.median(ratio[b.view == i]) if (b.view == i).any() else 1.0 for i in range(views)])


def brightness(views: Sequence[ViewEvidence]) -> Float:
    """(V,) amplitude that the brightest pixels of each view exceed, by which cameras choose the exposure; 1 without amplitude.

    Of the whole image: what stands before the CAD, such as a person's arm, shortens the exposure too.
    """
    out = np.ones(len(views))
    for i, v in enumerate(views):
        light = v.view.amplitude
        if light is not None and np.isfinite(light).any():
            out[i] = max(float(np.nanquantile(light, BRIGHTEST)), DARK)
    return out


def rises(light: Float) -> Float:
    """(V, knees) how far each view's ln brightness (V,) lies above each of the knees up to which the exposure may be the longest."""
    return np.maximum(light[:, None] - np.quantile(light, KNEES), 0.0)


def trends(b: NoiseBins, limits: NoiseLimits) -> Float:
    """(n, k) columns of the usual dependences of ln variance on range and on amplitude, beside a photon law."""
    return np.column_stack([_over_range(b, limits), _over(np.log(b.amplitude), limits.burst_knots)[:, 1:]])


def _over_range(b: NoiseBins, limits: NoiseLimits) -> Float:
    """(n, knots) piecewise linear functions of ln range, with more knots in a session of many views."""
    knots = min(len(np.unique(b.view)) // VIEWS_A_KNOT, MOST_KNOTS)
    return _over(0.5 * np.log(b.range2), max(knots, limits.burst_knots))


def _over(x: Float, knots: int) -> Float:
    """(n, knots) piecewise linear functions of x (n,), with knots at its quantiles; fewer where these are alike."""
    return hats(x, np.unique(np.quantile(x, np.linspace(0, 1, knots))))


def of_one_capture(b: NoiseBins, captures: Float, step_m: float, limits: NoiseLimits) -> NoiseBins:
    """The bins with the variance of one capture also where the captures of a dwell share noise; captures (V,) of each view.

    The variance of one capture is estimated as n times that of the mean of n captures. A filter over captures in the camera, or rounding
    that noise does not spread over several codes, leaves the mean more: n^s times the variance of one is estimated, s from 0 for
    independent captures to 1 for equal ones. s follows from views of different n, beside the trend over range.
    """
    n = np.log(captures[b.view.astype(int)])
    if np.ptp(n) == 0.0:
        return b
    log = np.log(np.maximum(fit_law(b, step_m, limits).ratio(b), 1e-12))
    s = float(least_deviations(np.column_stack([_over_range(b, limits), n]), log, LN_AGREES)[-1])
    return replace(b, variance=b.variance * np.exp(-min(max(s, 0.0), 1.0) * n))


def quiet_law(b: NoiseBins, step_m: float, views: int, limits: NoiseLimits) -> LawFit:
    """The law of the quiet views: fitted to all, then to those with the least noise against that fit."""
    fitted = fit_law(b, step_m, limits)
    for _ in range(QUIET_ROUNDS):
        ratio = view_ratio(b, fitted, views, limits)
        quiet = ratio <= np.quantile(ratio, limits.quiet_share) * limits.quiet_margin
        keep = quiet[b.view.astype(int)]
        if keep.sum() < limits.least_bins:
            break
        fitted = fit_law(b.of(keep), step_m, limits)
    return fitted


def code_step(views: Sequence[ViewEvidence]) -> float:
    """Metres between the depth codes that the camera writes, 0 where depth is continuous."""
    return float(np.median([v.step_m for v in views])) if views else 0.0


def least_mm(views: Sequence[ViewEvidence], limits: NoiseLimits) -> float:
    """Least noise of one capture that is named. A filter in the camera rounds creases, which differences of pixels take for noise."""
    return limits.extra_filtered_mm if any(v.correlation.correlated for v in views) else limits.extra_mm


def constant_map(views: Sequence[ViewEvidence], size: float | Float) -> Float:
    """(V, H, W) the standard deviation `size`, of all views or (V,), at every smooth pixel, NaN elsewhere."""
    each = np.broadcast_to(size, len(views))
    return np.stack([single(np.where(v.smooth, s, np.nan)) for v, s in zip(views, each, strict=True)])


def of_means(views: Sequence[ViewEvidence], size: float) -> Float:
    """(V, H, W) standard deviation of the mean of each view's captures, from that of one capture, `size`; NaN at pixels that are not smooth."""
    return constant_map(views, size / np.sqrt([v.view.captures for v in views]))
