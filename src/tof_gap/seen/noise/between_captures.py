# SPDX-License-Identifier: Apache-2.0
"""Another camera's light in the captures of a dwell: the whole image steps from capture to capture, most where surfaces are far."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tof_gap.seen.evidence.correlation import variance_apart
from tof_gap.seen.evidence.residual import single
from tof_gap.seen.finding import CONFIDENT, Finding, most
from tof_gap.seen.foreign.light import interference
from tof_gap.seen.noise.dwells import between_captures2
from tof_gap.seen.noise.photons import binned, code_step, fit_law
from tof_sensor.effects.interference import Interference
from tof_sensor.geometry import pose_columns

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float, Ints
    from tof_gap.limits.noise import NoiseLimits
    from tof_gap.seen.evidence.view import ViewEvidence
    from tof_sensor.effects.photon_law import PhotonLaw
    from tof_sensor.session import NoiseBins

EVERY = 7
"""One of so many pixels is fitted: thousands of a view."""
FAR_PX = 12
"""Pixels between samples that share no noise: more than any average spans, and than depth is interpolated between projected dots."""
CAP = 12.0
"""Variance between captures over the photon law's, beyond which a pixel counts no more: an edge."""


class Steps(NamedTuple):
    """Steps of the whole image from capture to capture.

    hit (h,): dwells that have them, of the number `dwells`; light_m: metres at r^2 / cos(incidence) = 1 m^2; size_m: metres at the median.
    """

    hit: Ints
    dwells: int
    light_m: float
    size_m: float


def as_captures_step(found: Finding, views: Sequence[ViewEvidence], limits: NoiseLimits) -> Finding:
    """Foreign light with the size by which captures of a dwell step, where that is more than what poses and the mean of a dwell leave."""
    steps = steps_of(views, limits)
    if steps is None or not isinstance(found.effect, Interference) or steps.size_m <= found.effect.burst_m:
        return found
    return replace(found, effect=replace(found.effect, burst_m=min(steps.size_m, most(Interference, "burst_m"))))


def stepping_captures(views: Sequence[ViewEvidence], limits: NoiseLimits) -> Finding | None:
    """`interference` where captures of a dwell differ by more than neighbouring pixels do, as foreign light makes them differ (`steps_of`)."""
    steps = steps_of(views, limits)
    if steps is None:
        return None
    share = np.stack([_of_mean(v, steps.light_m * (number in steps.hit)) for number, v in enumerate(views)])
    of_all = f"{len(steps.hit)} of {steps.dwells} dwells"
    note = f"the whole image steps from capture to capture by {1e3 * steps.size_m:.1f} mm RMS, in {of_all}"
    effect = interference(views, steps.size_m, duty=len(steps.hit) / steps.dwells)
    # A pose absorbs what steps with the whole image.
    return Finding(effect, CONFIDENT, share=share, note=note, posed_m=float(np.sqrt(np.nanmean(share**2))))


def steps_of(views: Sequence[ViewEvidence], limits: NoiseLimits) -> Steps | None:
    """The steps from capture to capture; None where captures of a dwell differ as neighbouring pixels do, or as a swaying hand makes them.

    Foreign modulated light adds a phasor with a phase of its own in every capture, so depth steps by an amount in proportion to foreign
    over own light: r^2 / cos(incidence), whatever the albedo. It is in the variance between captures and not among neighbours. The mean of
    a dwell leaves a part of the steps, and poses take most of that. A hand that sways moves the image, too, in proportion to the columns
    of the pose. Noise of whole rows is another effect. A camera that interpolates depth, as between projected dots, shares noise among many
    neighbours: captures differ by all of it, and so do pixels `FAR_PX` apart.
    """
    if all(v.view.captures < 2 for v in views) or views[0].correlation.interpolated:  # Its noise is known from the captures alone.
        return None
    b, limit = binned(views, limits.bins, limits), limits.captures
    b = b.of(np.isfinite(_excess(b)) & (b.variance > 0.0))
    dwells = np.unique(b.view).astype(int)
    over = 1.0 + np.array([np.median((_excess(b) / b.variance)[b.view == v]) for v in dwells])
    hit = dwells[over > limit.ratio * np.array([_local(views[v]) for v in dwells])]
    if len(hit) < max(limit.dwells, limit.share * len(dwells)):
        return None
    stepping = [views[v] for v in hit]
    by_light2, of_all = _of_light2(stepping, fit_law(b, code_step(views), limits).law)
    if of_all < limit.of_light:
        return None
    way = np.concatenate([v.frame.surroundings_m2[v.smooth] for v in stepping])
    light_m = float(np.sqrt(by_light2))
    return Steps(hit, len(dwells), light_m, light_m * float(np.median(way)))


def _local(view: ViewEvidence) -> float:
    """Variance of noise among pixels `FAR_PX` apart, over that among neighbours: what neighbours share; 1 where too few pixels show it."""
    scaled = [np.where(view.smooth, view.residual / view.sigma, np.nan)]
    near = view.correlation.variance([variance_apart(scaled, step) for step in view.correlation.steps])
    return max(variance_apart(scaled, FAR_PX) / near, 1.0) if near > 0.0 else 1.0


def _excess(b: NoiseBins) -> Float:
    """(n,) m^2: variance between captures beyond that among neighbours; NaN in views of one capture."""
    return np.full(len(b.view), np.nan) if b.between is None else b.between - b.variance


def _of_light2(views: Sequence[ViewEvidence], law: PhotonLaw) -> tuple[float, float]:
    """Variance between captures by foreign light, m^2 at r^2 / cos(incidence) = 1 m^2, and its share beside that by a hand that sways."""
    from scipy.optimize import nnls  # loads slowly, and only dwells that step need it

    columns, excess = [], []
    for v in views:
        between2 = between_captures2(v)
        at = np.flatnonzero(v.smooth & np.isfinite(between2))[::EVERY]
        way2 = v.frame.surroundings_m2.ravel()[at] ** 2
        by_law = law.variance(v.frame.amplitude.ravel()[at], v.frame.surroundings_m2.ravel()[at])
        sway2 = ((pose_columns(v.frame) * v.frame.length[..., None]).reshape(-1, 6)[at]) ** 2
        columns.append(np.column_stack([sway2, way2]) / by_law[:, None])
        excess.append(np.minimum(between2.ravel()[at] / by_law, CAP) - 1.0)
    X = np.concatenate(columns)
    variances, _ = nnls(X, np.concatenate(excess))
    parts = variances * X.mean(axis=0)
    return float(variances[-1]), float(parts[-1] / max(parts.sum(), 1e-12))


def _of_mean(view: ViewEvidence, step: float) -> Float:
    """(H, W) metres of z: standard deviation that steps, metres at r^2 / cos(incidence) = 1 m^2, leave in the mean of a view's captures; NaN where nothing is compared."""
    left = step * view.frame.surroundings_m2 / np.sqrt(view.view.captures) / view.frame.length
    return single(np.where(view.smooth, left, np.nan))
