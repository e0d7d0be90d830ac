# SPDX-License-Identifier: Apache-2.0
"""Patches of the CAD that the camera's lamp lights, and the light that they exchange.

The lamp lights a patch of solid angle dOmega. The patch sends back albedo / pi of the light, by Lambert's law, to the pixels' surfaces and
to other patches, which reflect it again (radiosity; Goral et al. 1984). Every path keeps its length, so that light has a phase. For near
points patches are discs (d^2 + area / pi), so that corners stay finite.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tof_core.arrays import Float, Ints, Mask
    from tof_core.camera import Camera
    from tof_scene.raycast import Raycaster

    Complex = NDArray[np.complex128]
    Indices = NDArray[np.int32]

WIDER = 1.3
"""Size of the lit field relative to the image: light from just outside returns, too."""
PATCHES = (34, 25)
"""Raster (columns, rows) of lit patches."""
BOUNCES = 4
"""Most patches on a path of light: at albedo 0.7 in a corner, longer paths add less than 1 %."""
GRAZING = 0.05
"""Least cosine of a patch's incidence, which limits its area."""
CLEARANCE_M = 2e-4
"""Distance from a surface at which rays between patches start, metres."""
REACH = 0.99
"""Share of the way to a surface that must be free; at its end is the surface."""


@dataclass(frozen=True, slots=True, eq=False)
class Patches:
    """Lit patches in the camera frame: point (n, 3), normal (n, 3), part (n,) of the scene, solid angle, range, area in m^2."""

    point: Float
    normal: Float
    part: Ints
    solid_angle: Float
    range_m: Float
    area: Float


@dataclass(frozen=True, slots=True, eq=False)
class Exchange:
    """Pairs (k,) of patches that see each other over a path of `length` metres: `other` gets `forth` times the radiosity of `one`, which gets `back` times that of `other`."""

    one: Indices
    other: Indices
    forth: Float
    back: Float
    length: Float


def lit_patches(camera: Camera, T_cell_camera: Float, caster: Raycaster) -> Patches:
    """The lit patches, in equal steps over a field wider than the image."""
    x_max, y_max = WIDER * 0.5 * camera.width / camera.fx, WIDER * 0.5 * camera.height / camera.fy
    nx, ny = PATCHES
    dx, dy = 2 * x_max / nx, 2 * y_max / ny
    x, y = np.meshgrid((np.arange(nx) + 0.5) * dx - x_max, (np.arange(ny) + 0.5) * dy - y_max)
    rays = np.stack([x.ravel(), y.ravel(), np.ones(x.size)], axis=-1)
    length = np.linalg.norm(rays, axis=-1)
    R, t = T_cell_camera[:3, :3], T_cell_camera[:3, 3]
    hits = caster.cast(np.broadcast_to(t, rays.shape), rays @ R.T)
    met = np.isfinite(hits.t)
    rays, length = rays[met], length[met]
    normal, range_m, solid_angle = hits.normal[met] @ R, hits.t[met] * length, dx * dy / length**3
    cosine = -np.einsum("ni,ni->n", rays, normal) / length
    return Patches(
        point=rays * hits.t[met, None],
        normal=normal,
        part=hits.part[met].astype(np.int64),
        solid_angle=solid_angle,
        range_m=range_m,
        area=solid_angle * range_m**2 / np.maximum(cosine, GRAZING),
    )


def exchange_of(patches: Patches, T_cell_camera: Float, caster: Raycaster) -> Exchange:
    """The pairs of patches that see each other; no patch receives more than the whole radiosity."""
    one, other = facing_pairs(patches.point, patches.normal, patches.point, patches.normal, each_once=True)
    free = unobstructed(patches.point, patches.normal, patches.point, one, other, T_cell_camera, caster)
    one, other = one[free], other[free]
    return Exchange(one, other, *_exchanged(patches.point, patches.normal, patches.area, one, other))


@njit(cache=True, nogil=True)
def _exchanged(point: Float, normal: Float, area: Float, one: Indices, other: Indices) -> tuple[Float, Float, Float]:
    """The share of light from `one` that `other` gets, the reverse, and the length of the path, each (k,)."""
    whole = np.zeros(len(area))
    forth, back, length = np.empty(len(one)), np.empty(len(one)), np.empty(len(one))
    for i in range(len(one)):
        a, b = one[i], other[i]
        x, y, z = point[b, 0] - point[a, 0], point[b, 1] - point[a, 1], point[b, 2] - point[a, 2]
        d2 = x * x + y * y + z * z
        leaving = x * normal[a, 0] + y * normal[a, 1] + z * normal[a, 2]
        arriving = -(x * normal[b, 0] + y * normal[b, 1] + z * normal[b, 2])
        length[i] = np.sqrt(d2)
        forth[i] = leaving * arriving / d2 * area[a] / (np.pi * d2 + area[a])
        back[i] = leaving * arriving / d2 * area[b] / (np.pi * d2 + area[b])
        whole[b] += forth[i]
        whole[a] += back[i]
    for i in range(len(one)):
        forth[i] /= max(whole[other[i]], 1.0)
        back[i] /= max(whole[one[i]], 1.0)
    return forth, back, length


