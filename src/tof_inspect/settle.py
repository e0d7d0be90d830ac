# SPDX-License-Identifier: Apache-2.0
"""The last step of a fit and its covariance: inner pixels determine a part's place along the lines of sight, outlines across them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tof_core import se3
from tof_inspect.patch import at, cost_of, linearised

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from tof_core.arrays import Float, Ints
    from tof_inspect.config import InspectConfig
    from tof_inspect.patch import Patch
    from tof_inspect.shared import SharedErrors
    from tof_scene.raycast import Raycaster

USUAL = 3.5
"""Residuals beyond this many sigmas are outliers."""
EDGE_PX = 0.25
"""Standard deviation, in pixels, of an outline in one view: a pixel at an edge measures a mixture of both surfaces."""
ASSUMED_PIXELS = 6
"""Pixels with the assumed noise that are added to a part's pixels: a few residuals do not determine the noise."""
LEAST_INNER = 8
"""Inner pixels of a part in a view from which only these determine its depth; pixels at the outline measure a mixture."""
STEPS, LONGEST_M = 2, 0.003
"""Number of steps, and the longest step in metres."""


@dataclass(frozen=True, slots=True, eq=False)
class _View:
    """Information of one view on the part.

    e, J, w (k,), (k, 3), (k,): error, Jacobian and weight of its inner pixels; at (k,): their index in the patch; outline (3, 3):
    information of the outline, across the line of sight.
    """

    patch: Patch
    e: Float
    J: Float
    w: Float
    at: Ints
    outline: Float

    @property
    def inner(self) -> Float:
        """(3, 3) information of the inner pixels."""
        return np.asarray((self.J * self.w[:, None]).T @ self.J)


@dataclass(frozen=True, slots=True, eq=False)
class Settled:
    """A part's motion (4, 4), and the covariances (3, 3) of its shift: noise, outline, shared as in `displaced.Fit`."""

    motion: Float
    noise: Float
    outline: Float
    shared: Float


def settle(
    motion: Float, patches: Sequence[Patch], alone: Raycaster, centre: Float, config: InspectConfig, errors: SharedErrors
) -> Settled:
    """Fit the shift to the inner pixels; across the lines of sight, the outlines hold it."""
    outlines = [_outline(motion, p, alone, centre) for p in patches]
    prior = np.eye(3) * (config.search_mm * 1e-3) ** -2.0
    views, H = list[_View](), prior
    for _ in range(STEPS):
        views = [_view(motion, p, outline, alone, centre) for p, outline in zip(patches, outlines, strict=True)]
        H = sum((v.inner + v.outline for v in views), prior)
        step = np.linalg.solve(H, sum(((v.J * v.w[:, None]).T @ v.e for v in views), np.zeros(3)))
        motion = at(step * min(1.0, LONGEST_M / max(float(np.linalg.norm(step)), 1e-12))) @ motion
    return _uncertain(motion, views, np.linalg.inv(H), centre, errors)


def _outline(motion: Float, patch: Patch, alone: Raycaster, centre: Float) -> Float:
    """(3, 3) information of the part's outline in a view: curvature of the cost minus that of depth, across the line of sight."""
    _, J, w, _ = linearised(motion, patch, alone, centre)
    rest = positive(curvature(motion, lambda m: cost_of(m, [patch], alone, centre)) - (J[:, :3] * w[:, None]).T @ J[:, :3])
    across = _across(motion, patch, centre)
    return np.asarray(across @ rest @ across)


def _view(motion: Float, patch: Patch, outline: Float, alone: Raycaster, centre: Float) -> _View:
    e, J, w, on = linearised(motion, patch, alone, centre)
    inner = patch.inner(on)[on]
    keep = inner if inner.sum() >= LEAST_INNER else np.ones(len(e), bool)
    return _View(patch, e[keep], J[keep, :3], w[keep], np.flatnonzero(on)[keep], outline)


def _across(motion: Float, patch: Patch, centre: Float) -> Float:
    """(3, 3) projection across the line of sight."""
    line = centre + motion[:3, 3] - patch.origin
    line = line / np.linalg.norm(line)
    return np.asarray(np.eye(3) - np.outer(line, line))


def _uncertain(motion: Float, views: Sequence[_View], inverse: Float, centre: Float, errors: SharedErrors) -> Settled:
    """The motion with its covariances.

    Let H_v be the information of view v, and H of all. An error xi of the view's pose moves the estimate by H^-1 H_v M xi (the camera's
    motion moves the part the other way); errors C u of the camera at its pixels move it by H^-1 J' W C u. Noise is scaled by the
    residuals of the part: their sums over cells of neighbours, relative to independent pixels.
    """
    maps, edges = {}, np.zeros((3, 3))
    middle = centre + motion[:3, 3]
    for v in views:
        T = errors.pose(v.patch.view)
        p = se3.apply(se3.inverse(T), middle[None])[0]
        moved = -T[:3, :3] @ np.concatenate([np.eye(3), -se3.skew(p)], axis=1)
        maps[v.patch.view] = inverse @ (v.inner + v.outline) @ moved, inverse @ (v.J * v.w[:, None]).T @ v.patch.columns[v.at]
        pixel = (EDGE_PX * v.patch.pixel * p[2]) ** 2
        edges += inverse @ v.outline @ v.outline @ inverse * pixel
    return Settled(motion, inverse * _inflation(views), edges, errors.cov(maps))


def _inflation(views: Sequence[_View]) -> float:
    """Variance of the residuals of the part's pixels, correlation included, relative to white noise of the assumed sigma."""
    total, count = float(ASSUMED_PIXELS), float(ASSUMED_PIXELS)
    for v in views:
        u = v.e / v.patch.scale[v.at]
        usual = np.flatnonzero(np.abs(u) < USUAL)
        cell = np.unique(v.patch.cell[v.at][usual], return_inverse=True)[1]
        total += float((np.bincount(cell, u[usual]) ** 2).sum())
        count += len(usual)
    return total / count


def positive(H: Float) -> Float:
    """A symmetric matrix without its negative eigenvalues."""
    values, axes = np.linalg.eigh(H)
    return np.asarray((axes * np.maximum(values, 0.0)) @ axes.T)


def curvature(motion: Float, cost: Callable[[Float], float], h: float = 1.5e-3) -> Float:
    """(3, 3) second derivatives of the cost for translations, made positive definite."""
    middle = cost(motion)
    one = np.array([[cost(at(s * h * d) @ motion) for s in (1, -1)] for d in np.eye(3)])
    if not np.isfinite(one).all():
        return np.zeros((3, 3))
    H = np.diag((one.sum(axis=1) - 2 * middle) / h**2)
    for i, j in ((0, 1), (0, 2), (1, 2)):
        both = [cost(at(s * h * (np.eye(3)[i] + np.eye(3)[j])) @ motion) for s in (1, -1)]
        if not np.isfinite(both).all():
            return np.zeros((3, 3))
        H[i, j] = H[j, i] = 0.5 * (sum(both) - one[i].sum() - one[j].sum() + 2 * middle) / h**2
    return positive(H)
