# SPDX-License-Identifier: Apache-2.0
"""Light that reaches a surface by way of another: one bounce between patches of the CAD.

The camera lights a patch i of solid angle dOmega; it sends rho / pi dOmega cos(i) cos(x) / d^2 to
the point x, to be compared with the direct cos(theta) / r^2. The path is longer by
(r_i + d - r_x) / 2. Patches are discs for near points (d^2 + area / pi), so that corners stay
finite.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tof_core.arrays import Float, Ints, Mask
    from tof_core.camera import Camera
    from tof_scene.raycast import Raycaster
    from tof_scene.render import Rendering
    from tof_sensor.frame import Frame

    ComplexImage = NDArray[np.complex128]

WIDER = 1.3
"""The lit field against the image's: light from just outside comes back too."""
PATCHES = (28, 20)
RECEIVERS = (32, 24)
"""Rasters (columns, rows) of lit patches, and of the points whose visibility is traced."""


@dataclass(frozen=True, slots=True, eq=False)
class Patches:
    """Lit patches in the camera frame: point (n, 3), normal (n, 3), albedo, solid angle, range."""

    point: Float
    normal: Float
    albedo: Float
    solid_angle: Float
    range_m: Float


def lit_patches(camera: Camera, T_cell_camera: Float, caster: Raycaster) -> Patches:
    """What the camera's own light falls on, in equal steps over a field wider than the image."""
    x_max, y_max = WIDER * 0.5 * camera.width / camera.fx, WIDER * 0.5 * camera.height / camera.fy
    nx, ny = PATCHES
    dx, dy = 2 * x_max / nx, 2 * y_max / ny
    x, y = np.meshgrid((np.arange(nx) + 0.5) * dx - x_max, (np.arange(ny) + 0.5) * dy - y_max)
    rays = np.stack([x.ravel(), y.ravel(), np.ones(x.size)], axis=-1)
    length = np.linalg.norm(rays, axis=-1)
    R, t = T_cell_camera[:3, :3], T_cell_camera[:3, 3]
    hits = caster.cast(np.broadcast_to(t, rays.shape), rays @ R.T)
    met = np.isfinite(hits.t)
    rays, length, part = rays[met], length[met], hits.part[met]
    albedo = np.array([p.material.albedo for p in caster.scene.parts])
    return Patches(
        point=rays * hits.t[met, None],
        normal=hits.normal[met] @ R,
        albedo=albedo[part],
        solid_angle=dx * dy / length**3,
        range_m=hits.t[met] * length,
    )


@dataclass(frozen=True, slots=True, eq=False)
class Bounce:
    """All of a view's interreflection that no frequency changes: patches, and which receivers see them."""

    patches: Patches
    rows: Ints
    columns: Ints
    seen: Mask


@lru_cache(maxsize=24)
def bounce_of(rendering: Rendering, caster: Raycaster) -> Bounce:
    """Trace a view once; kept for the renderings in use."""
    patches = lit_patches(rendering.camera, rendering.T_cell_camera, caster)
    rows, columns = _receiver_raster(rendering)
    return Bounce(patches, rows, columns, _visibility(rendering, patches, rows, columns, caster))


def indirect_phasor(frame: Frame, waves_per_m: float, pixels: Ints | None = None) -> ComplexImage:
    """Complex sum of indirect over direct light, phase `waves_per_m` times excess path.

    (H, W), or (n,) on chosen pixels (flat indices). Needs `frame.context.caster`; zero where nothing is seen.
    """
    caster = frame.context.caster
    if caster is None:
        return np.zeros(frame.depth.shape if pixels is None else pixels.shape, complex)
    bounce = bounce_of(frame.rendering, caster)
    patches = bounce.patches
    at = np.flatnonzero(frame.valid) if pixels is None else np.asarray(pixels, np.int64)
    sums: ComplexImage = _gather(
        np.ascontiguousarray(np.nan_to_num(frame.points)), np.ascontiguousarray(np.nan_to_num(frame.rendering.normal.astype(np.float64))),
        frame.valid, at, bounce.rows, bounce.columns, bounce.seen, patches.point, patches.normal,
        patches.albedo * patches.solid_angle / np.pi, patches.range_m, _disc_area(patches), waves_per_m,
    )  # fmt: skip
    if pixels is not None:
        return sums
    out = np.zeros(frame.depth.size, complex)
    out[at] = sums
    return out.reshape(frame.depth.shape)


