# SPDX-License-Identifier: Apache-2.0
"""Missing and grossly wrong pixels as evidence: lost returns, lost turns, mixed edges."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import binary_dilation, uniform_filter

from tof_core.config import param
from tof_core.reasons import Reason
from tof_gap.seen.finding import Finding
from tof_sensor.effects.dropout import Dropout
from tof_sensor.effects.flying_pixels import Edge, FlyingPixels
from tof_sensor.effects.phase_wrap import PhaseWrap
from tof_sensor.frame import LIGHT_M_PER_S, lambert_amplitude

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float
    from tof_gap.seen.residual import ViewEvidence


@dataclass(frozen=True, slots=True)
class MissingConfig:
    """When missing, wrapped or mixed pixels are an effect."""

    lost_share: float = param(0.01, "share of CAD pixels missing, away from edges", low=1e-6, high=1.0)
    turn_share: float = param(0.002, "share of pixels off by one common turn", low=1e-6, high=1.0)
    turn_spread_mm: float = param(60.0, "spread within which turns are common", unit="mm", low=1.0)
    flying_share: float = param(0.25, "share of the mixture below which edges are clean", low=1e-6, high=1.0)
    step_mm: float = param(30.0, "depth step from which an edge can show mixing", unit="mm", low=1.0)


def findings(views: Sequence[ViewEvidence], config: MissingConfig, *, smeared: bool = False) -> list[Finding]:
    """`dropout`, `phase_wrap` and `flying_pixels`, each where the pixels say so; `smeared`: motion mixes edges of its own."""
    found = (_dropout(views, config), _phase_wrap(views, config), None if smeared else _flying(views, config))
    return [f for f in found if f is not None]


def lost(view: ViewEvidence) -> Float:
    """(H, W) share of a view's captures in which no light came back, away from edges where the CAD is.

    Saturation is too much light: it is told by its code, or by an amplitude above all measured ones.
    """
    seen = view.view
    some = np.where(seen.valid, 1.0 - seen.count / max(seen.captures, 1), seen.reason == Reason.NO_RETURN)
    gone = np.where(view.frame.valid & ~view.edge, some, 0.0)
    if seen.amplitude is None or not view.smooth.any():
        return gone
    brightest = np.quantile(view.frame.amplitude[view.smooth], 0.999)
    return np.where(np.nan_to_num(seen.amplitude) > brightest, 0.0, gone)


def _dropout(views: Sequence[ViewEvidence], config: MissingConfig) -> Finding | None:
    gone = np.concatenate([lost(v)[v.frame.valid & ~v.edge] for v in views])
    if gone.mean() < config.lost_share:
        return None
    light = np.concatenate([lambert_amplitude(v.rendering)[v.frame.valid & ~v.edge] for v in views])
    bright_half = light > np.median(light)
    random = float(gone[bright_half].mean())
    threshold = _half_lost(light, gone)
    share = np.stack([np.where(v.frame.valid, _rate(v, light, gone), np.nan) for v in views])
    effect = Dropout(threshold=threshold, random=min(random, 1.0))
    return Finding(effect, float(min(1.0, gone.mean() / config.lost_share / 2)), share=share)


NEAR_PX = 7


def _rate(view: ViewEvidence, light: Float, gone: Float) -> Float:
    """(H, W) chance of loss: what pixels of this amplitude lose in the session, and what this neighbourhood loses."""
    edges = np.unique(np.quantile(light, np.linspace(0, 1, 41)))
    which = np.clip(np.searchsorted(edges, light, side="right") - 1, 0, len(edges) - 2)
    by_light = np.bincount(which, gone, len(edges) - 1) / np.maximum(np.bincount(which, minlength=len(edges) - 1), 1)
    own = by_light[np.clip(np.searchsorted(edges, lambert_amplitude(view.rendering), side="right") - 1, 0, len(edges) - 2)]
    inside = (view.frame.valid & ~view.edge).astype(float)
    near = uniform_filter(lost(view), NEAR_PX) / np.maximum(uniform_filter(inside, NEAR_PX), 0.1)
    return np.asarray(0.5 * (own + near))


def _half_lost(light: Float, gone: Float) -> float:
    """Amplitude at which half of the pixels are gone; 0 where loss does not follow amplitude."""
    edges = np.quantile(light, np.linspace(0, 1, 21))
    which = np.clip(np.searchsorted(edges, light, side="right") - 1, 0, 19)
    rate = np.array([gone[which == b].mean() if (which == b).any() else 0.0 for b in range(20)])
    dark = np.flatnonzero(rate > 0.5)
    return float(edges[dark.max() + 1]) if len(dark) else 0.0


def _phase_wrap(views: Sequence[ViewEvidence], config: MissingConfig) -> Finding | None:
    # Edges that blur or move jump too: a lost turn shows away from them.
    inner = [~binary_dilation(v.edge, iterations=EDGE_REACH_PX) for v in views]
    jump = np.concatenate([(v.residual * v.frame.length)[v.gross & i] for v, i in zip(views, inner, strict=True)])
    total = sum(int((np.isfinite(v.residual) & i).sum()) for v, i in zip(views, inner, strict=True))
    jump = jump[np.abs(jump) > 0.2]
    if len(jump) < config.turn_share * max(total, 1):
        return None
    size = _common_size(np.abs(jump), config.turn_spread_mm * 1e-3)
    if size < LEAST_TURN_M:
        return None
    near = np.abs(np.abs(jump) - size) < config.turn_spread_mm * 1e-3
    if near.sum() < config.turn_share * total or near.mean() < 0.5:
        return None
    short = bool(np.median(jump[near]) < 0)
    start, share = _where_wrapped(views, size, config, short=short)
    effect = PhaseWrap(modulation_mhz=LIGHT_M_PER_S / (2e6 * size), start_m=start if short else -start, share=share)
    maps = np.stack([_turns(v, size, config) for v in views])
    return Finding(effect, 0.95, share=maps, corrects=True)


LEAST_TURN_M = LIGHT_M_PER_S / (2e6 * PhaseWrap.__dataclass_fields__["modulation_mhz"].metadata["high"])
"""A turn at the highest frequency that an effect may have: what jumps by less lost none."""
EDGE_REACH_PX = 4
"""Pixels beyond the edge band that an edge may still spoil."""


def _common_size(sizes: Float, spread: float) -> float:
    """The size within `spread` of which most jumps lie."""
    ordered = np.sort(sizes)
    counts = np.searchsorted(ordered, ordered + 2 * spread) - np.arange(len(ordered))
    first = int(np.argmax(counts))
    return float(np.median(ordered[first : first + counts[first]]))


def _turns(view: ViewEvidence, size: float, config: MissingConfig) -> Float:
    r = view.residual * view.frame.length
    # Once the turn is known, what lies nearer to it than to none has lost it, however weak its light.
    wrapped = np.abs(np.abs(r) - size) < max(config.turn_spread_mm * 1e-3, 0.4 * size)
    return np.where(np.isfinite(r), np.where(wrapped, np.sign(r) * size / view.frame.length, 0.0), np.nan)


def _where_wrapped(views: Sequence[ViewEvidence], size: float, config: MissingConfig, *, short: bool) -> tuple[float, float]:
    wrapped = np.concatenate([_turns(v, size, config)[np.isfinite(v.residual)] != 0 for v in views])
    radial = np.concatenate([v.frame.radial[np.isfinite(v.residual)] for v in views])
    start = float(np.quantile(radial[wrapped], 0.02 if short else 0.98))
    inside = radial > start if short else radial < start
    return start, float(wrapped[inside].mean())


OWN_SURE = 0.35
"""Second surface's share of a footprint from which half a pixel of pose decides which surface is the pixel's own."""
FOOTPRINTS_PX = (0.4, 0.55, 0.7, 0.85, 1.0)
FLYING_MHZ = (15.0, 30.0, 45.0, 60.0, 70.0, 80.0, 90.0, 100.0, 110.0, 120.0)


def mixing(views: Sequence[ViewEvidence], config: MissingConfig) -> tuple[float, int] | None:
    """Share of the mixed pixels that lie on neither of their surfaces, and their number; None where edges are clean."""
    lying, mixed = _between(views, config)
    if len(mixed) < 80:
        return None
    # Clean edges lie on either surface: only pixels inside the gap, away from both, are mixing.
    inside = (lying > 0.15) & (lying < 0.85)
    share = float(inside.mean() / max(((mixed > 0.15) & (mixed < 0.5)).mean(), 1e-3))
    return None if share < config.flying_share else (share, len(mixed))


def _flying(views: Sequence[ViewEvidence], config: MissingConfig) -> Finding | None:
    """Mixed pixels that lie on neither of their surfaces; then the frequency whose mixture fits them best."""
    found = mixing(views, config)
    if found is None:
        return None
    share, number = found
    edges = [Edge.of(v.frame) for v in views]
    tried = [FlyingPixels(share=1.0, modulation_mhz=f, footprint_px=w) for f in FLYING_MHZ for w in FOOTPRINTS_PX]
    best = min((_fitted(views, edges, effect) for effect in tried), key=lambda fitted: fitted[1])[0]
    maps = np.stack([np.where(v.frame.valid, _mixture_seen(v, edge, best), np.nan) for v, edge in zip(views, edges, strict=True)])
    return Finding(best, float(min(1.0, share / config.flying_share / 2)), {"share": float(1 / np.sqrt(number))}, maps, corrects=True)


def _fitted(views: Sequence[ViewEvidence], edges: Sequence[Edge], effect: FlyingPixels) -> tuple[FlyingPixels, float]:
    """The effect with its share by weighted median, and the mean absolute error left; where a pixel's own surface is sure."""
    model, seen = [], []
    for v, edge in zip(views, edges, strict=True):
        residual = v.residual[edge.where]
        here = (edge.mixed > 0.02) & (edge.mixed < OWN_SURE) & np.isfinite(residual)
        mixture = _nearest_turn(effect, edge, residual)
        model.append(mixture[here])
        seen.append(residual[here])
    x, y = np.concatenate(model), np.concatenate(seen)
    usable = np.abs(x) > 2e-3
    ratio, weight = y[usable] / x[usable], np.abs(x[usable])
    order = np.argsort(ratio)
    middle = np.searchsorted(np.cumsum(weight[order]), 0.5 * weight.sum())
    share = float(np.clip(ratio[order][min(middle, len(order) - 1)], 0.0, 1.5)) if len(order) else 0.0
    return replace(effect, share=share), float(np.abs(y - share * x).mean())


