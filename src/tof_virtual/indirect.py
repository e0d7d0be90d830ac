# SPDX-License-Identifier: Apache-2.0
"""Indirect light: lit patches of the scene illuminate the points that the pixels see.

The emitter's beam is divided into cones of equal solid angle. Each cone lights a patch of known power. The patch radiates by
Lambert's law to all other patches and visible points that are not occluded (instant radiosity, Keller 1997, with complex power
so that path lengths are kept). The irradiance of a point is complex: its argument is the extra phase.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

from tof_virtual.bvh import shadow

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tof_core.arrays import Float
    from tof_virtual.sight import Rays, Sight, World

CONES = (24, 30)
"""Cones along the image's height and width."""
WIDER = 1.3
"""Width of the beam over that of the image."""
POINTS = 45
"""Points across the image at which the light is gathered; between them it is interpolated on the surface."""
GRAZING = 0.05
"""Least incidence cosine of a cone; it bounds the size of a patch."""
NEAR, CUT = 8.0, 5
"""Patches whose area is more than an eighth of their squared distance are divided into 5 x 5."""


@dataclass(frozen=True, slots=True, eq=False)
class Patches:
    """Lit patches (n,): points (n, 3), normals (n, 3), areas, albedos, and power over the emitter's intensity.

    Power is complex: its argument is half the phase of the way from the emitter.
    """

    points: Float
    normals: Float
    area: Float
    albedo: Float
    power: NDArray[np.complex128]


