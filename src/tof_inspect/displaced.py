# SPDX-License-Identifier: Apache-2.0
"""Displacement of a part from its place in the CAD: a small rigid fit of that part alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tof_core import se3

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from tof_core.arrays import Float, Mask
    from tof_inspect.config import InspectConfig
    from tof_inspect.evidence import Seen
    from tof_inspect.without import Without
    from tof_scene.raycast import Raycaster
    from tof_scene.scene import Part

LOOSE_DEG = 6.0
"""Prior standard deviation of a part's rotation."""


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """A part's motion from the CAD.

    mm: displacement of its centre along the directions that the data determine; std_mm: its standard deviation; shift (3,)
    metres in the cell; ratio: log likelihood ratio of the displaced part over no part, from all pixels around it.
    """

    mm: float
    std_mm: float
    shift: Float
    ratio: float


def fit_part(part: Part, seen: Sequence[Seen], alone: Raycaster, bare: Without, config: InspectConfig) -> Fit:
    """Pose of the part from all pixels, of all views, that may see it.

    Args:
        part: its geometry in the cell.
        seen: views with their poses.
        alone: a scene of the part alone.
        bare: the scene without it.
        config: noise and largest displacement.
    """
    centre, reach = part.vertices.mean(axis=0), 1e-3 * config.search_mm
    patches = [p for s in seen if (p := _patch(s, alone.vertices, reach, bare, config)) is not None]
    thinned = [p.thinned() for p in patches]

    def cost(motion: Float, step: int = 1) -> float:
        if np.linalg.norm(motion[:3, 3]) > 1.3 * reach:
            return float("inf")
        return _cost(motion, thinned if step > 1 else patches, alone, centre) * step * step

    def linear(motion: Float) -> tuple[Float, Float, Float]:
        return _linearised(motion, patches, alone, centre)

    start = min((np.zeros(3), *_offsets(config.search_mm * 1e-3)), key=lambda t: cost(_at(t), 2))
    motion = _smoothed(_patterned(_at(start), cost), cost, linear, config)
    gone = sum(_misfit(p, p.behind) for p in patches)
    gained = gone - cost(motion)
    values, axes = np.linalg.eigh(_curvature(motion, cost) + np.eye(3) * (config.search_mm * 1e-3) ** -2.0)
    # Neighbours share their errors: n of them count as n / cell_px.
    spread = config.cell_px / np.maximum(values, 1e-3)
    known = spread < 0.25 * (config.search_mm * 1e-3) ** 2
    shift = axes[:, known] @ (axes[:, known].T @ motion[:3, 3])
    mm = 1e3 * float(np.linalg.norm(shift))
    direction = shift / np.linalg.norm(shift) if mm > 1e-9 else axes[:, -1]
    std = 1e3 * float(np.sqrt(((direction @ axes) ** 2 * spread).sum()))
    return Fit(mm, float(np.hypot(std, config.shared_mm)), shift, gained)


def _patterned(motion: Float, cost: Callable[[Float], float]) -> Float:
    """Pattern search along the cell's axes with decreasing steps, since edges have no gradient."""
    best = cost(motion)
    for size in (4e-3, 2e-3, 1e-3, 5e-4):
        for _ in range(3):
            found = [(cost(_at(d * size) @ motion), d) for d in (*np.eye(3), *-np.eye(3))]
            least, d = min(found, key=lambda f: f[0])
            if least >= best:
                break
            best, motion = least, _at(d * size) @ motion
    return motion


def _smoothed(
    motion: Float, cost: Callable[[Float], float], linear: Callable[[Float], tuple[Float, Float, Float]], config: InspectConfig
) -> Float:
    """Gauss-Newton from there, with rotation; kept if it is better."""
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


def _curvature(motion: Float, cost: Callable[[Float], float], h: float = 1.5e-3) -> Float:
    """(3, 3) second derivatives of the cost for translations, made positive definite."""
    middle = cost(motion)
    one = np.array([[cost(_at(s * h * d) @ motion) for s in (1, -1)] for d in np.eye(3)])
    if not np.isfinite(one).all():
        return np.zeros((3, 3))
    H = np.diag((one.sum(axis=1) - 2 * middle) / h**2)
    for i, j in ((0, 1), (0, 2), (1, 2)):
        both = [cost(_at(s * h * (np.eye(3)[i] + np.eye(3)[j])) @ motion) for s in (1, -1)]
        if not np.isfinite(both).all():
            return np.zeros((3, 3))
        H[i, j] = H[j, i] = 0.5 * (sum(both) - one[i].sum() - one[j].sum() + 2 * middle) / h**2
    values, axes = np.linalg.eigh(H)
    return np.asarray((axes * np.maximum(values, 0.0)) @ axes.T)