def _nearest_turn(effect: FlyingPixels, edge: Edge, seen: Float) -> Float:
    """(n,) metres of z that mixing adds, in the turn nearest to what was seen: over steps of half a turn that is not foretold."""
    mixture, turn = effect.mixture(edge), LIGHT_M_PER_S / (2e6 * effect.modulation_mhz) / edge.length
    lost = np.round((seen - mixture) / turn)
    return np.where((np.abs(edge.step) > 0.5 * turn * edge.length) & np.isfinite(lost), mixture + lost * turn, mixture)


def _mixture_seen(view: ViewEvidence, edge: Edge, effect: FlyingPixels) -> Float:
    """(H, W) metres that the effect adds in a view."""
    out = np.zeros(view.residual.shape)
    out[edge.where] = effect.share * _nearest_turn(effect, edge, view.residual[edge.where])
    return out


def _between(views: Sequence[ViewEvidence], config: MissingConfig) -> tuple[Float, Float]:
    """Of mixed pixels with a clear step: where they lie (0 own surface, 1 the second), and the mixture."""
    lying, mixed = [], []
    for v in views:
        step = v.rendering.second.astype(np.float64) - v.frame.depth
        clear = (v.rendering.mixed > 0.05) & (np.abs(step) > config.step_mm * 1e-3) & np.isfinite(v.view.depth)
        clear &= np.abs(step) > 10 * v.sigma
        lying.append(((v.view.depth - v.frame.depth) / np.where(step == 0, 1, step))[clear])
        mixed.append(v.rendering.mixed[clear].astype(np.float64))
    return np.concatenate(lying), np.concatenate(mixed)
