# SPDX-License-Identifier: Apache-2.0
"""Search from afar: the pose of a rigid set of cameras, with a robust kernel that narrows from step to step."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from tof_align.linearise import linearise
from tof_align.robust import tukey
from tof_core import se3
from tof_core.stats import robust_std

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from tof_align.config import AlignConfig
    from tof_align.limits import ApproachLimits
    from tof_align.linearise import Linearised
    from tof_align.pixels import Pixels
    from tof_core.arrays import Float, Ints
    from tof_scene.raycast import Raycaster


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
        poses: (V, 4, 4) T_cell_camera by the robot.
        frame: (4, 4) T_cell_frame in which the prior holds.
        prior_std: (6,) of a right perturbation of the frame.
        caster: the scene.
        config: kernels and verdict limits.

    The search starts at the robot's pose and, where that ends with a poor score, at many others within the prior. Then it slides along
    the directions that the surfaces determine least, in which a descent does not move.
    """
    limits = config.approach
    seen = _spread_out(pixels, limits.views)
    cameras = _Cameras([pixels[v] for v in seen], (se3.inverse(frame) @ poses)[seen], frame, prior_std, caster, config)
    best, score = cameras.descend(np.eye(4), config.weights.kernel_far_mm * 1e-3)
    wide = np.repeat([limits.wide_mm * 1e-3, np.radians(limits.wide_deg)], 3)
    if score > limits.fits * limits.residual_mm * 1e-3 or np.max(prior_std / wide) > 1.0:
        for start in cameras.starts():
            motion, found = cameras.descend(start, limits.start_kernel_mm * 1e-3)
            if found < limits.better * score:
                best, score = motion, found
    return cameras.slid(best, score)


CLOSER = np.array([-0.6, -0.3, 0.0, 0.3, 0.6])
"""Trials around the best one, in units of the first spacing: they reach beyond the middle to either neighbour."""
STARTS_SEED = 1
"""Seed of the low-discrepancy set, for the same starts in every run."""


def _spread_out(pixels: Sequence[Pixels], most: int) -> list[int]:
    """Indices of at most `most` views, spread over the station."""
    return sorted({int(i) for i in np.linspace(0, len(pixels) - 1, min(most, len(pixels)))})


@dataclass(frozen=True, eq=False)
class _Cameras:
    """Cameras held rigidly together: rasters (V) and poses (V, 4, 4) in the frame (4, 4), whose motion has the prior deviation (6,)."""

    pixels: Sequence[Pixels]
    local: Float
    frame: Float
    prior_std: Float
    caster: Raycaster
    config: AlignConfig

    @cached_property
    def every(self) -> _Looks:
        """All pixels of all views."""
        return _Looks.of(self.pixels)

    def score(self, looks: _Looks, motion: Float) -> float:
        """Mean of min(|residual|, `residual_mm`) in metres over all pixels with a depth; `residual_mm` where the ray misses the CAD."""
        if not len(looks.depth):
            return 0.0
        errors = looks.errors(self.frame @ motion @ self.local, self.caster)
        return float(np.minimum(errors, self.config.approach.residual_mm * 1e-3).mean())

    def linearised(self, motion: Float) -> list[Linearised]:
        """Residuals and Jacobians of the views after a motion of the frame."""
        return [
            linearise(p, self.frame @ motion @ T, self.caster, self.config.weights) for p, T in zip(self.pixels, self.local, strict=True)
        ]

    def descend(self, motion: Float, kernel: float) -> tuple[Float, float]:
        """Gauss-Newton steps from a motion, with a kernel in metres that narrows; the motion, and its score."""
        limits = self.config.approach
        for _ in range(limits.steps):
            views = self.linearised(motion)
            errors = np.concatenate([v.residual for v in views])
            if len(errors) < limits.residuals:
                break
            step = _step(views, self.local, motion, self.prior_std, kernel, limits.independent)
            motion = motion @ se3.exp(step)
            spread = limits.kernel_sigma * robust_std(errors[np.abs(errors) < kernel])
            kernel = max(limits.shrink * kernel, min(kernel, spread), self.config.weights.kernel_floor_mm * 1e-3)
            still = max(np.linalg.norm(step[:3]), np.linalg.norm(step[3:])) < limits.still_mm * 1e-3
            if still and kernel < limits.near_kernel_mm * 1e-3:
                break
        return motion, self.score(self.every, motion)

    def slid(self, motion: Float, score: float) -> Float:
        """Score poses along the directions that the surfaces determine least, as far as the prior reaches, and descend again.

        On a part that is nearly uniform along a direction, the descent stays where it arrived, and the part's few features count as
        outliers there. The score includes them.
        """
        limits = self.config.approach
        known = dict[bytes, float]()

        def cost(there: Float) -> float:
            place = there.tobytes()  # Every series of trials contains the best of the previous one.
            if place not in known:
                known[place] = self.score(self.every, there)
            return known[place]

        for _ in range(limits.slide_rounds):
            before = score
            for direction in self.least_known(motion):
                slid = _along(direction * self.prior_std, motion, cost, limits)
                if cost(slid) > limits.slide_better * cost(motion):
                    continue
                candidates = [(cost(slid), slid), self.descend(slid, limits.slide_kernel_mm * 1e-3)[::-1]]
                found, moved = min(candidates, key=lambda c: c[0])
                if found < limits.slide_better * score:
                    motion, score = moved, found
            if score == before:
                break
        return motion

    def least_known(self, motion: Float) -> Float:
        """(slides, 6) unit directions, in prior standard deviations, that the agreeing surfaces determine least.

        Surfaces that disagree are left out: a feature rendered in the wrong place would prevent the very slide that is needed.
        """
        H = np.zeros((6, 6))
        for view, T in zip(self.linearised(motion), self.local, strict=True):
            J = view.jacobian @ se3.adjoint(se3.inverse(T)) * self.prior_std
            H += (J * tukey(view.residual, self.config.verdict.support_mm * 1e-3)[:, None]).T @ J
        return np.asarray(np.linalg.eigh(H)[1][:, : self.config.approach.slides].T)

    def starts(self) -> list[Float]:
        """The most promising of many motions inside the prior (a fixed low-discrepancy set), on few rays."""
        from scipy.stats import qmc  # Takes a second to import, and is rarely needed.

        limits = self.config.approach
        reach, most, local = limits.reach, limits.start_residual_mm * 1e-3, self.local[: limits.start_views]
        sobol = qmc.Sobol(6, scramble=True, seed=STARTS_SEED).random(limits.starts)
        twists = np.clip(qmc.scale(sobol, -reach * np.ones(6), reach * np.ones(6)), -reach, reach) * self.prior_std
        few = _Looks.of(self.pixels[: limits.start_views], limits.start_stride)
        scores = [_mean_by_view(few, np.minimum(few.errors(self.frame @ se3.exp(x) @ local, self.caster), most), most) for x in twists]
        return [se3.exp(twists[i]) for i in np.argsort(scores, kind="stable")[: limits.kept]]


