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
    """Pairs (k,) of visible patches: `receiver` gets `factor` times the radiosity of `sender`, over a path of `length` metres."""

    sender: Ints
    receiver: Ints
    factor: Float
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
    one, other = _facing_pairs(patches.point, patches.normal)
    free = unobstructed(patches.point[one], patches.normal[one], patches.point[other], T_cell_camera, caster)
    one, other = one[free], other[free]
    way = patches.point[other] - patches.point[one]
    length = np.linalg.norm(way, axis=1)
    cosines = np.einsum("ki,ki->k", way, patches.normal[one]) * -np.einsum("ki,ki->k", way, patches.normal[other]) / length**2
    sender, receiver = np.concatenate([one, other]), np.concatenate([other, one])
    cosines, length = np.tile(cosines, 2), np.tile(length, 2)
    factor = cosines * patches.area[sender] / (np.pi * length**2 + patches.area[sender])
    whole = np.bincount(receiver, factor, len(patches.area))
    return Exchange(sender, receiver, factor / np.maximum(whole, 1.0)[receiver], length)


def emitted(patches: Patches, exchange: Exchange, albedo: Float, waves_per_m: float) -> Complex:
    """(n,) light that each patch sends back per steradian head-on, relative to the lamp's intensity, with the phase of the path from the lamp.

    Args:
        patches: the lit patches.
        exchange: their exchange of light.
        albedo: (P,) of the parts.
        waves_per_m: radians per metre of path.
    """
    own = albedo[patches.part]
    turned = exchange.factor * np.exp(1j * waves_per_m * exchange.length)
    fresh = own * patches.solid_angle / patches.area * np.exp(1j * waves_per_m * patches.range_m)
    total = fresh.copy()
    for _ in range(BOUNCES - 1):
        light = turned * fresh[exchange.sender]
        real, imaginary = (np.bincount(exchange.receiver, part, len(own)) for part in (light.real, light.imag))
        fresh = own * (real + 1j * imaginary)
        total += fresh
    return np.asarray(total * patches.area / np.pi)


def unobstructed(points: Float, normals: Float, targets: Float, T_cell_camera: Float, caster: Raycaster) -> Mask:
    """(k,) whether the way from surface points, with their normals, to targets is free; all (k, 3) in the camera frame."""
    R, t = T_cell_camera[:3, :3], T_cell_camera[:3, 3]
    start = points + CLEARANCE_M * normals
    return np.asarray(~caster.blocked(start @ R.T + t, (targets - start) @ R.T, REACH))


@njit(cache=True, nogil=True)
def facing(points: Float, normals: Float, patch: Float, patch_normal: Float) -> Mask:
    """(receivers, patches) whether both face each other, at least a millimetre apart."""
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


def _facing_pairs(points: Float, normals: Float) -> tuple[Ints, Ints]:
    """(k,), (k,) pairs of patches that face each other, each once."""
    one, other = np.nonzero(np.triu(facing(points, normals, points, normals)))
    return one, other
