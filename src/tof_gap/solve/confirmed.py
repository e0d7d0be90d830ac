# SPDX-License-Identifier: Apache-2.0
"""Sizes of effects, as views confirm them that the effects were not fitted to."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_core.stats import touched
from tof_gap.solve.causes import fitted
from tof_gap.solve.lateness import late_apart
from tof_gap.solve.offset import offset_apart
from tof_sensor.effects.range_offset import RangeOffset
from tof_sensor.effects.time_sync import TimeSync
from tof_sensor.registry import EFFECTS

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from tof_core.arrays import Float
    from tof_gap.limits.solve import JointLimits
    from tof_gap.seen.evidence.view import ViewEvidence
    from tof_gap.solve.causes import Posed
    from tof_gap.solve.choose.judge import Selector
    from tof_gap.solve.solution import Joint
    from tof_gap.solved import Split

MOST_PIXELS = 4_000_000
"""Pixels of a session of which the size of a map is taken; of more, every third or fifth: all of a long session are a gigabyte."""


def confirmed_m(
    joint: Joint,
    judge: Selector,
    posed: Posed,
    maps: Mapping[str, Sequence[Float]],
    free: Mapping[str, Sequence[Float]],
    split: Split,
    limits: JointLimits,
) -> dict[str, float]:
    """Size in metres of each effect, by the share of its energy that all views confirm, each with coefficients fitted to the others.

    posed: the views at the true poses; maps: there, of the effects that do not move the camera, fitted to `split.fit`; free: of free functions.
    """
    further, everywhere = {}, range(len(posed.views))
    for views in split.others if maps else ():
        found = fitted(joint, [v for v in everywhere if v not in views], judge)
        apart = late_apart(found, limits.frame_taps, asked=TimeSync.NAME in joint.asked)
        apart = offset_apart(apart, posed.views, -np.inf, asked=RangeOffset.NAME in maps)
        by_name = posed.shares([n for n in apart if n.name in maps], views)
        for i, v in enumerate(views):
            further[v] = {name: by_view[i] for name, by_view in by_name.items()} | {of: by_view[v] for of, by_view in free.items()}
    sizes = sizes_m({**maps, **free}, posed.views, split.held_out, further)
    return {name: sizes[name] for name in maps}


def sizes_m(
    maps: Mapping[str, Sequence[Float]],
    views: Sequence[ViewEvidence],
    held_out: Sequence[int],
    further: Mapping[int, Mapping[str, Float]] | None = None,
) -> dict[str, float]:
    """Size in metres of each map ((H, W) metres per view) over all views, by the share of its energy that held-out views confirm.

    held_out: views to which no coefficient of the maps was fitted; further: by view, other maps that were not fitted to it. The more views
    confirm a map the better, since a view may see more or less of an effect on a single part than the others. Effects with their largest
    errors at edges (`Effect.AT_EDGES`) are not fitted there: the share confirmed elsewhere is assumed.
    """
    apart = {k: {name: m[k] for name, m in maps.items()} for k in held_out} | dict(further or {})
    left = {
        k: views[k].residual - sum((np.nan_to_num(m) for m in own.values()), np.zeros(views[k].residual.shape)) for k, own in apart.items()
    }
    every = 1 + 2 * (sum(v.residual.size for v in views) // MOST_PIXELS)  # Odd: else columns of the image would be left out.
    out = {}
    for name, by_view in maps.items():
        fitted = np.concatenate([_fitted(own[name], views[k]) for k, own in apart.items()])
        errors = np.concatenate([_fitted(left[k], views[k]) for k in apart])
        values = _one_surface if _errs_at_edges(name) else _fitted
        everywhere = np.concatenate([values(m, v)[::every] for m, v in zip(by_view, views, strict=True)])
        out[name] = float(np.sqrt(confirmed(fitted, errors) * mean_square(everywhere)))
    return out


def seen_share(name: str, maps: Mapping[str, Sequence[Float]], views: Sequence[ViewEvidence], least_m: float) -> float:
    """Share of the map `name`, 0 to 1, that the measured pixels which it moves by `least_m` and more show, edges among them.

    maps: of all effects and free functions. Their residual is regressed on the map, weighted by the noise: 1 where the map is right, 0 where
    its pixels show nothing. A filter that smooths edges resembles motion there, and leaves a fifth of its map.
    """
    shown = moved = 0.0
    for k, v in enumerate(views):
        own = maps[name][k]
        rest = v.residual - sum((np.nan_to_num(m[k]) for other, m in maps.items() if other != name), np.zeros(own.shape))
        counts = np.isfinite(rest) & (np.abs(np.nan_to_num(own)) > least_m) & ~v.gross
        scaled = own[counts] / v.sigma[counts] ** 2
        shown += float((scaled * rest[counts]).sum())
        moved += float((scaled * own[counts]).sum())
    return min(max(shown / moved, 0.0), 1.0) if moved else 0.0


def energy_share(name: str, maps: Mapping[str, Sequence[Float]]) -> float:
    """Energy of the map `name` over that of the sum of all maps, over all pixels."""
    own = sum(float(np.nansum(np.square(m, dtype=float))) for m in maps[name])
    whole = sum(float(np.square(sum(np.nan_to_num(m[v]) for m in maps.values()), dtype=float).sum()) for v in range(len(maps[name])))
    return own / max(whole, 1e-18)


def confirmed(effect: Float, left: Float) -> float:
    """Share of the squared map (n,), in metres, that the measurements confirm, over the pixels that the map touches.

    left (n,): the residual after all maps. The residual before this map is e = left + effect, so the map removes
    e^2 - left^2 = effect^2 + 2 effect left. That is effect^2 if the map is right, and negative if there is no such effect. Over pixels
    that the map was not fitted to, it is an unbiased estimate of the squared size of the true effect.
    """
    affected = touched(effect)
    square = mean_square(effect)
    return max(1.0 + 2.0 * float(np.mean(effect[affected] * left[affected])) / square, 0.0) if square > 0 else 0.0


def mean_square(effect: Float) -> float:
    """m^2: mean square of a map (n,) over the pixels that it touches."""
    affected = touched(effect)
    return float(np.mean(effect[affected] ** 2)) if affected.any() else 0.0


def _errs_at_edges(name: str) -> bool:
    return name in EFFECTS and EFFECTS[name].AT_EDGES


def _fitted(effect: Float, view: ViewEvidence) -> Float:
    """(n,) metres of a map, or of what is left, at the pixels away from edges, which are fitted."""
    return np.asarray(np.nan_to_num(effect[view.smooth]))


def _one_surface(effect: Float, view: ViewEvidence) -> Float:
    """(n,) metres of a map at the measured pixels of the CAD, without changes too large for a bias, where another surface comes into view."""
    values = effect[np.isfinite(view.residual) & np.isfinite(effect)]
    return np.asarray(values[np.abs(values) < view.limits.gross_mm * 1e-3])
