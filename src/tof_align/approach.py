# SPDX-License-Identifier: Apache-2.0
"""From far to near: the pose of a rigid set of cameras, with a kernel that narrows as it goes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_align.linearise import linearise
from tof_align.robust import mad, tukey
from tof_core import se3

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from tof_align.config import AlignConfig
    from tof_align.linearise import Linearised
    from tof_align.pixels import Pixels
    from tof_core.arrays import Float
    from tof_scene.raycast import Raycaster

WITNESSES = 100.0
"""Independent witnesses a view counts for while far: enough to beat a prior, too few to drown it."""


def approach(
    pixels: Sequence[Pixels],
    poses: Float,
    frame: Float,
    prior_std: Float,
    caster: Raycaster,
    config: AlignConfig,
) -> Float:
    """The motion (4, 4) of `frame` that brings cameras held rigidly together near the CAD.

    Args:
        pixels: coarse rasters of the views.
        poses: (V, 4, 4) T_cell_camera as believed.
        frame: (4, 4) T_cell_frame in which the prior holds.
        prior_std: (6,) of a right perturbation of the frame.
        caster: the scene.
        config: kernels and verdict limits.

    Starts at the robot's pose; where that ends badly, at many others inside the prior; and slides
    along what the surfaces leave nearly open, since a descent cannot.
    """
    seen = _spread_out(pixels)
    local = se3.inverse(frame) @ poses
    descend = _descent([pixels[v] for v in seen], local[seen], frame, prior_std, caster, config)
    best, score = descend(np.eye(4), config.weights.kernel_far_mm * 1e-3)
    if score > 0.5 * _LIMIT or np.max(prior_std / _NEAR) > 1.0:
        for start in _starts([pixels[v] for v in seen], local[seen], frame, prior_std, caster):
            motion, found = descend(start, 0.06)
            if found < 0.95 * score:
                best, score = motion, found
    return _slid(best, score, descend, [pixels[v] for v in seen], local[seen], frame, prior_std, caster, config)


def _slid(
    motion: Float,
    score: float,
    descend: Callable[[Float, float], tuple[Float, float]],
    pixels: Sequence[Pixels],
    local: Float,
    frame: Float,
    prior_std: Float,
    caster: Raycaster,
    config: AlignConfig,
) -> Float:
    """Look along the three directions that the surfaces tell least, as far as the prior reaches, and descend again.

    A part that is nearly the same everywhere along a direction holds the descent at whatever
    place it reached; its few features count there as outliers. The score sees them.
    """
    few = [p.thinned(max(200, p.depth.size // 2)) for p in pixels]

    def cost(there: Float) -> float:
        return _score(few, frame @ there @ local, caster)

    for _ in range(2):
        before = score
        for direction in _least_known(pixels, motion, local, frame, prior_std, caster, config):
            slid = _along(direction * prior_std, motion, cost)
            if cost(slid) > 0.98 * cost(motion):
                continue
            candidates = [(_score(pixels, frame @ slid @ local, caster), slid), descend(slid, 0.02)[::-1]]
            found, moved = min(candidates, key=lambda c: c[0])
            if found < 0.98 * score:
                motion, score = moved, found
        if score == before:
            break
    return motion


def _along(twist: Float, motion: Float, cost: Callable[[Float], float]) -> Float:
    """The best place along a direction (6,), within 1.6 of it to either side: 21 looks, then 4 closer ones."""
    step, best = 0.16, motion
    for offsets in (np.arange(-10, 11) * step, np.array([-0.6, -0.3, 0.0, 0.3, 0.6]) * step):
        places = [best @ se3.exp(t * twist) for t in offsets]
        best = places[int(np.argmin([cost(p) for p in places]))]
    return best


def _least_known(
    pixels: Sequence[Pixels],
    motion: Float,
    local: Float,
    frame: Float,
    prior_std: Float,
    caster: Raycaster,
    config: AlignConfig,
) -> Float:
    """(3, 6) unit directions, in the prior's deviations, of which the surfaces that agree say least.

    What disagrees must not be asked: a feature rendered in the wrong place would tie down the very slide that is needed.
    """
    H = np.zeros((6, 6))
    for p, T in zip(pixels, local, strict=True):
        view = linearise(p, frame @ motion @ T, caster, config.weights)
        J = view.jacobian @ se3.adjoint(se3.inverse(T)) * prior_std
        H += (J * tukey(view.residual, config.verdict.support_mm * 1e-3)[:, None]).T @ J
    return np.asarray(np.linalg.eigh(H)[1][:, :3].T)


_LIMIT = 0.03
_NEAR = np.repeat([0.06, np.radians(3.0)], 3)


def _spread_out(pixels: Sequence[Pixels], most: int = 6) -> list[int]:
    """Enough views to find a station by: the first ones spread over the whole."""
    return sorted({int(i) for i in np.linspace(0, len(pixels) - 1, min(most, len(pixels)))})


def _descent(
    pixels: Sequence[Pixels],
    local: Float,
    frame: Float,
    prior_std: Float,
    caster: Raycaster,
    config: AlignConfig,
) -> Callable[[Float, float], tuple[Float, float]]:
    def descend(motion: Float, kernel: float) -> tuple[Float, float]:
        for _ in range(24):
            views = [linearise(p, frame @ motion @ T, caster, config.weights) for p, T in zip(pixels, local, strict=True)]
            errors = np.concatenate([v.residual for v in views])
            if len(errors) < 6:
                break
            step = _step(views, local, motion, prior_std, kernel)
            motion = motion @ se3.exp(step)
            kernel = max(0.7 * kernel, min(kernel, 3.0 * mad(errors[np.abs(errors) < kernel])), config.weights.kernel_floor_mm * 1e-3)
            if np.linalg.norm(step[:3]) < 2e-4 and np.linalg.norm(step[3:]) < 2e-4 and kernel < 0.03:
                break
        return motion, _score(pixels, frame @ motion @ local, caster)

    return descend


def _step(views: Sequence[Linearised], local: Float, motion: Float, prior_std: Float, kernel: float) -> Float:
    """One Gauss-Newton step of the frame; each view counts as `WITNESSES` pixels of kernel / 3."""
    H = np.diag(prior_std**-2)
    b = -H @ se3.log(motion)
    for view, T in zip(views, local, strict=True):
        if not len(view.residual):
            continue
        weight = tukey(view.residual, kernel)
        weight *= WITNESSES / len(weight) / (kernel / 3.0) ** 2
        J = view.jacobian @ se3.adjoint(se3.inverse(T))
        H += (J * weight[:, None]).T @ J
        b += J.T @ (weight * view.residual)
    return np.asarray(np.linalg.solve(H, b))


def _score(pixels: Sequence[Pixels], poses: Float, caster: Raycaster) -> float:
    """Mean of min(|residual|, 30 mm) over all pixels that have a depth; the CAD's misses count in full."""
    total = count = 0.0
    for p, T in zip(pixels, poses, strict=True):
        error = _errors(p.depth.ravel(), p.rays.reshape(-1, 3), T, caster)
        total, count = total + np.minimum(error, _LIMIT).sum(), count + len(error)
    return total / max(count, 1.0)


