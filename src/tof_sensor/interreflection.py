# SPDX-License-Identifier: Apache-2.0
"""Light that reaches a surface via other surfaces, relative to direct light, cos(theta) / r^2.

A patch i sends its light times cos(i) cos(x) / d^2 to the point x. The measured range via it is longer by (r_i + d - r_x) / 2.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

import numpy as np
from numba import njit

from tof_sensor.patches import Exchange, Patches, emitted, exchange_of, facing_pairs, lit_patches, turned, unobstructed

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tof_core.arrays import Float, Ints, Mask
    from tof_scene.raycast import Raycaster
    from tof_scene.render import Rendering
    from tof_sensor.frame import Frame

    ComplexImage = NDArray[np.complex128]

BLOCKS = 32
"""Blocks across the image; pixels of a block, on one part and with similar normals, see the same patches."""
WAYS = 2.5
"""Steps per unit of a normal's components: similar normals are within about 25 degrees."""


@dataclass(frozen=True, slots=True, eq=False)
class Bounce:
    """The part of a view's interreflection that is independent of frequency and albedo.

    patches, exchange: lit patches and their exchange of light; receiver (H*W,): group of each pixel; middle (groups,): central pixel of each
    group; traced (groups,): whether its visibility is known; seen (groups, patches): which patches are visible from it.
    """

    caster: Raycaster
    patches: Patches
    exchange: Exchange
    receiver: Ints
    middle: Ints
    traced: Mask
    seen: Mask


_traced: WeakKeyDictionary[Rendering, Bounce] = WeakKeyDictionary()


def bounce_of(rendering: Rendering, caster: Raycaster, pixels: Ints) -> Bounce:
    """The interreflection of a view, traced for the groups of `pixels` (flat indices) and kept as long as the rendering.

    Groups are traced on demand: a third of the rays belongs to small groups at the borders of parts, which fits do not use.
    """
    bounce = _traced.get(rendering)
    if bounce is None or bounce.caster is not caster:
        patches = lit_patches(rendering.camera, rendering.T_cell_camera, caster)
        middle, receiver = _receivers(rendering)
        exchange = exchange_of(patches, rendering.T_cell_camera, caster)
        seen = np.zeros((len(middle), len(patches.area)), np.bool_)
        bounce = Bounce(caster, patches, exchange, receiver, middle, np.zeros(len(middle), np.bool_), seen)
        _traced[rendering] = bounce
    asked = np.zeros(len(bounce.middle), np.bool_)
    asked[bounce.receiver[pixels]] = True
    new = np.flatnonzero(asked & ~bounce.traced)
    if len(new):
        bounce.seen[new] = _visibility(rendering, bounce.patches, bounce.middle[new], caster)
        bounce.traced[new] = True
    return bounce


def indirect_phasor(frame: Frame, waves_per_m: float, pixels: Ints | None = None) -> ComplexImage:
    """Complex sum of indirect over direct light, phase `waves_per_m` times excess path.

    (H, W), or (n,) at chosen pixels (flat indices). Needs `frame.context.caster`; zero without a surface. The albedo of parts is
    `frame.context.albedo`, otherwise the scene's.
    """
    caster = frame.context.caster
    if caster is None:
        return np.zeros(frame.depth.shape if pixels is None else pixels.shape, complex)
    at = np.flatnonzero(frame.valid) if pixels is None else np.asarray(pixels, np.int64)
    bounce = bounce_of(frame.rendering, caster, at)
    albedo = caster.albedo if frame.context.albedo is None else frame.context.albedo
    lit, light = bounce.patches, emitted(bounce.patches, bounce.exchange, np.asarray(albedo, float), waves_per_m)
    table = np.stack([*lit.point.T, *lit.normal.T, light.real, light.imag, lit.area / np.pi])
    sums: ComplexImage = _gather(
        np.ascontiguousarray(np.nan_to_num(frame.points)), np.ascontiguousarray(np.nan_to_num(frame.rendering.normal.astype(np.float64))),
        frame.valid.ravel(), at, bounce.receiver, bounce.seen, table, waves_per_m,
    )  # fmt: skip
    if pixels is not None:
        return sums
    out = np.zeros(frame.depth.size, complex)
    out[at] = sums
    return out.reshape(frame.depth.shape)