def irradiance(
    world: World,
    sight: Sight,
    rays: Float,
    wavenumber: float,
    *,
    bounces: int = 4,
    wider: float = WIDER,
    cones: tuple[int, int] = CONES,
    points: int = POINTS,
) -> NDArray[np.complex128]:
    """Indirect irradiance (P,) of the main surfaces over the emitter's intensity, per square metre.

    Its argument is the phase of the excess of the indirect path over the direct one. `wavenumber` is phase per metre of
    distance (half the path). `rays` (H, W, 3) are the camera's; the beam is `wider` than they are, divided into `cones`; light is
    gathered at about `points` columns.
    """
    patches = _patches(world, sight, rays, wavenumber, wider, cones)
    patches = _bounce(world, patches, wavenumber, bounces)
    return _spread(world, sight, patches, wavenumber, max(sight.shape[1] // points, 1))


def _patches(world: World, sight: Sight, rays: Float, wavenumber: float, wider: float, cones: tuple[int, int]) -> Patches:
    """Cast one jittered ray into each cone of the beam."""
    rows, columns = cones
    low, high = rays[..., :2].min(axis=(0, 1)), rays[..., :2].max(axis=(0, 1))
    middle, half = 0.5 * (low + high), 0.5 * wider * (high - low)
    rng = np.random.default_rng(len(world.soup.normals))
    j, i = (g + rng.uniform(-0.4, 0.4, cones) for g in np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij"))
    x = middle[0] + half[0] * (2 * (i.ravel() + 0.5) / columns - 1)
    y = middle[1] + half[1] * (2 * (j.ravel() + 0.5) / rows - 1)
    local = np.stack([x, y, np.ones_like(x)], axis=1)
    # solid angle of a cell of the plane z = 1
    angle = 4 * half[0] * half[1] / (rows * columns) / np.linalg.norm(local, axis=1) ** 3
    directions = local @ sight.T_cell_camera[:3, :3].T
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    origin = np.ascontiguousarray(sight.T_cell_camera[:3, 3])
    distance, face = world.tree.cast(origin, directions)
    hit = np.flatnonzero(face >= 0)
    directions, distance, face, angle = directions[hit], distance[hit], face[hit], angle[hit]
    cosine = np.einsum("ij,ij->i", directions, world.soup.normals[face])
    normals = world.soup.normals[face] * -np.sign(cosine)[:, None]
    return Patches(
        points=origin + directions * distance[:, None],
        normals=normals,
        albedo=world.soup.albedo[face],
        area=angle * distance**2 / np.maximum(np.abs(cosine), GRAZING),
        power=angle * np.exp(0.5j * wavenumber * distance),
    )


def _bounce(world: World, lit: Patches, wavenumber: float, bounces: int) -> Patches:
    """Exchange light between the patches. `_spread` gathers the second bounce, so this adds the third and later ones."""
    if bounces < 3 or not lit.area.size:
        return lit
    tree = world.tree
    transfer = _transfer(tree.boxes, tree.links, tree.triangles, lit.points, lit.normals, lit.area, wavenumber)
    total, fresh = lit.power.copy(), lit.power
    for _ in range(bounces - 2):
        fresh = lit.area * (transfer @ (lit.albedo * fresh))
        total = total + fresh
    return Patches(lit.points, lit.normals, lit.area, lit.albedo, total)


def _spread(world: World, sight: Sight, lit: Patches, wavenumber: float, stride: int) -> NDArray[np.complex128]:
    """Gather on a coarse raster, interpolate where surface and neighbours agree, gather at the remaining pixels."""
    out = np.zeros(sight.z.size, np.complex128)
    if not lit.area.size:
        return out
    height, width = sight.shape
    main = sight.main
    rows = np.unique(np.append(np.arange(0, height, stride), height - 1))
    columns = np.unique(np.append(np.arange(0, width, stride), width - 1))
    coarse = (rows[:, None] * width + columns).ravel()
    normals = _toward(world, main)
    gathered = _gather(world, main, normals, coarse, lit, wavenumber)
    points = main.points
    left = _interpolate(out, gathered, points, normals, main.face, rows, columns, width)
    rest = np.flatnonzero(left)
    out[rest] = _gather(world, main, normals, rest, lit, wavenumber)
    return out


def _toward(world: World, rays: Rays) -> Float:
    normals = world.soup.normals[rays.face]
    return np.asarray(normals * -np.sign(np.einsum("ij,ij->i", normals, rays.direction))[:, None])


def _gather(world: World, rays: Rays, normals: Float, pixels: NDArray[np.int64], lit: Patches, wavenumber: float) -> NDArray[np.complex128]:
    hit = rays.face[pixels] >= 0
    chosen = pixels[hit]
    tree = world.tree
    out = np.zeros(pixels.size, np.complex128)
    out[hit] = _light(
        tree.boxes,
        tree.links,
        tree.triangles,
        rays.points[chosen],
        normals[chosen],
        rays.distance[chosen],
        lit.points,
        lit.normals,
        lit.area,
        lit.albedo * lit.power,
        wavenumber,
    )
    return out


@njit(cache=True, error_model="numpy")
def _light(
    boxes: Float,
    links: NDArray[np.int32],
    tri: Float,
    points: Float,
    normals: Float,
    distance: Float,
    sources: Float,
    facing: Float,
    area: Float,
    power: NDArray[np.complex128],
    wavenumber: float,
) -> NDArray[np.complex128]:
    """Irradiance of points by patches, with the phase of the points' direct path subtracted."""
    out = np.zeros(points.shape[0], np.complex128)
    stack = np.empty(96, np.int32)
    hint = -1
    for p in range(points.shape[0]):
        px, py, pz = points[p, 0], points[p, 1], points[p, 2]
        nx, ny, nz = normals[p, 0], normals[p, 1], normals[p, 2]
        total = 0j
        for s in range(sources.shape[0]):
            dx, dy, dz = sources[s, 0] - px, sources[s, 1] - py, sources[s, 2] - pz
            here = nx * dx + ny * dy + nz * dz
            there = -(facing[s, 0] * dx + facing[s, 1] * dy + facing[s, 2] * dz)
            d2 = dx * dx + dy * dy + dz * dz
            near = d2 < NEAR * area[s]
            if not near and (here <= 1e-9 or there <= 1e-9 or here * there < 1e-7 * np.pi * d2 * d2):
                continue
            z = (
                _near(points[p], normals[p], sources[s], facing[s], area[s], wavenumber)
                if near
                else _far(here, there, d2, area[s], wavenumber)
            )
            if z == 0:
                continue
            found = shadow(boxes, links, tri, stack, hint, px + 1e-6 * nx, py + 1e-6 * ny, pz + 1e-6 * nz, dx, dy, dz)
            if found >= 0:
                hint = found
                continue
            total += power[s] * z
        # (emitter, patch, point, camera) halved, less the direct way; the emitter's share is in the power
        turn = -0.5 * wavenumber * distance[p]
        out[p] = total * complex(np.cos(turn), np.sin(turn))
    return out


@njit(cache=True, inline="always", error_model="numpy")
def _far(here: float, there: float, d2: float, area: float, wavenumber: float) -> complex:
    """Irradiance per power over a distance, with half its phase; a patch is a disc that fills at most half of the hemisphere."""
    turn = 0.5 * wavenumber * np.sqrt(d2)
    return here * there / (d2 * (np.pi * d2 + area)) * complex(np.cos(turn), np.sin(turn))


@njit(cache=True, error_model="numpy")
def _near(point: Float, normal: Float, source: Float, facing: Float, area: float, wavenumber: float) -> complex:
    """The same for a patch that is large for its distance: divided into squares on its tangent plane."""
    i = int(np.argmin(np.abs(facing)))
    x = np.zeros(3)
    x[i] = 1.0
    x -= facing[i] * facing
    x /= np.sqrt(x[0] ** 2 + x[1] ** 2 + x[2] ** 2)
    y = np.array([facing[1] * x[2] - facing[2] * x[1], facing[2] * x[0] - facing[0] * x[2], facing[0] * x[1] - facing[1] * x[0]])
    side, total, facing_us = np.sqrt(area) / CUT, 0j, 0
    for j in range(CUT):
        for k in range(CUT):
            d = source + (j - 0.5 * (CUT - 1)) * side * x + (k - 0.5 * (CUT - 1)) * side * y - point
            here = normal[0] * d[0] + normal[1] * d[1] + normal[2] * d[2]
            there = -(facing[0] * d[0] + facing[1] * d[1] + facing[2] * d[2])
            d2 = d[0] ** 2 + d[1] ** 2 + d[2] ** 2
            if here > 0 and there > 0 and d2 > 1e-12:
                total += _far(here, there, d2, area / CUT**2, wavenumber)
                facing_us += 1
    # squares behind the point's plane lie beyond a corner, while the cone ended on this side of it
    return total / max(facing_us, 1)


@njit(cache=True, error_model="numpy")
def _transfer(
    boxes: Float,
    links: NDArray[np.int32],
    tri: Float,
    points: Float,
    normals: Float,
    area: Float,
    wavenumber: float,
) -> NDArray[np.complex128]:
    """(n, n): irradiance of patch i per power of patch j, with half the phase of the way between."""
    n = points.shape[0]
    out = np.zeros((n, n), np.complex128)
    stack = np.empty(96, np.int32)
    hint = -1
    for i in range(n):
        for j in range(i):
            d = points[j] - points[i]
            here = normals[i, 0] * d[0] + normals[i, 1] * d[1] + normals[i, 2] * d[2]
            there = -(normals[j, 0] * d[0] + normals[j, 1] * d[1] + normals[j, 2] * d[2])
            d2 = d[0] ** 2 + d[1] ** 2 + d[2] ** 2
            if here <= 1e-9 or there <= 1e-9:
                continue
            found = shadow(boxes, links, tri, stack, hint, points[i, 0], points[i, 1], points[i, 2], d[0], d[1], d[2])
            if found >= 0:
                hint = found
                continue
            turn = 0.5 * wavenumber * np.sqrt(d2)
            z = here * there / d2 * complex(np.cos(turn), np.sin(turn))
            out[i, j] = z / (np.pi * d2 + area[j])
            out[j, i] = z / (np.pi * d2 + area[i])
    return out


@njit(cache=True)
def _interpolate(
    out: NDArray[np.complex128],
    gathered: NDArray[np.complex128],
    points: Float,
    normals: Float,
    face: NDArray[np.int32],
    rows: NDArray[np.int64],
    columns: NDArray[np.int64],
    width: int,
) -> NDArray[np.bool_]:
    """Bilinear on the raster between coarse points of the same smooth surface; returns the pixels that have none."""
    left = np.zeros(face.size, np.bool_)
    stride = rows[1]
    for v in range(face.size // width):
        a = min(v // stride, rows.size - 2)
        fv = (v - rows[a]) / (rows[a + 1] - rows[a])
        for u in range(width):
            p = v * width + u
            if face[p] < 0:
                continue
            b = min(u // stride, columns.size - 2)
            fu = (u - columns[b]) / (columns[b + 1] - columns[b])
            total, value = 0.0, 0j
            for k in range(4):
                i, j = a + k // 2, b + k % 2
                q = rows[i] * width + columns[j]
                if face[q] < 0:
                    continue
                alike = normals[p, 0] * normals[q, 0] + normals[p, 1] * normals[q, 1] + normals[p, 2] * normals[q, 2]
                off = 0.0
                for c in range(3):
                    off += normals[p, c] * (points[q, c] - points[p, c])
                if alike < 0.9 or abs(off) > 0.01:
                    continue
                w = (fv if k // 2 else 1 - fv) * (fu if k % 2 else 1 - fu) + 1e-6
                total += w
                value += w * gathered[i * columns.size + j]
            if total > 1e-3:
                out[p] = value / total
            else:
                left[p] = True
    return left
