# SPDX-License-Identifier: Apache-2.0
"""Light that reaches a surface by way of another: one bounce between patches of the CAD.

The camera lights a patch i of solid angle dOmega; it sends rho / pi dOmega cos(i) cos(x) / d^2 to
the point x, to be compared with the direct cos(theta) / r^2. The path is longer by
(r_i + d - r_x) / 2. Patches are discs for near points (d^2 + area / pi), so that corners stay
finite.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

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

    @property
    def table(self) -> Float:
        """(9, n): point, normal, light given back, range, and m^2 over pi of the surface that each covers."""
        cosine = -np.einsum("ni,ni->n", self.point, self.normal) / self.range_m
        area = self.solid_angle * self.range_m**2 / np.maximum(cosine, 0.05) / np.pi
        return np.stack([*self.point.T, *self.normal.T, self.albedo * self.solid_angle / np.pi, self.range_m, area])


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

    caster: Raycaster
    patches: Patches
    rows: Ints
    columns: Ints
    seen: Mask


_traced: WeakKeyDictionary[Rendering, Bounce] = WeakKeyDictionary()


def bounce_of(rendering: Rendering, caster: Raycaster) -> Bounce:
    """Trace a view once; kept as long as its rendering is."""
    bounce = _traced.get(rendering)
    if bounce is None or bounce.caster is not caster:
        patches = lit_patches(rendering.camera, rendering.T_cell_camera, caster)
        rows, columns = _receiver_raster(rendering)
        bounce = Bounce(caster, patches, rows, columns, _visibility(rendering, patches, rows, columns, caster))
        _traced[rendering] = bounce
    return bounce


def indirect_phasor(frame: Frame, waves_per_m: float, pixels: Ints | None = None) -> ComplexImage:
    """Complex sum of indirect over direct light, phase `waves_per_m` times excess path.

    (H, W), or (n,) on chosen pixels (flat indices). Needs `frame.context.caster`; zero where nothing is seen.
    """
    caster = frame.context.caster
    if caster is None:
        return np.zeros(frame.depth.shape if pixels is None else pixels.shape, complex)
    bounce = bounce_of(frame.rendering, caster)
    at = np.flatnonzero(frame.valid) if pixels is None else np.asarray(pixels, np.int64)
    sums: ComplexImage = _gather(
        np.ascontiguousarray(np.nan_to_num(frame.points)), np.ascontiguousarray(np.nan_to_num(frame.rendering.normal.astype(np.float64))),
        frame.valid, at, bounce.rows, bounce.columns, bounce.seen, bounce.patches.table, waves_per_m,
    )  # fmt: skip
    if pixels is not None:
        return sums
    out = np.zeros(frame.depth.size, complex)
    out[at] = sums
    return out.reshape(frame.depth.shape)


def _receiver_raster(rendering: Rendering) -> tuple[Ints, Ints]:
    h, w = rendering.depth.shape
    return np.linspace(0, h - 1, RECEIVERS[1]).astype(np.int64), np.linspace(0, w - 1, RECEIVERS[0]).astype(np.int64)


def _visibility(rendering: Rendering, patches: Patches, rows: Ints, columns: Ints, caster: Raycaster) -> Mask:
    """(receivers, patches) whether nothing stands between; traced only where both face each other."""
    grid = np.ix_(rows, columns)
    depth = rendering.depth.astype(np.float64)[grid]
    points = np.nan_to_num(rendering.camera.rays()[grid] * depth[..., None]).reshape(-1, 3)
    normals = np.nan_to_num(rendering.normal[grid].astype(np.float64)).reshape(-1, 3)
    facing = _facing(points, normals, patches.point, patches.normal)
    receiver, patch = np.nonzero(facing & np.isfinite(depth).reshape(-1, 1))
    T = rendering.T_cell_camera
    start = points[receiver] + 2e-4 * normals[receiver]
    direction = patches.point[patch] - start
    seen = np.zeros(facing.shape, np.bool_)
    seen[receiver, patch] = ~caster.blocked(start @ T[:3, :3].T + T[:3, 3], direction @ T[:3, :3].T, 0.99)
    return seen


@njit(cache=True, nogil=True)
def _facing(points: Float, normals: Float, patch: Float, patch_normal: Float) -> Mask:
    """(receivers, patches) whether both turn their faces to each other, at least a millimetre apart."""
    out = np.empty((len(points), len(patch)), np.bool_)
    for i in range(len(points)):
        x, y, z = points[i]
        nx, ny, nz = normals[i]
        for p in range(len(patch)):
            dx, dy, dz = patch[p, 0] - x, patch[p, 1] - y, patch[p, 2] - z
            here = dx * nx + dy * ny + dz * nz
            there = -(dx * patch_normal[p, 0] + dy * patch_normal[p, 1] + dz * patch_normal[p, 2])
            out[i, p] = here > 0 and there > 0 and dx * dx + dy * dy + dz * dz > 1e-6
    return out


# Division by zero as NumPy has it: a check for it would keep the innermost loop from running on many patches at a time.
@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def _gather(
    points: Float,
    normals: Float,
    valid: Mask,
    at: Ints,
    rows: Ints,
    columns: Ints,
    seen: Mask,
    patches: Float,
    waves: float,
) -> ComplexImage:
    """(n,) sum of what every patch sends to each pixel, seen as its nearest traced receiver sees it."""
    w = valid.shape[1]
    out = np.zeros(len(at), np.complex128)
    receiver = np.empty(len(at), np.int64)
    for i in range(len(at)):
        receiver[i] = _receiver(points, normals, valid, rows, columns, at[i] // w, at[i] % w)
    lit, count, of = np.empty_like(patches), 0, np.int64(-1)
    for i in np.argsort(receiver):
        v, u = at[i] // w, at[i] % w
        if not valid[v, u]:
            continue
        x, y, z = points[v, u]
        nx, ny, nz = normals[v, u]
        r = np.sqrt(x * x + y * y + z * z)
        direct = -(x * nx + y * ny + z * nz) / (r * r * r)
        if direct <= 1e-6:
            continue
        if receiver[i] != of:
            of, count = receiver[i], 0
            for patch in np.flatnonzero(seen[of]):
                lit[:, count] = patches[:, patch]
                count += 1
        real, imag = 0.0, 0.0
        for p in range(count):
            dx, dy, dz = lit[0, p] - x, lit[1, p] - y, lit[2, p] - z
            here = max(dx * nx + dy * ny + dz * nz, 0.0)
            there = max(-(dx * lit[3, p] + dy * lit[4, p] + dz * lit[5, p]), 0.0)
            d2 = dx * dx + dy * dy + dz * dz
            ratio = lit[6, p] * here * there / (d2 * (d2 + lit[8, p]))
            cosine, sine = _turned(waves * (lit[7, p] + np.sqrt(d2) - r))
            real += ratio * cosine
            imag += ratio * sine
        out[i] = (real + 1j * imag) / direct
    return out


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy", inline="always")
def _receiver(points: Float, normals: Float, valid: Mask, rows: Ints, columns: Ints, v: int, u: int) -> int:
    """Of the four traced receivers around a pixel, the one most nearly on its surface."""
    at_row = min(int(np.searchsorted(rows, v)), len(rows) - 1)
    at_column = min(int(np.searchsorted(columns, u)), len(columns) - 1)
    x, y, z = points[v, u]
    nx, ny, nz = normals[v, u]
    best, receiver = np.inf, 0
    for i in range(max(at_row - 1, 0), at_row + 1):
        for j in range(max(at_column - 1, 0), at_column + 1):
            q, m = points[rows[i], columns[j]], normals[rows[i], columns[j]]
            gap = abs((q[0] - x) * nx + (q[1] - y) * ny + (q[2] - z) * nz)
            gap += 0.1 * (1 - m[0] * nx - m[1] * ny - m[2] * nz)
            if valid[rows[i], columns[j]] and gap < best:
                best, receiver = gap, i * len(columns) + j
    return receiver


@njit(cache=True, fastmath=True, nogil=True, error_model="numpy", inline="always")
def _turned(phase: float) -> tuple[float, float]:
    """Cosine and sine to 1e-12, of many phases at a time: series of a quarter of the angle, which is then doubled twice."""
    quarter = 0.25 * (phase - 2 * np.pi * np.rint(phase / (2 * np.pi)))
    q = quarter * quarter
    s = quarter * (1 - q / 6 * (1 - q / 20 * (1 - q / 42 * (1 - q / 72 * (1 - q / 110)))))
    c = 1 - q / 2 * (1 - q / 12 * (1 - q / 30 * (1 - q / 56 * (1 - q / 90 * (1 - q / 132)))))
    s, c = 2 * s * c, 1 - 2 * s * s
    return 1 - 2 * s * s, 2 * s * c
