# SPDX-License-Identifier: Apache-2.0
"""Quantities of a view by which errors are grouped: distance to the next edge in pixels, and concavity around each point."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_core import se3

if TYPE_CHECKING:
    from tof_core.arrays import Float, Image, Mask
    from tof_scene.raycast import Raycaster
    from tof_scene.rendering import Rendering

REACH_M = 0.3
"""Longest path of interreflection, metres; over longer paths it is weaker than other errors."""
CLEARANCE_M = 2e-4
"""Height above a surface at which rays start, metres."""
GOLDEN = np.pi * (3 - np.sqrt(5))


def edge_mask(rendering: Rendering) -> Mask:
    """(H, W) pixels with two surfaces, and neighbours on different parts."""
    edge = np.nan_to_num(rendering.mixed) > 0
    down = rendering.part[1:] != rendering.part[:-1]
    right = rendering.part[:, 1:] != rendering.part[:, :-1]
    edge[1:] |= down
    edge[:-1] |= down
    edge[:, 1:] |= right
    edge[:, :-1] |= right
    return edge


def edge_distance(rendering: Rendering) -> Image:
    """(H, W) float32 pixels to the nearest pixel of `edge_mask`, infinite in a view without edges."""
    import cv2

    edge = edge_mask(rendering)
    if not edge.any():
        return np.full(edge.shape, np.inf, np.float32)
    return np.asarray(cv2.distanceTransform((~edge).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE), np.float32)


def concavity(caster: Raycaster, points: Float, normals: Float, rays: int = 32, reach_m: float = REACH_M) -> Float:
    """(n,) ambient occlusion 0..1: share of the half-space over each point that the scene blocks within `reach_m`, weighted by the cosine.

    `points`, `normals` (n, 3) in the cell frame, unit normals away from the surface. A plane has 0, the bottom of a deep hole 1,
    a corner of two walls at right angles 1/2.
    """
    directions = half_space(normals, rays)
    starts = np.repeat(points + CLEARANCE_M * normals, rays, axis=0)
    return np.asarray(caster.blocked(starts, directions.reshape(-1, 3), reach_m).reshape(len(points), rays).mean(axis=1))


def concavity_map(caster: Raycaster, rendering: Rendering, stride: int = 4, rays: int = 32, reach_m: float = REACH_M) -> Image:
    """(H, W) float32 `concavity` at each pixel's surface, NaN where there is none.

    Rays are cast at every `stride`-th pixel; other pixels get the value of the nearest one on the same part.
    """
    half = stride // 2
    coarse = np.full(rendering.depth.shape, np.nan, np.float32)[half::stride, half::stride]
    where = np.isfinite(rendering.depth[half::stride, half::stride])
    points = rendering.camera.points(rendering.depth)[half::stride, half::stride][where]
    normals = rendering.normal[half::stride, half::stride][where].astype(float)
    T = rendering.T_cell_camera
    coarse[where] = concavity(caster, se3.apply(T, points), normals @ T[:3, :3].T, rays, reach_m)
    return _spread(coarse, rendering, stride)


def _spread(coarse: Image, rendering: Rendering, stride: int) -> Image:
    """Nearest coarse value of the same part within one step, otherwise the nearest coarse value."""
    rows, columns = (np.minimum(np.arange(n) // stride, m - 1) for n, m in zip(rendering.part.shape, coarse.shape, strict=True))
    coarse_part = rendering.part[stride // 2 :: stride, stride // 2 :: stride]
    out = np.full(rendering.part.shape, np.nan, np.float32)
    for down, right in sorted(((a, b) for a in (-1, 0, 1) for b in (-1, 0, 1)), key=lambda s: s[0] ** 2 + s[1] ** 2):
        r, c = np.clip(rows + down, 0, coarse.shape[0] - 1)[:, None], np.clip(columns + right, 0, coarse.shape[1] - 1)[None]
        fits = np.isnan(out) & (coarse_part[r, c] == rendering.part)
        out[fits] = coarse[r, c][fits]
    left = np.isnan(out) & (rendering.part >= 0)
    out[left] = np.nan_to_num(coarse[rows[:, None], columns[None]][left])
    return out


def half_space(normals: Float, rays: int) -> Float:
    """(n, rays, 3) directions over the half-space of each unit normal (n, 3), with cosine density."""
    return np.asarray(np.einsum("nij,kj->nki", _bases(normals), _hemisphere(rays)))


def _hemisphere(n: int) -> Float:
    """(n, 3) directions over the hemisphere around z, with cosine density, evenly spread (sunflower)."""
    radius, angle = np.sqrt((np.arange(n) + 0.5) / n), GOLDEN * np.arange(n)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), np.sqrt(1 - radius**2)], 1)


def _bases(normals: Float) -> Float:
    """(n, 3, 3) rotations that turn z to each normal (Duff et al., Building an orthonormal basis, revisited, 2017)."""
    x, y, z = normals.T
    sign = np.where(z < 0, -1.0, 1.0)
    a = -1.0 / (sign + z)
    b = x * y * a
    first = np.stack([1 + sign * x * x * a, sign * b, -sign * x], 1)
    return np.stack([first, np.stack([b, sign + y * y * a, -y], 1), normals], 2)
