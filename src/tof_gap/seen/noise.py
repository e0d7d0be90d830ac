# SPDX-License-Identifier: Apache-2.0
"""Scatter as evidence: does it follow photons, does it come in bursts, does it come in steps?"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import median_filter
from scipy.optimize import nnls

from tof_core.config import param
from tof_gap.seen.finding import Finding
from tof_gap.seen.line_noise import SURE, jumps, lines, pixel_pattern, restless_pixels
from tof_gap.seen.residual import depth_step, robust_std
from tof_gap.seen.stripes import beat, stripes
from tof_sensor.effects.interference import Interference
from tof_sensor.effects.noise import Noise, PhotonLaw
from tof_sensor.effects.quantization import Quantization

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float, Mask
    from tof_gap.seen.residual import ViewEvidence
    from tof_gap.seen.stripes import Beat
    from tof_sensor.effect import Effect


@dataclass(frozen=True, slots=True)
class ScatterConfig:
    """When scatter is more than photons."""

    extra_share: float = param(0.35, "of the median scatter that a constant part must reach", low=0.0, high=1.0)
    extra_mm: float = param(0.4, "smallest constant part", unit="mm", low=0.0)
    burst: float = param(1.12, "scatter of a hit view against the quiet ones", low=1.02, high=10.0)
    line_mm: float = param(0.5, "smallest scatter of whole rows or columns", unit="mm", low=0.0)
    line_share: float = param(0.25, "the same, of the median scatter", low=0.0, high=1.0)
    restless_share: float = param(0.004, "share of pixels that never rest from which they are noise", low=0.0, high=1.0)
    step_mm: float = param(1.5, "steps up to this are the depth code's own", unit="mm", low=0.0)
    bins: int = param(12, "amplitude bins per view", low=3, high=60)


@dataclass(frozen=True, slots=True, eq=False)
class Bins:
    """Scatter by amplitude: rows are (view, amplitude, squared range m^2, variance m^2 along the ray, samples)."""

    view: Float
    amplitude: Float
    range2: Float
    variance: Float
    samples: Float

    def of(self, keep: Mask) -> Bins:
        """Some rows."""
        return Bins(*(getattr(self, f.name)[keep] for f in fields(self)))


def binned(views: Sequence[ViewEvidence], bins: int) -> Bins:
    """White variance of the residual in amplitude bins of every view."""
    rows = []
    for i, v in enumerate(views):
        r = np.where(v.smooth, v.residual, np.nan) * v.frame.length
        d2 = np.diff(r, n=2, axis=1) / np.sqrt(6.0)
        light = v.frame.amplitude[:, 1:-1]
        seen = np.isfinite(d2) & (light > 0)
        x, a, r2 = d2[seen], light[seen], (v.frame.radial[:, 1:-1] ** 2)[seen]
        if len(x) < 200:
            continue
        edges = np.quantile(a, np.linspace(0, 1, bins + 1))
        which = np.clip(np.searchsorted(edges, a, side="right") - 1, 0, bins - 1)
        rows += [
            (i, a[which == b].mean(), r2[which == b].mean(), robust_std(x[which == b]) ** 2, (which == b).sum())
            for b in range(bins)
            if (which == b).sum() >= 60
        ]
    table = np.array(rows, float).reshape(-1, 5)
    return Bins(*table.T)


@dataclass(frozen=True, slots=True)
class LawFit:
    """The photon law with its relative misfit and its floor's error."""

    law: PhotonLaw
    floor_std: float
    misfit: float

    def ratio(self, b: Bins) -> Float:
        """Variance of each bin against the law."""
        return np.asarray(b.variance / np.maximum(self.law.variance(b.amplitude, b.range2), 1e-14))


def fit_law(b: Bins, step_m: float) -> LawFit:
    """Photon law by non-negative least squares on relative errors; the depth code's own step is known."""
    reference = float(np.median(b.amplitude))
    ratio = reference / b.amplitude
    own = step_m**2 / 12
    # Weighed by what bins of like amplitude scatter: one whose depth code hardly ever changes would outweigh all others.
    order = np.argsort(b.amplitude)
    usual = np.empty_like(b.variance)
    usual[order] = median_filter(b.variance[order], size=NEIGHBOURS, mode="mirror")
    target = np.maximum(b.variance - own, 0.0)
    weight = np.sqrt(b.samples / 2) / np.maximum(usual, 1e-12)
    keep, c, log = np.ones(len(target), bool), np.zeros(4), np.zeros(len(target))
    X = np.stack([np.ones_like(ratio), ratio, ratio * b.range2, ratio**2], axis=1)
    for _ in range(4):
        c, _ = nnls(X[keep] * weight[keep, None], target[keep] * weight[keep])
        log = np.log(np.maximum(b.variance, 1e-14) / np.maximum(X @ c + own, 1e-14))
        keep = log < max(3 * 1.4826 * np.median(np.abs(log - np.median(log))), 0.2) + np.median(log)
    cov = np.linalg.pinv((X[keep] * weight[keep, None]).T @ (X[keep] * weight[keep, None]))
    floor2 = c[0] + own
    shot, far, ambient = (float(np.sqrt(x)) for x in c[1:])
    law = PhotonLaw(floor_m=float(np.sqrt(floor2)), shot_m=shot, ambient_m=ambient, far_m=far, reference=reference)
    spread = float(np.sqrt(cov[0, 0]) / max(2 * np.sqrt(c[0]), 1e-6))
    return LawFit(law, spread, float(np.std(log[keep])))


