# SPDX-License-Identifier: Apache-2.0
"""Light that bounces more than once, traced from where the lamp really is, for every frequency and order at once.

As `tof_virtual.indirect` does it for one wavenumber: the beam is cut into cones, each lit patch re-radiates by Lambert's law to
the other patches and to what the pixels see, where nothing stands between. Path lengths are kept; surfaces have their true albedos.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

from benchmarks.emerging.light import lamp_place
from benchmarks.emerging.waveform import ORDERS
from tof_virtual.bvh import shadow
from tof_virtual.taps import SPEED_OF_LIGHT
from tof_virtual.transfer import NEAR, far_patch, interpolate, near_patch

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from benchmarks.emerging.device import Device
    from benchmarks.emerging.surfaces import Surfaces
    from tof_core.arrays import Float
    from tof_virtual.sight import Sight

CONES = (24, 30)
"""Cones along the beam's height and width."""
WIDER = 1.3
"""The beam is so much wider than the image."""
POINTS = 40
"""Points across the image at which light is gathered; between them it is interpolated on the surface."""
GRAZING = 0.05
"""Least incidence cosine of a cone, so that no patch becomes endless."""
BOUNCES = 4
SHORT = 1.0
"""Wavenumber in rad/m with which a patch cut into squares tells its mean path: no path of a room wraps."""


@dataclass(frozen=True, slots=True, eq=False)
class Patches:
    """Lit patches (n,): points, normals (n, 3), areas, albedos, and power (F * orders, n) over the lamp's intensity, with phase."""

    points: Float
    normals: Float
    area: Float
    albedo: Float
    power: NDArray[np.complex128]


def indirect(
    device: Device,
    real: Surfaces,
    sight: Sight,
    rays: Float,
    omega: Float,
    *,
    wider: float = WIDER,
    cones: tuple[int, int] = CONES,
) -> NDArray[np.complex128]:
    """Irradiance (F, orders, P) by other surfaces over the lamp's intensity, per square metre, with the whole path's phase.

    `rays` (H, W, 3) are the camera's; `omega` (F,) rad/s; the beam is `wider` than the image, cut into `cones`.
    """
    k = (omega[:, None] / SPEED_OF_LIGHT * np.array(ORDERS)).ravel()
    lit = _patches(lamp_place(device, sight.T_cell_camera), real, sight, rays, k, wider, cones)
    out = np.zeros((k.size, sight.z.size), np.complex128)
    if lit.area.size:
        lit = _between(real, lit, k)
        _on_pixels(out, real, sight, lit, k)
    return out.reshape(omega.size, len(ORDERS), -1)


def _patches(lamp: Float, real: Surfaces, sight: Sight, rays: Float, k: Float, wider: float, cones: tuple[int, int]) -> Patches:
    """One jittered ray into each cone of the beam."""
    low, high = rays[..., :2].min(axis=(0, 1)), rays[..., :2].max(axis=(0, 1))
    middle, half = 0.5 * (low + high), 0.5 * wider * (high - low)
    rng = np.random.default_rng(len(real.world.soup.normals))
    j, i = (g + rng.uniform(-0.4, 0.4, cones) for g in np.meshgrid(*(np.arange(n) for n in cones), indexing="ij"))
    x = middle[0] + half[0] * (2 * (i.ravel() + 0.5) / cones[1] - 1)
    y = middle[1] + half[1] * (2 * (j.ravel() + 0.5) / cones[0] - 1)
    local = np.stack([x, y, np.ones_like(x)], axis=1)
    # solid angle of a cell of the plane z = 1
    angle = 4 * half[0] * half[1] / (cones[0] * cones[1]) / np.linalg.norm(local, axis=1) ** 3
    directions = local @ sight.T_cell_camera[:3, :3].T
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    distance, face = real.world.tree.cast(lamp, directions)
    hit = np.flatnonzero(face >= 0)
    directions, distance, face, angle = directions[hit], distance[hit], face[hit], angle[hit]
    normals = real.world.soup.normals[face]
    cosine = np.einsum("ij,ij->i", directions, normals)
    points = lamp + directions * distance[:, None]
    return Patches(
        points=points,
        normals=normals * -np.sign(cosine)[:, None],
        area=angle * distance**2 / np.maximum(np.abs(cosine), GRAZING),
        albedo=real.albedo_at(points, face),
        power=angle * np.exp(-1j * k[:, None] * distance),
    )


def _between(real: Surfaces, lit: Patches, k: Float) -> Patches:
    """Let the patches light each other; what the pixels gather is one bounce more."""
    tree = real.world.tree
    factor, length = _exchange(tree.boxes, tree.links, tree.triangles, lit.points, lit.normals, lit.area)
    total = lit.power.copy()
    for n, wavenumber in enumerate(k):
        transfer = factor * np.exp(-1j * wavenumber * length)
        fresh = lit.power[n]
        for _ in range(BOUNCES - 2):
            fresh = lit.area * (transfer @ (lit.albedo * fresh))
            total[n] += fresh
    return Patches(lit.points, lit.normals, lit.area, lit.albedo, total)