def _along(twist: Float, motion: Float, cost: Callable[[Float], float], limits: ApproachLimits) -> Float:
    """The best motion along a direction (6,), within `slide_reach` to either side: evenly spaced trials, then closer ones."""
    looks, best = limits.slide_looks, motion
    step = limits.slide_reach / looks
    for offsets in (np.arange(-looks, looks + 1) * step, CLOSER * step):
        places = [best @ se3.exp(t * twist) for t in offsets]
        best = places[int(np.argmin([cost(p) for p in places]))]
    return best


def _step(views: Sequence[Linearised], local: Float, motion: Float, prior_std: Float, kernel: float, independent: float) -> Float:
    """One Gauss-Newton step of the frame; each view counts as `independent` pixels with a standard deviation of kernel / 3."""
    H = np.diag(prior_std**-2)
    b = -H @ se3.log(motion)
    for view, T in zip(views, local, strict=True):
        if not len(view.residual):
            continue
        weight = tukey(view.residual, kernel)
        weight *= independent / len(weight) / (kernel / 3.0) ** 2
        J = view.jacobian @ se3.adjoint(se3.inverse(T))
        H += (J * weight[:, None]).T @ J
        b += J.T @ (weight * view.residual)
    return np.asarray(np.linalg.solve(H, b))


@dataclass(frozen=True, slots=True, eq=False)
class _Looks:
    """Pixels with a depth (n,), and their rays (n, 3), of several views, one after the other; ends (V + 1,): where each view begins."""

    depth: Float
    rays: Float
    ends: Ints

    @classmethod
    def of(cls, pixels: Sequence[Pixels], stride: int = 1) -> _Looks:
        """Every `stride`-th pixel."""
        depth = [p.depth.ravel()[::stride] for p in pixels]
        known = [np.isfinite(z) for z in depth]
        rays = [p.rays.reshape(-1, 3)[::stride][k] for p, k in zip(pixels, known, strict=True)]
        ends = np.cumsum([0, *(int(k.sum()) for k in known)])
        return cls(np.concatenate([z[k] for z, k in zip(depth, known, strict=True)]), np.concatenate(rays), ends)

    def errors(self, poses: Float, caster: Raycaster) -> Float:
        """(n,) metres between depth and CAD from cameras (V, 4, 4), 1 where the ray misses: one cast for all views."""
        directions = np.empty_like(self.rays)
        for T, a, b in zip(poses, self.ends, self.ends[1:], strict=False):
            directions[a:b] = self.rays[a:b] @ T[:3, :3].T
        hits = caster.cast(np.repeat(poses[:, :3, 3], np.diff(self.ends), axis=0), directions)
        return np.nan_to_num(np.abs(self.depth - hits.t), nan=1.0, posinf=1.0)


def _mean_by_view(looks: _Looks, errors: Float, most: float) -> float:
    """Mean over views of the mean of their pixels; `most` for a view that has none."""
    views = [errors[a:b] for a, b in zip(looks.ends, looks.ends[1:], strict=False)]
    return float(np.mean([v.mean() if len(v) else most for v in views]))
