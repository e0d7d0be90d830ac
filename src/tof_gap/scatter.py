# SPDX-License-Identifier: Apache-2.0
"""Scatter as evidence: does it follow photons, does it come in bursts, does it come in steps?"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import nnls

from tof_core.config import param
from tof_gap.evidence import robust_std
from tof_gap.kinds import Finding
from tof_sensor.effects.interference import Interference
from tof_sensor.effects.noise import Noise, PhotonLaw
from tof_sensor.effects.quantization import Quantization

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float, Mask
    from tof_gap.evidence import ViewEvidence


@dataclass(frozen=True, slots=True)
class ScatterConfig:
    """When scatter is more than photons."""

    extra_share: float = param(0.35, "of the median scatter that a constant part must reach", low=0.0, high=1.0)
    extra_mm: float = param(0.4, "smallest constant part", unit="mm", low=0.0)
    burst: float = param(1.5, "scatter of a hit view against the law", low=1.05, high=10.0)
    step_mm: float = param(1.5, "steps up to this are the depth code's own", unit="mm", low=0.0)
    bins: int = param(12, "amplitude bins per view", low=3, high=60)


@dataclass(frozen=True, slots=True, eq=False)
class Bins:
    """Scatter by amplitude: rows are (view, amplitude, variance m^2 of z, samples, mean 1/length^2)."""

    view: Float
    amplitude: Float
    variance: Float
    samples: Float


def binned(views: Sequence[ViewEvidence], bins: int) -> Bins:
    """White variance of the residual in amplitude bins of every view."""
    rows = []
    for i, v in enumerate(views):
        r = np.where(v.smooth, v.residual, np.nan) * v.frame.length
        d2 = np.diff(r, n=2, axis=1) / np.sqrt(6.0)
        light = v.frame.amplitude[:, 1:-1]
        seen = np.isfinite(d2) & (light > 0)
        x, a = d2[seen], light[seen]
        if len(x) < 200:
            continue
        edges = np.quantile(a, np.linspace(0, 1, bins + 1))
        which = np.clip(np.searchsorted(edges, a, side="right") - 1, 0, bins - 1)
        rows += [
            (i, a[which == b].mean(), robust_std(x[which == b]) ** 2, (which == b).sum()) for b in range(bins) if (which == b).sum() >= 60
        ]
    table = np.array(rows, float).reshape(-1, 4)
    return Bins(*table.T)


@dataclass(frozen=True, slots=True)
class LawFit:
    """sigma^2 = floor^2 + shot^2 A0/A + ambient^2 (A0/A)^2 with its relative misfit and floor's error."""

    law: PhotonLaw
    floor_std: float
    misfit: float

    def variance(self, amplitude: Float) -> Float:
        """m^2 along the ray at amplitudes."""
        ratio = self.law.reference / np.maximum(amplitude, 1e-12)
        return self.law.floor_m**2 + self.law.shot_m**2 * ratio + (self.law.ambient_m * ratio) ** 2


def fit_law(b: Bins, step_m: float) -> LawFit:
    """Photon law by non-negative least squares on relative errors; the depth code's own step is known."""
    reference = float(np.median(b.amplitude))
    ratio = reference / b.amplitude
    own = step_m**2 / 12
    target = np.maximum(b.variance - own, 0.0)
    weight = np.sqrt(b.samples / 2) / np.maximum(b.variance, 1e-12)
    keep, c, log = np.ones(len(target), bool), np.zeros(3), np.zeros(len(target))
    X = np.stack([np.ones_like(ratio), ratio, ratio**2], axis=1)
    for _ in range(4):
        c, _ = nnls(X[keep] * weight[keep, None], target[keep] * weight[keep])
        log = np.log(np.maximum(b.variance, 1e-14) / np.maximum(X @ c + own, 1e-14))
        keep = log < max(3 * 1.4826 * np.median(np.abs(log - np.median(log))), 0.2) + np.median(log)
    cov = np.linalg.pinv((X[keep] * weight[keep, None]).T @ (X[keep] * weight[keep, None]))
    floor2 = c[0] + own
    law = PhotonLaw(floor_m=float(np.sqrt(floor2)), shot_m=float(np.sqrt(c[1])), ambient_m=float(np.sqrt(c[2])), reference=reference)
    spread = float(np.sqrt(cov[0, 0]) / max(2 * np.sqrt(c[0]), 1e-6))
    return LawFit(law, spread, float(np.std(log[keep])))