def _offsets(reach: float) -> list[Float]:
    """Places around the nominal one."""
    unit = [np.array([x, y, z], float) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if (x, y, z) != (0, 0, 0)]
    return [u / np.linalg.norm(u) * r for r in (0.4 * reach, 0.9 * reach) for u in unit]


def _at(shift: Float) -> Float:
    T = np.eye(4)
    T[:3, 3] = shift
    return T


@dataclass(frozen=True, slots=True, eq=False)
class _Patch:
    """Pixels of one view that the part may fill: rays (n, 3) in the cell from origin, depth, scale (n,) of its error; depth behind."""

    origin: Float
    rays: Float
    z: Float
    scale: Float
    behind: Float
    even: Mask

    def thinned(self) -> _Patch:
        """Every second row and column."""
        k = self.even
        return _Patch(self.origin, self.rays[k], self.z[k], self.scale[k], self.behind[k], k[k])


def _patch(seen: Seen, part: Float, margin: float, bare: Without, config: InspectConfig) -> _Patch | None:
    """Pixels of a view in the box that the part may fill; None if there are none."""
    T = seen.posed.T_cell_camera
    camera = seen.view.camera
    inside = se3.apply(se3.inverse(T), part)
    if (inside[:, 2] < 0.05).any():
        return None
    uv = camera.project(inside)
    pad = margin * camera.fx / inside[:, 2].mean() + 2
    low, high = np.nanmin(uv, axis=0) - pad, np.nanmax(uv, axis=0) + pad
    box = slice(max(int(low[1]), 0), max(int(high[1]) + 1, 0)), slice(max(int(low[0]), 0), max(int(high[0]) + 1, 0))
    depth, sigma = seen.view.depth[box].astype(float), seen.sigma[box]
    ok = np.isfinite(depth) & np.isfinite(sigma)
    if not ok.any():
        return None
    even = np.zeros(ok.shape, bool)
    even[::2, ::2] = True
    rays = camera.rays()[box][ok] @ T[:3, :3].T
    scale = np.maximum(np.hypot(sigma[ok], config.shared_mm * 1e-3), 1e-4)
    return _Patch(T[:3, 3], rays, depth[ok], scale, bare.cast(T[:3, 3], rays).t, even[ok])


def _moved_hits(motion: Float, patch: _Patch, alone: Raycaster, centre: Float) -> tuple[Float, Mask, Float]:
    """Depth (n,) with the part moved by `motion` about its middle, which rays meet it, and its normals (n, 3)."""
    back = se3.inverse(_about(motion, centre))
    hits = alone.cast(se3.apply(back, patch.origin), patch.rays @ back[:3, :3].T)
    first = np.isfinite(hits.t) & ~(patch.behind < hits.t)
    normal = hits.normal @ back[:3, :3]
    return np.where(first, hits.t, patch.behind), first, normal


def _about(motion: Float, centre: Float) -> Float:
    return np.asarray(_at(centre) @ motion @ _at(-centre))


def _cost(motion: Float, patches: Sequence[_Patch], alone: Raycaster, centre: Float) -> float:
    """Robust misfit of all pixels around the part, in units of log likelihood."""
    return sum(_misfit(p, _moved_hits(motion, p, alone, centre)[0]) for p in patches)


def _misfit(patch: _Patch, depth: Float) -> float:
    u = np.nan_to_num((patch.z - depth) / patch.scale, nan=5.0)
    return float(np.minimum(0.5 * u * u, 6.0).sum())


def _linearised(motion: Float, patches: Sequence[_Patch], alone: Raycaster, centre: Float) -> tuple[Float, Float, Float]:
    """Residual (n,), Jacobian (n, 6) for a motion about the part's middle on the left, weight (n,)."""
    parts: list[tuple[Float, Float, Float]] = []
    for p in patches:
        depth, on, normal = _moved_hits(motion, p, alone, centre)
        facing = np.einsum("ij,ij->i", normal, p.rays)
        on &= (np.abs(facing) > 0.2 * np.linalg.norm(p.rays, axis=1)) & np.isfinite(depth)
        arm = p.origin + p.rays[on] * depth[on, None] - centre
        n = normal[on] / facing[on, None]
        e = p.z[on] - depth[on]
        u = e / p.scale[on]
        w = np.where(np.abs(u) < 5.0, (1.0 - (u / 5.0) ** 2) ** 2, 0.0) / p.scale[on] ** 2
        parts.append((e, np.concatenate([n, np.cross(arm, n)], axis=1), w))
    if not parts:
        return np.zeros(0), np.zeros((0, 6)), np.zeros(0)
    e, J, w = (np.concatenate(p) for p in zip(*parts, strict=True))
    return e, J, w