def _receivers(rendering: Rendering) -> tuple[Ints, Ints]:
    """(groups,) central pixel of each group of pixels with the same visible patches, (H*W,) group of each pixel."""
    h, w = rendering.depth.shape
    size = max(w // BLOCKS, 1)
    row, column = np.divmod(np.arange(h * w), w)
    faces = np.rint(WAYS * np.nan_to_num(rendering.normal.reshape(-1, 3).astype(np.float64))).astype(np.int64) + 3
    key = np.ravel_multi_index(
        (row // size, column // size, *faces.T, rendering.part.ravel().astype(np.int64) + 1),
        (h // size + 1, w // size + 1, 7, 7, 7, int(rendering.part.max()) + 2),
    )
    _, receiver, count = np.unique(key, return_inverse=True, return_counts=True)
    order = np.argsort(receiver, kind="stable")
    return order[np.cumsum(count) - (count + 1) // 2], receiver.astype(np.int32)  # Kept for every view: half the memory.


def _visibility(rendering: Rendering, patches: Patches, at: Ints, caster: Raycaster) -> Mask:
    """(n, patches) whether the way between pixels `at` and patches is free; traced only where both face each other."""
    T, rays = rendering.T_cell_camera, rendering.camera.rays().reshape(-1, 3)[at]
    # Cast again: a depth averaged over a pixel's footprint lies below a curved surface, which would block its rays.
    hits = caster.cast(np.broadcast_to(T[:3, 3], rays.shape), rays @ T[:3, :3].T)
    points, normals = np.nan_to_num(rays * hits.t[:, None], posinf=0.0), np.nan_to_num(hits.normal @ T[:3, :3])
    receiver, patch = facing_pairs(points, normals, patches.point, patches.normal, each_once=False)
    seen = np.zeros((len(at), len(patches.point)), np.bool_)
    seen[receiver, patch] = unobstructed(points, normals, patches.point, receiver, patch, T, caster)
    return seen


# Division by zero as in NumPy: a check would prevent vectorisation of the innermost loop.
@njit(cache=True, fastmath=True, nogil=True, error_model="numpy")
def _gather(
    points: Float,
    normals: Float,
    valid: Mask,
    at: Ints,
    receivers: Ints,
    seen: Mask,
    patches: Float,
    waves: float,
) -> ComplexImage:
    """(n,) sum of the light of all patches at each pixel, with the visibility of its group's central pixel."""
    w = points.shape[1]
    out = np.zeros(len(at), np.complex128)
    receiver = receivers[at]
    lit, count, of = np.empty_like(patches), 0, np.int64(-1)
    for i in np.argsort(receiver):
        v, u = at[i] // w, at[i] % w
        if not valid[at[i]]:
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
                for k in range(lit.shape[0]):
                    lit[k, count] = patches[k, patch]
                count += 1
        real, imag = 0.0, 0.0
        for p in range(count):
            dx, dy, dz = lit[0, p] - x, lit[1, p] - y, lit[2, p] - z
            here = max(dx * nx + dy * ny + dz * nz, 0.0)
            there = max(-(dx * lit[3, p] + dy * lit[4, p] + dz * lit[5, p]), 0.0)
            d2 = dx * dx + dy * dy + dz * dz
            ratio = here * there / (d2 * (d2 + lit[8, p]))
            cosine, sine = turned(waves * (np.sqrt(d2) - r))
            real += ratio * (lit[6, p] * cosine - lit[7, p] * sine)
            imag += ratio * (lit[6, p] * sine + lit[7, p] * cosine)
        out[i] = (real + 1j * imag) / direct
    return out
