# SPDX-License-Identifier: Apache-2.0
"""Displacement of a part from its place in the CAD, by a rigid fit of that part alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tof_core import se3
from tof_inspect.patch import at, cost_of, linearised, misfit, moved_hits, patch_of
from tof_inspect.settle import settle

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from tof_core.arrays import Float
    from tof_inspect.config import InspectConfig
    from tof_inspect.evidence import Seen
    from tof_inspect.patch import Patch
    from tof_inspect.shared import SharedErrors
    from tof_inspect.without import Without
    from tof_scene.raycast import Raycaster
    from tof_scene.scene import Part

LOOSE_DEG = 6.0
"""Prior standard deviation of a part's rotation."""
UNKNOWN = 0.5
"""Standard deviation, as a share of `search_mm`, from which the place along an axis counts as unknown."""


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """A part's motion from the CAD.

    shift (3,): metres in the cell along the directions that the data determine, zero along the others; noise, outline, shared (3, 3):
    its covariance by noise, by the width of the pixels at outlines, and by errors common to pixels (poses and camera); known (3, k): unit
    axes along which the place is known; ratio: log likelihood ratio of the displaced part over no part, from all pixels around it.
    """

    shift: Float
    noise: Float
    outline: Float
    shared: Float
    known: Float
    ratio: float

    @property
    def cov(self) -> Float:
        """(3, 3) covariance of the shift by all causes, metres squared."""
        return self.noise + self.outline + self.shared

    @property
    def mm(self) -> float:
        """Distance from the place in the CAD, millimetres."""
        return 1e3 * float(np.linalg.norm(self.shift))

    @property
    def std_mm(self) -> float:
        """Standard deviation of `mm`: along the shift, or the largest along a known axis where there is no shift."""
        if not self.known.shape[1]:
            return float("nan")
        if self.mm > 1e-6:
            direction = self.shift / np.linalg.norm(self.shift)
            return 1e3 * float(np.sqrt(direction @ self.cov @ direction))
        return 1e3 * float(np.sqrt(np.linalg.eigvalsh(self.known.T @ self.cov @ self.known)[-1]))


def fit_part(part: Part, seen: Sequence[Seen], alone: Raycaster, bare: Without, config: InspectConfig, errors: SharedErrors) -> Fit:
    """Displacement of the part from all pixels of all views that may show it.

    Args:
        part: its geometry in the cell.
        seen: views with their poses.
        alone: a scene of the part alone.
        bare: the scene without it.
        config: noise and largest displacement.
        errors: estimated errors common to pixels.
    """
    centre, reach = part.vertices.mean(axis=0), 1e-3 * config.search_mm
    patches = [p for s in seen if (p := patch_of(s, alone.vertices, reach, bare, config, errors)) is not None]
    thinned = [p.thinned() for p in patches]

    def cost(motion: Float, of: Sequence[Patch] | None = None) -> float:
        if np.linalg.norm(motion[:3, 3]) > 1.3 * reach:
            return float("inf")
        return cost_of(motion, patches if of is None else of, alone, centre)

    def linear(motion: Float) -> tuple[Float, Float, Float]:
        return _all_linearised(motion, patches, alone, centre)

    start = min((np.zeros(3), *_offsets(reach)), key=lambda t: cost(at(t), thinned))
    motion = _patterned(at(start), cost)
    patches = [p.softened(moved_hits(motion, p, alone, centre)[0]) for p in patches]
    motion = _smoothed(_patterned(motion, cost, steps=(1e-3, 5e-4, 2.5e-4)), cost, linear, config)
    gone = sum(misfit(p, p.behind) for p in patches)
    s = settle(motion, patches, alone, centre, config, errors)
    known = known_axes(s.noise + s.outline + s.shared, config)
    return Fit(known @ (known.T @ s.motion[:3, 3]), s.noise, s.outline, s.shared, known, gone - cost(motion))


def known_axes(cov: Float, config: InspectConfig) -> Float:
    """(3, k) axes of a covariance along which the place is known."""
    values, axes = np.linalg.eigh(cov)
    return axes[:, values < (UNKNOWN * config.search_mm * 1e-3) ** 2]


def _patterned(motion: Float, cost: Callable[[Float], float], steps: Sequence[float] = (4e-3, 2e-3, 1e-3)) -> Float:
    """Pattern search along the cell's axes with decreasing steps, since edges have no gradient."""
    best = cost(motion)
    for size in steps:
        for _ in range(3):
            found = [(cost(at(d * size) @ motion), d) for d in (*np.eye(3), *-np.eye(3))]
            least, d = min(found, key=lambda f: f[0])
            if least >= best:
                break
            best, motion = least, at(d * size) @ motion
    return motion


def _smoothed(
    motion: Float, cost: Callable[[Float], float], linear: Callable[[Float], tuple[Float, Float, Float]], config: InspectConfig
) -> Float:
    """Gauss-Newton steps from `motion`, with rotation; the motion of least cost."""
    prior = np.repeat([config.search_mm * 1e-3, np.radians(LOOSE_DEG)], 3) ** -2.0
    best, kept = cost(motion), motion
    for _ in range(4):
        e, J, w = linear(motion)
        if len(e) < 12:
            break
        H = (J * w[:, None]).T @ J + np.diag(prior)
        step = np.linalg.solve(H, J.T @ (w * e) - prior * se3.log(motion))
        motion = se3.exp(step) @ motion
        if (now := cost(motion)) < best:
            best, kept = now, motion
        if np.linalg.norm(step) < 1e-4:
            break
    return kept


def _offsets(reach: float) -> list[Float]:
    """Shifts (3,) from which the search starts, in metres."""
    unit = [np.array([x, y, z], float) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if (x, y, z) != (0, 0, 0)]
    return [u / np.linalg.norm(u) * r for r in (0.4 * reach, 0.9 * reach) for u in unit]


def _all_linearised(motion: Float, patches: Sequence[Patch], alone: Raycaster, centre: Float) -> tuple[Float, Float, Float]:
    """Residual (n,), Jacobian (n, 6) for a left perturbation about the part's centre, weight (n,)."""
    parts = [linearised(motion, p, alone, centre)[:3] for p in patches]
    if not parts:
        return np.zeros(0), np.zeros((0, 6)), np.zeros(0)
    e, J, w = (np.concatenate(p) for p in zip(*parts, strict=True))
    return e, J, w
