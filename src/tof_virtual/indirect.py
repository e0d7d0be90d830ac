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

from tof_virtual.transfer import interpolate, irradiance_of_patches, transfer

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
    to_each_other = transfer(tree.boxes, tree.links, tree.triangles, lit.points, lit.normals, lit.area, wavenumber)
    total, fresh = lit.power.copy(), lit.power
    for _ in range(bounces - 2):
        fresh = lit.area * (to_each_other @ (lit.albedo * fresh))
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
    left = interpolate(out, gathered, points, normals, main.face, rows, columns, width)
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
    out[hit] = irradiance_of_patches(
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