NEIGHBOURS = 9
"""Bins next in amplitude whose middle variance weighs one."""


def like_stereo(views: Sequence[ViewEvidence], bins: int = 8) -> bool:
    """Whether scatter grows with the square of range and not with the light: a camera that triangulates.

    log variance = c + p log amplitude + q log range^2 over the bins; photons give p from -1 to -2, disparity p = 0 and q = 2.
    """
    b = binned(views, bins)
    if (
        all(v.view.amplitude is None for v in views)
        or len(b.view) < 12
        or np.ptp(np.log(b.range2)) < 0.3
        or np.ptp(np.log(b.amplitude)) < 0.3
    ):
        return False
    X = np.stack([np.ones_like(b.variance), np.log(b.amplitude), np.log(b.range2)], axis=1)
    own = X[:, 1] - X[:, [0, 2]] @ np.linalg.lstsq(X[:, [0, 2]], X[:, 1], rcond=None)[0]
    if own.std() < 0.2:
        return False  # Light goes with range alone: the two cannot be told apart.
    _, p, q = np.linalg.lstsq(X, np.log(np.maximum(b.variance, 1e-14)), rcond=None)[0]
    return bool(p > -0.3 and q > 1.2)


def findings(views: Sequence[ViewEvidence], config: ScatterConfig) -> list[Finding]:
    """`quantization`, `noise` and `interference`, each where the scatter says so."""
    step, out = code_step(views), []
    if step > config.step_mm * 1e-3:
        out.append(Finding(Quantization(step_m=step), 1.0, share=_constant(views, step / np.sqrt(12))))
    b = binned(views, config.bins)
    if len(b.view) < LEAST_BINS or step > np.sqrt(np.median(b.variance)):
        return out  # Between steps wider than the scatter nothing can be told of it.
    if out:
        return out  # Coarse steps leave contours and uneven scatter of their own.
    wave = beat(views)
    if wave is not None and wave.size_m > config.extra_mm * 1e-3:
        return [_stripes(views, wave, float(np.median(b.amplitude)))]
    fitted = fit_law(b, step)
    if all(v.view.amplitude is None for v in views):
        # Without light there is no law to be beyond: only what light cannot make is told.
        found = _noise(views, b, None, step, config)
        return [] if found is None else [found]
    quiet = quiet_law(b, step, len(views))
    ratio = _view_ratio(b, quiet, len(views))
    hit = ratio > config.burst**2 * np.median(np.sort(ratio)[: max(len(views) // 2, 2)])
    if hit.sum() <= (1 - QUIET) * len(views) and (hit.sum() > 1 or ratio.max() > ALONE):
        return [_burst(views, b, quiet, ratio, hit)]
    found = _noise(views, b, fitted, step, config)
    return [] if found is None else [found]


def code_step(views: Sequence[ViewEvidence]) -> float:
    """Metres between the codes of single captures, 0 where depth is continuous or averaged."""
    steps = [depth_step(v.view.depth.astype(np.float64)) for v in views if v.view.captures == 1]
    return float(np.median(steps)) if steps else 0.0


def own_law(views: Sequence[ViewEvidence], named: Sequence[Effect], bins: int) -> PhotonLaw | None:
    """The photon law of the session's scatter beside what was named of it, None where too little is seen."""
    b, step = binned(views, bins), code_step(views)
    if len(b.view) < LEAST_BINS:
        return None
    bursts = any(isinstance(e, Interference) or (isinstance(e, Noise) and e.duty < 1.0) for e in named)
    law = (quiet_law(b, step, len(views)) if bursts else fit_law(b, step)).law
    apart2 = sum(e.extra_m**2 for e in named if isinstance(e, Noise) and e.duty == 1.0)
    apart2 += sum(e.step_m**2 / 12 for e in named if isinstance(e, Quantization))
    return replace(law, floor_m=float(np.sqrt(max(law.floor_m**2 - apart2, 0.0))))


LEAST_BINS = 6
"""Bins of amplitude below which there is no law to be fitted."""


def _noise(views: Sequence[ViewEvidence], b: Bins, fitted: LawFit | None, step: float, config: ScatterConfig) -> Finding | None:
    """Scatter that no photon law has: constant, of whole rows or columns, of restless pixels."""
    typical = float(np.sqrt(np.median(b.variance)))
    least = max(config.extra_mm * 1e-3, config.extra_share * typical)
    excess = 0.0 if fitted is None else _constant_part(fitted, step)
    # What pixels err by in every view alike is a pattern, though neighbours show it as scatter.
    pattern_m = pixel_pattern(views)
    excess = float(np.sqrt(max(excess**2 - pattern_m**2, 0.0)))
    floor_std = 0.0 if fitted is None else fitted.floor_std
    parts = {"at every amplitude": excess if excess > max(least, 4 * floor_std) else 0.0}
    common = None
    for axis, name in ((1, "by rows"), (0, "by columns")):
        jumping = lines(views, axis)
        if jumping.sure > SURE and jumping.size_m > max(config.line_mm * 1e-3, config.line_share * typical):
            parts[name] = jumping.size_m
            common = np.stack([jumps(v, axis) for v in views]) + (0.0 if common is None else common)
    pixels = restless_pixels(views, pattern_m)
    restless = float(pixels.size_m * np.sqrt(pixels.share))
    if pixels.share > config.restless_share and restless > config.extra_mm * 1e-3:
        parts[f"of {pixels.share:.1%} of the pixels"] = restless
    size = float(np.sqrt(sum(p * p for p in parts.values())))
    if size <= 0:
        return None
    how = ", ".join(f"{1e3 * p:.1f} mm {name}" for name, p in parts.items() if p > 0)
    std = {"extra_m": floor_std}
    return Finding(Noise(extra_m=min(size, 0.1)), float(min(1.0, size / typical)), std, _constant(views, size), common=common, note=how)


def _stripes(views: Sequence[ViewEvidence], wave: Beat, reference: float) -> Finding:
    along = np.stack([stripes(v, wave.turns, wave.tilt) * h / v.frame.length for v, h in zip(views, wave.hit, strict=True)])
    effect = Interference(burst_m=min(wave.size_m, 0.2), duty=float(wave.hit.mean()), reference=reference)
    note = f"stripes of {wave.turns:g} turns in {int(wave.hit.sum())} of {len(views)} views"
    return Finding(effect, 0.95, share=np.abs(along), common=along, note=note)


def _constant_part(fitted: LawFit, step: float) -> float:
    return float(np.sqrt(max(fitted.law.floor_m**2 - step**2 / 12, 0.0)))


def quiet_law(b: Bins, step_m: float, views: int) -> LawFit:
    """The law of the quieter views: fitted to all, then to those that scatter least against it, until the rest may be hit."""
    fitted = fit_law(b, step_m)
    for _ in range(2):
        ratio = _view_ratio(b, fitted, views)
        quiet = ratio <= np.quantile(ratio, QUIET) * 1.3
        keep = quiet[b.view.astype(int)]
        if keep.sum() < LEAST_BINS:
            break
        fitted = fit_law(b.of(keep), step_m)
    return fitted


ALONE = 2.0
"""Variance against the quiet views' from which a single view is a burst: one view may be another kind of scene."""
QUIET = 0.25
"""Share of the views that a burst is taken to leave alone."""


def _view_ratio(b: Bins, fitted: LawFit, views: int) -> Float:
    """(V,) variance of each view against the law."""
    ratio = fitted.ratio(b)
    return np.array([np.median(ratio[b.view == i]) if (b.view == i).any() else 1.0 for i in range(views)])


def _burst(views: Sequence[ViewEvidence], b: Bins, fitted: LawFit, ratio: Float, hit: Mask) -> Finding:
    """Views that scatter more than the others: a foreign light does so where own light is weak, bad electronics everywhere alike."""
    typical2 = float(np.median(fitted.law.variance(b.amplitude, b.range2)))
    size = float(np.sqrt(np.mean(ratio[hit] - 1) * typical2))
    share = np.stack([np.where(v.smooth, size * h, np.nan) for v, h in zip(views, hit, strict=True)])
    note = f"{int(hit.sum())} of {len(views)} views hit"
    mine = hit[b.view.astype(int)]
    excess = (b.variance - fitted.law.variance(b.amplitude, b.range2))[mine]
    weak = (fitted.law.reference / b.amplitude[mine]) ** 2
    # The misfit, relative, of an excess that is constant and of one that goes with 1 / A^2.
    relative = [np.log(np.maximum(excess, 1e-12) / x) for x in (np.ones_like(weak), weak)]
    constant, foreign = (float(np.median(np.abs(x - np.median(x)))) for x in relative)
    if constant < foreign:
        return Finding(Noise(extra_m=min(size, 0.1), duty=float(hit.mean())), 0.95, share=share, note=f"in bursts: {note}")
    effect = Interference(burst_m=min(size, 0.2), duty=float(hit.mean()), reference=fitted.law.reference)
    return Finding(effect, 0.95, share=share, note=note)


def _constant(views: Sequence[ViewEvidence], size: float) -> Float:
    return np.stack([np.where(v.smooth, size, np.nan) for v in views])
