# SPDX-License-Identifier: Apache-2.0
"""Mixed pixels at depth edges, whose depth lies on neither of their two surfaces."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tof_gap.seen.finding import Finding
from tof_gap.seen.missing.smeared import smeared
from tof_sensor.effects.flying_pixels import Edge, FlyingPixels
from tof_sensor.frame import LIGHT_M_PER_S, lambert_amplitude

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float
    from tof_gap.limits.missing import MissingLimits
    from tof_gap.seen.evidence.view import ViewEvidence

FOOTPRINTS_PX = (0.4, 0.55, 0.7, 0.85, 1.0)
FLYING_MHZ = (15.0, 30.0, 45.0, 60.0, 70.0, 80.0, 90.0, 100.0, 110.0, 120.0)
"""Footprints and modulation frequencies that are tried."""


def mixing(views: Sequence[ViewEvidence], limits: MissingLimits, least_light: float = 0.0) -> tuple[float, int] | None:
    """Ratio of mixed pixels measured between their surfaces to those expected, and the number of mixed pixels; None where edges are clean.

    least_light: amplitude by the CAD (1 for albedo 1 at 1 m) below which pixels do not count, since the camera loses them.
    """
    places = [_places(v, limits, least_light) for v in views]
    measured, mixed = (np.concatenate(each) for each in zip(*places, strict=True))
    if len(mixed) < limits.mixed_pixels:
        return None
    inside, expected = (float(((at > limits.between) & (at < 1.0 - limits.between)).mean()) for at in (measured, mixed))
    share = inside / max(expected, 1e-3)
    return None if share < limits.flying_share else (share, len(mixed))


def flying_pixels(views: Sequence[ViewEvidence], limits: MissingLimits, least_light: float = 0.0) -> Finding | None:
    """`flying_pixels` where most mixed pixels are measured, with the footprint and modulation frequency that fit best.

    Not where a filter smears edges: then the pixels in which light was mixed are unknown.
    """
    found = mixing(views, limits, least_light)
    if found is None or found[0] < limits.unfiltered_share or smeared(views, limits):
        return None
    number = found[1]
    edges = [Edge.of(v.frame) for v in views]
    tried = [FlyingPixels(share=1.0, modulation_mhz=f, footprint_px=w) for f in FLYING_MHZ for w in FOOTPRINTS_PX]
    best = min((_fitted(views, edges, effect, limits) for effect in tried), key=lambda fitted: fitted[1])[0]
    maps = np.stack([np.where(v.frame.valid, _mixture_map(v, edge, best), np.nan) for v, edge in zip(views, edges, strict=True)])
    return Finding(best, 1.0, {"share": float(1 / np.sqrt(number))}, maps, corrects=True)


def _fitted(
    views: Sequence[ViewEvidence], edges: Sequence[Edge], effect: FlyingPixels, limits: MissingLimits
) -> tuple[FlyingPixels, float]:
    """The effect with its fitted share (weighted median), and the mean absolute error left, over pixels whose own surface is certain."""
    model, seen = [], []
    for v, edge in zip(views, edges, strict=True):
        residual = v.residual[edge.where]
        here = (edge.mixed > limits.mixed_fitted) & (edge.mixed < v.limits.own_share) & np.isfinite(residual)
        model.append(_nearest_wrap(effect, edge, residual)[here])
        seen.append(residual[here])
    x, y = np.concatenate(model), np.concatenate(seen)
    usable = np.abs(x) > limits.fitted_mm * 1e-3
    ratio, weight = y[usable] / x[usable], np.abs(x[usable])
    order = np.argsort(ratio, kind="stable")
    middle = np.searchsorted(np.cumsum(weight[order]), 0.5 * weight.sum())
    low, high = (float(bound[0]) for bound in effect.bounds)
    share = float(np.clip(ratio[order][min(middle, len(order) - 1)], low, high)) if len(order) else 0.0
    return replace(effect, share=share), float(np.abs(y - share * x).mean())


def _nearest_wrap(effect: FlyingPixels, edge: Edge, seen: Float) -> Float:
    """(n,) metres of z that mixing adds, shifted by the whole period that brings it nearest to the measured error `seen` (n,).

    Over steps of more than half the unambiguous range, the sign of the phase difference cannot be predicted.
    """
    mixture, turn = effect.mixture(edge), LIGHT_M_PER_S / (2e6 * effect.modulation_mhz) / edge.length
    periods = np.round((seen - mixture) / turn)
    return np.where((np.abs(edge.step) > 0.5 * turn * edge.length) & np.isfinite(periods), mixture + periods * turn, mixture)


def _mixture_map(view: ViewEvidence, edge: Edge, effect: FlyingPixels) -> Float:
    """(H, W) metres that the effect adds in a view."""
    out = np.zeros(view.residual.shape)
    out[edge.where] = effect.share * _nearest_wrap(effect, edge, view.residual[edge.where])
    return out


def _places(view: ViewEvidence, limits: MissingLimits, least_light: float) -> tuple[Float, Float]:
    """(n,) places between both surfaces (0 own, 1 second) of mixed pixels at a clear step: as measured, NaN without depth, and by light.

    By light, a pixel lies at the second surface's share of the light: next to a dark surface it lies on the bright one. Pixels that a
    filter in the camera removed count as well, since a filter may miss some.
    """
    edge = Edge.of(view.frame)
    step = edge.step / edge.length
    clear = (edge.mixed > limits.mixed_least) & (np.abs(step) > limits.step_mm * 1e-3)
    clear &= np.abs(step) > limits.step_sigma * view.sigma[edge.where]
    clear &= lambert_amplitude(view.rendering)[edge.where] >= least_light
    measured = (view.view.depth - view.frame.depth)[edge.where]
    second = edge.mixed * edge.light
    return (measured / np.where(step == 0, 1, step))[clear], (second / (1.0 - edge.mixed + second))[clear]