def _errors(depth: Float, rays: Float, T: Float, caster: Raycaster) -> Float:
    known = np.isfinite(depth)
    hits = caster.cast(np.broadcast_to(T[:3, 3], (int(known.sum()), 3)), rays[known] @ T[:3, :3].T)
    return np.nan_to_num(np.abs(depth[known] - hits.t), nan=1.0, posinf=1.0)


def _starts(
    pixels: Sequence[Pixels],
    local: Float,
    frame: Float,
    prior_std: Float,
    caster: Raycaster,
    *,
    tried: int = 256,
    kept: int = 6,
) -> list[Float]:
    """The most promising of many motions inside the prior (a fixed low-discrepancy set), on few rays."""
    from scipy.stats import qmc  # a second to import, and rarely needed

    sobol = qmc.Sobol(6, scramble=True, seed=1).random(tried)
    twists = np.clip(qmc.scale(sobol, -1.8 * np.ones(6), 1.8 * np.ones(6)), -1.8, 1.8) * prior_std
    few = [(p.depth.ravel()[::9], p.rays.reshape(-1, 3)[::9]) for p in pixels[:3]]
    scores = [
        np.mean(
            [
                np.minimum(_errors(z, r, frame @ se3.exp(x) @ T, caster), 0.15).mean() if np.isfinite(z).any() else 0.15
                for (z, r), T in zip(few, local, strict=False)
            ]
        )
        for x in twists
    ]
    return [se3.exp(twists[i]) for i in np.argsort(scores)[:kept]]