def depth_step(depth: Float) -> float:
    """Metres between the codes of a raw depth image: 0 where it is continuous."""
    z = depth[np.isfinite(depth)].astype(np.float64)
    if len(z) < 100:
        return 0.0
    codes = np.unique(np.round(z, 6))
    gaps = np.diff(codes)
    gaps = gaps[gaps > 5e-6]
    if len(gaps) < 5 or len(codes) > 0.5 * len(z):
        return 0.0
    return float(np.median(gaps))


def findings(views: Sequence[ViewEvidence], config: ScatterConfig, expected: PhotonLaw | None = None) -> list[Finding]:
    """`quantization`, `noise` and `interference`, each where the scatter says so."""
    steps = [depth_step(v.view.depth.astype(np.float64)) for v in views if v.view.captures == 1]
    step = float(np.median(steps)) if steps else 0.0
    out = []
    if step > config.step_mm * 1e-3:
        out.append(Finding(Quantization(step_m=step), 1.0, share=_constant(views, step / np.sqrt(12))))
    b = binned(views, config.bins)
    if len(b.view) < 6:
        return out
    fitted = fit_law(b, step)
    ratio = _view_ratio(b, fitted, len(views))
    hit = ratio > config.burst**2
    if 0 < hit.sum() <= 0.7 * len(views):
        out.append(_burst(views, fitted, ratio, hit))
        return out
    excess = _constant_part(fitted, step) if expected is None else _beyond(b, expected)
    typical = float(np.sqrt(np.median(b.variance)))
    if excess > max(config.extra_mm * 1e-3, config.extra_share * typical) and excess > 4 * fitted.floor_std:
        out.append(
            Finding(Noise(extra_m=excess), float(min(1.0, excess / typical)), {"extra_m": fitted.floor_std}, _constant(views, excess))
        )
    return out


def _constant_part(fitted: LawFit, step: float) -> float:
    return float(np.sqrt(max(fitted.law.floor_m**2 - step**2 / 12, 0.0)))


def _beyond(b: Bins, expected: PhotonLaw) -> float:
    law = LawFit(expected, 0.0, 0.0)
    return float(np.sqrt(max(np.average(b.variance - law.variance(b.amplitude), weights=b.samples), 0.0)))


def _view_ratio(b: Bins, fitted: LawFit, views: int) -> Float:
    """(V,) variance of each view against the law."""
    ratio = b.variance / np.maximum(fitted.variance(b.amplitude), 1e-14)
    return np.array([np.median(ratio[b.view == i]) if (b.view == i).any() else 1.0 for i in range(views)])


def _burst(views: Sequence[ViewEvidence], fitted: LawFit, ratio: Float, hit: Mask) -> Finding:
    typical2 = float(np.median([np.median(fitted.variance(v.frame.amplitude[v.smooth])) for v in views]))
    size = float(np.sqrt(np.mean(ratio[hit] - 1) * typical2))
    share = np.stack([np.where(v.smooth, size * h, np.nan) for v, h in zip(views, hit, strict=True)])
    effect = Interference(burst_m=size, duty=float(hit.mean()), reference=fitted.law.reference)
    return Finding(effect, 0.95, share=share, note=f"{int(hit.sum())} of {len(views)} views hit")


def _constant(views: Sequence[ViewEvidence], size: float) -> Float:
    return np.stack([np.where(v.smooth, size, np.nan) for v in views])