def emitted(patches: Patches, exchange: Exchange, albedo: Float, waves_per_m: float) -> Complex:
    """(n,) light that each patch sends back per steradian head-on, relative to the lamp's intensity, with the phase of the path from the lamp.

    Args:
        patches: the lit patches.
        exchange: their exchange of light.
        albedo: (P,) of the parts.
        waves_per_m: radians per metre of path.
    """
    own = albedo[patches.part]
    fresh = own * patches.solid_angle / patches.area * np.exp(1j * waves_per_m * patches.range_m)
    total = _bounced(exchange.one, exchange.other, exchange.forth, exchange.back, exchange.length, own, fresh, waves_per_m)
    return np.asarray(total * patches.area / np.pi)


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def _bounced(one: Indices, other: Indices, forth: Float, back: Float, length: Float, own: Float, fresh: Complex, waves: float) -> Complex:
    """(n,) light of each patch after all bounces, from that which the lamp lights, `fresh` (n,)."""
    real, imag = np.empty(len(length)), np.empty(len(length))
    for i in range(len(length)):
        real[i], imag[i] = turned(waves * length[i])
    total = fresh.copy()
    for _ in range(BOUNCES - 1):
        got = np.zeros(len(own), np.complex128)
        for i in range(len(length)):
            a, b, way = one[i], other[i], complex(real[i], imag[i])
            got[b] += forth[i] * way * fresh[a]
            got[a] += back[i] * way * fresh[b]
        fresh = own * got
        total += fresh
    return total


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy", inline="always")
def turned(phase: float) -> tuple[float, float]:
    """Cosine and sine to 1e-12, vectorisable: series for a quarter of the angle, doubled twice."""
    quarter = 0.25 * (phase - 2 * np.pi * np.rint(phase / (2 * np.pi)))
    q = quarter * quarter
    s = quarter * (1 - q / 6 * (1 - q / 20 * (1 - q / 42 * (1 - q / 72 * (1 - q / 110)))))
    c = 1 - q / 2 * (1 - q / 12 * (1 - q / 30 * (1 - q / 56 * (1 - q / 90 * (1 - q / 132)))))
    s, c = 2 * s * c, 1 - 2 * s * s
    return 1 - 2 * s * s, 2 * s * c


def unobstructed(
    points: Float, normals: Float, targets: Float, one: Indices, other: Indices, T_cell_camera: Float, caster: Raycaster
) -> Mask:
    """(k,) whether the ways from surface points[one], with their normals, to targets[other] are free; (n, 3) and (m, 3) in the camera frame."""
    R, t = T_cell_camera[:3, :3], T_cell_camera[:3, 3]
    starts = (points + CLEARANCE_M * normals) @ R.T + t
    return np.asarray(~caster.blocked_between(starts, targets @ R.T + t, one, other, REACH))


@njit(cache=True, nogil=True)
def facing_pairs(points: Float, normals: Float, patch: Float, patch_normal: Float, *, each_once: bool) -> tuple[Indices, Indices]:
    """(k,), (k,) receivers and patches that face each other, at least a millimetre apart, in order.

    each_once: receivers are the patches, and of (i, p) and (p, i) only the pair with i < p is given.
    """
    one, other = np.empty(len(points) * len(patch) + 1, np.int32), np.empty(len(points) * len(patch) + 1, np.int32)
    n = 0
    for i in range(len(points)):
        x, y, z = points[i]
        nx, ny, nz = normals[i]
        for p in range(i + 1 if each_once else 0, len(patch)):
            dx, dy, dz = patch[p, 0] - x, patch[p, 1] - y, patch[p, 2] - z
            here = dx * nx + dy * ny + dz * nz
            there = -(dx * patch_normal[p, 0] + dy * patch_normal[p, 1] + dz * patch_normal[p, 2])
            one[n], other[n] = i, p  # Kept if they do: a branch that no processor predicts takes longer.
            n += (here > 0) & (there > 0) & (dx * dx + dy * dy + dz * dz > 1e-6)
    return one[:n].copy(), other[:n].copy()
