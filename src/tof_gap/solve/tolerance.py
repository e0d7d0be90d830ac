# SPDX-License-Identifier: Apache-2.0
"""Errors of a healthy camera: hand-eye and lens within their stated calibration, and effects below a tolerance."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_core.stats import touched
from tof_gap.solve.candidate import HAND_EYE
from tof_sensor.effects.depth_scale import DepthScale
from tof_sensor.effects.intrinsics import Intrinsics
from tof_sensor.registry import EFFECTS

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from tof_core.arrays import Float
    from tof_core.calibration import Calibration
    from tof_core.camera import Camera
    from tof_gap.seen.residual import ViewEvidence
    from tof_gap.solved import Named


MOST_PIXELS = 4_000_000
"""Pixels of a session of which the size of a map is taken; of more, every third or fifth: all of a long session are a gigabyte."""


def calibrated(one: Named, stated: Calibration, camera: Camera) -> bool:
    """Whether a named effect is hand-eye, lens, or scale before a printed board, and within the stated calibration."""
    if one.name == HAND_EYE:
        return _mounted_as_stated(one, stated)
    if one.name == DepthScale.NAME:
        return _no_longer(one.effects[0].coefficients, np.array([*one.std[0].values()]), 1e-2 * stated.board.print_scale_pct)
    return one.name == Intrinsics.NAME and _seen_as_stated(one, stated, camera)


def sizes_m(maps: Mapping[str, Sequence[Float]], views: Sequence[ViewEvidence], held_out: Sequence[int]) -> dict[str, float]:
    """Size in metres of each map ((H, W) metres per view) over all views, by the share of its energy that the held-out views confirm.

    The held-out views may see more or less of an effect on a single part than the others. Effects with their largest errors at edges
    (`Effect.AT_EDGES`) are not fitted there: the share confirmed elsewhere is assumed.
    """
    left = {k: views[k].residual - sum((np.nan_to_num(m[k]) for m in maps.values()), np.zeros(views[k].residual.shape)) for k in held_out}
    every = 1 + 2 * (sum(v.residual.size for v in views) // MOST_PIXELS)  # Odd: else columns of the image would be left out.
    out = {}
    for name, by_view in maps.items():
        fitted, errors = (np.concatenate([_fitted(m[k], views[k]) for k in held_out]) for m in (by_view, left))
        values = _one_surface if _errs_at_edges(name) else _fitted
        everywhere = np.concatenate([values(m, v)[::every] for m, v in zip(by_view, views, strict=True)])
        out[name] = float(np.sqrt(confirmed(fitted, errors) * mean_square(everywhere)))
    return out


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


def _mounted_as_stated(one: Named, stated: Calibration) -> bool:
    """Whether position and rotation of the camera are within the stated calibration, to one standard deviation."""
    values, sd = one.effects[0].coefficients, np.array([*one.std[0].values()])
    parts = zip((slice(3), slice(3, 6)), stated.hand_eye_most, strict=True)
    return all(_no_longer(values[at], sd[at], bound) for at, bound in parts)


def _no_longer(vector: Float, sd: Float, bound: float) -> bool:
    """Whether a vector's length is within a bound above 0, to one standard deviation in its direction."""
    length = float(np.linalg.norm(vector))
    return bound > 0 and length <= bound + float(np.linalg.norm(vector / max(length, 1e-12) * sd))


def _seen_as_stated(one: Named, stated: Calibration, camera: Camera) -> bool:
    """Whether a lens shifts rays by no more than the stated calibration, both in pixels RMS over the image."""
    if not stated.lens_sd.any():
        return False
    rays, there = ((c.rays()[..., :2] * (camera.fx, camera.fy)) for c in (camera, one.effects[0].camera(camera)))
    shift, radius = (float(np.sqrt(np.mean(np.sum(r**2, axis=-1)))) for r in (there - rays, rays))
    return shift <= stated.lens_most_px(radius)