def _on_pixels(out: NDArray[np.complex128], real: Surfaces, sight: Sight, lit: Patches, k: Float) -> None:
    """Gather on a coarse raster, interpolate where surface and neighbours agree, gather what is left."""
    height, width = sight.shape
    main = sight.main
    stride = max(width // POINTS, 1)
    rows = np.unique(np.append(np.arange(0, height, stride), height - 1))
    columns = np.unique(np.append(np.arange(0, width, stride), width - 1))
    coarse = (rows[:, None] * width + columns).ravel()
    normals = real.world.soup.normals[main.face]
    normals = normals * -np.sign(np.einsum("ij,ij->i", normals, main.direction))[:, None]
    points = main.points
    # interpolated with the phase of the direct way taken off, so that what is interpolated is smooth
    distance = np.where(main.face >= 0, main.distance, 0.0)
    turns = np.exp(-2j * k[:, None] * distance)
    gathered = _gather(real, main.face, points, normals, coarse, lit, k, distance) / turns[:, coarse]
    left = np.zeros(0, np.int64)
    for n in range(k.size):
        left = np.flatnonzero(interpolate(out[n], np.ascontiguousarray(gathered[n]), points, normals, main.face, rows, columns, width))
    if left.size:
        out[:, left] = _gather(real, main.face, points, normals, left, lit, k, distance) / turns[:, left]
    out *= turns


def _gather(
    real: Surfaces,
    face: NDArray[np.int32],
    points: Float,
    normals: Float,
    pixels: NDArray[np.int64],
    lit: Patches,
    k: Float,
    distance: Float,
) -> NDArray[np.complex128]:
    """Irradiance (K, n) of pixels, with the phase of lamp, patches, surface and lens."""
    hit = face[pixels] >= 0
    chosen = pixels[hit]
    tree = real.world.tree
    out = np.zeros((k.size, pixels.size), np.complex128)
    power = np.ascontiguousarray((lit.albedo * lit.power).T)
    seen = _irradiance(tree.boxes, tree.links, tree.triangles, points[chosen], normals[chosen], lit.points, lit.normals, lit.area, power, k)
    out[:, hit] = seen.T * np.exp(-1j * k[:, None] * distance[chosen])
    return out


@njit(cache=True, error_model="numpy")
def _irradiance(
    boxes: Float,
    links: NDArray[np.int32],
    tri: Float,
    points: Float,
    normals: Float,
    sources: Float,
    facing: Float,
    area: Float,
    power: NDArray[np.complex128],
    k: Float,
) -> NDArray[np.complex128]:
    """(points, K): what patches of power (n, K) send to points."""
    K = k.size
    out = np.zeros((points.shape[0], K), np.complex128)
    stack = np.empty(96, np.int32)
    hint = np.int64(-1)
    for p in range(points.shape[0]):
        px, py, pz = points[p, 0], points[p, 1], points[p, 2]
        nx, ny, nz = normals[p, 0], normals[p, 1], normals[p, 2]
        for s in range(sources.shape[0]):
            dx, dy, dz = sources[s, 0] - px, sources[s, 1] - py, sources[s, 2] - pz
            here = nx * dx + ny * dy + nz * dz
            there = -(facing[s, 0] * dx + facing[s, 1] * dy + facing[s, 2] * dz)
            d2 = dx * dx + dy * dy + dz * dz
            near = d2 < NEAR * area[s]
            if not near and (here <= 1e-9 or there <= 1e-9 or here * there < 1e-7 * np.pi * d2 * d2):
                continue
            z = (
                near_patch(points[p], normals[p], sources[s], facing[s], area[s], SHORT)
                if near
                else far_patch(here, there, d2, area[s], SHORT)
            )
            if z == 0:
                continue
            found = shadow(boxes, links, tri, stack, hint, px + 1e-6 * nx, py + 1e-6 * ny, pz + 1e-6 * nz, dx, dy, dz)
            if found >= 0:
                hint = found
                continue
            size, length = abs(z), 2 * np.arctan2(z.imag, z.real) / SHORT
            for n in range(K):
                turn = k[n] * length
                out[p, n] += size * power[s, n] * complex(np.cos(turn), -np.sin(turn))
    return out


@njit(cache=True, error_model="numpy")
def _exchange(boxes: Float, links: NDArray[np.int32], tri: Float, points: Float, normals: Float, area: Float) -> tuple[Float, Float]:
    """(n, n): irradiance of patch i per power of patch j, and the way between."""
    n = points.shape[0]
    factor, length = np.zeros((n, n)), np.zeros((n, n))
    stack = np.empty(96, np.int32)
    hint = np.int64(-1)
    for i in range(n):
        for j in range(i):
            d = points[j] - points[i]
            here = normals[i, 0] * d[0] + normals[i, 1] * d[1] + normals[i, 2] * d[2]
            there = -(normals[j, 0] * d[0] + normals[j, 1] * d[1] + normals[j, 2] * d[2])
            if here <= 1e-9 or there <= 1e-9:
                continue
            d2 = d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
            found = shadow(boxes, links, tri, stack, hint, points[i, 0], points[i, 1], points[i, 2], d[0], d[1], d[2])
            if found >= 0:
                hint = found
                continue
            length[i, j] = length[j, i] = np.sqrt(d2)
            factor[i, j] = here * there / (d2 * (np.pi * d2 + area[j]))
            factor[j, i] = here * there / (d2 * (np.pi * d2 + area[i]))
    return factor, length