def _disc_area(patches: Patches) -> Float:
    """(n,) m^2 over pi of the surface that each patch covers."""
    cosine = -np.einsum("ni,ni->n", patches.point, patches.normal) / patches.range_m
    return np.asarray(patches.solid_angle * patches.range_m**2 / np.maximum(cosine, 0.05) / np.pi)


def _receiver_raster(rendering: Rendering) -> tuple[Ints, Ints]:
    h, w = rendering.depth.shape
    return np.linspace(0, h - 1, RECEIVERS[1]).astype(np.int64), np.linspace(0, w - 1, RECEIVERS[0]).astype(np.int64)


def _visibility(rendering: Rendering, patches: Patches, rows: Ints, columns: Ints, caster: Raycaster) -> Mask:
    """(receivers, patches) whether nothing stands between; traced only where both face each other."""
    grid = np.ix_(rows, columns)
    depth = rendering.depth.astype(np.float64)[grid]
    points = np.nan_to_num(rendering.camera.rays()[grid] * depth[..., None]).reshape(-1, 3)
    normals = np.nan_to_num(rendering.normal[grid].astype(np.float64)).reshape(-1, 3)
    way = patches.point[None] - points[:, None]
    far = np.linalg.norm(way, axis=-1)
    facing = (np.einsum("rpi,ri->rp", way, normals) > 0) & (np.einsum("rpi,pi->rp", -way, patches.normal) > 0)
    facing &= (far > 1e-3) & np.isfinite(depth).reshape(-1, 1)
    receiver, patch = np.nonzero(facing)
    T = rendering.T_cell_camera
    start = points[receiver] + 2e-4 * normals[receiver]
    direction = patches.point[patch] - start
    hits = caster.cast(start @ T[:3, :3].T + T[:3, 3], direction @ T[:3, :3].T)
    seen = np.zeros(facing.shape, np.bool_)
    seen[receiver, patch] = ~(hits.t < 0.99)
    return seen


@njit(cache=True, fastmath=True, nogil=True)
def _gather(
    points: Float,
    normals: Float,
    valid: Mask,
    at: Ints,
    rows: Ints,
    columns: Ints,
    seen: Mask,
    patch: Float,
    patch_normal: Float,
    weight: Float,
    patch_range: Float,
    area: Float,
    waves: float,
) -> ComplexImage:
    """(n,) sum of what every patch sends to each pixel, seen as its nearest traced receiver sees it."""
    w = valid.shape[1]
    out = np.zeros(len(at), np.complex128)
    for i_at in range(len(at)):
        v, u = at[i_at] // w, at[i_at] % w
        at_row = min(int(np.searchsorted(rows, v)), len(rows) - 1)
        if not valid[v, u]:
            continue
        x, y, z = points[v, u]
        nx, ny, nz = normals[v, u]
        r = np.sqrt(x * x + y * y + z * z)
        direct = -(x * nx + y * ny + z * nz) / (r * r * r)
        if direct <= 1e-6:
            continue
        at_column = min(int(np.searchsorted(columns, u)), len(columns) - 1)
        best, receiver = np.inf, 0
        for i in range(max(at_row - 1, 0), at_row + 1):
            for j in range(max(at_column - 1, 0), at_column + 1):
                q, m = points[rows[i], columns[j]], normals[rows[i], columns[j]]
                gap = abs((q[0] - x) * nx + (q[1] - y) * ny + (q[2] - z) * nz)
                gap += 0.1 * (1 - m[0] * nx - m[1] * ny - m[2] * nz)
                if valid[rows[i], columns[j]] and gap < best:
                    best, receiver = gap, i * len(columns) + j
        real, imag = 0.0, 0.0
        for p in range(patch.shape[0]):
            if not seen[receiver, p]:
                continue
            dx, dy, dz = patch[p, 0] - x, patch[p, 1] - y, patch[p, 2] - z
            here = dx * nx + dy * ny + dz * nz
            there = -(dx * patch_normal[p, 0] + dy * patch_normal[p, 1] + dz * patch_normal[p, 2])
            if here <= 0 or there <= 0:
                continue
            d2 = dx * dx + dy * dy + dz * dz
            d = np.sqrt(d2)
            ratio = weight[p] * here * there / (d2 * (d2 + area[p])) / direct
            phase = waves * (patch_range[p] + d - r)
            real += ratio * np.cos(phase)
            imag += ratio * np.sin(phase)
        out[i_at] = real + 1j * imag
    return out
