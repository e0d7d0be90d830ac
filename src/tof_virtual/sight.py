# SPDX-License-Identifier: Apache-2.0
"""What each pixel of the virtual camera sees: one ray inside a surface, a bundle of rays where surfaces meet."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

from tof_virtual import bvh
from tof_virtual.body import Soup, soup

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from tof_core.arrays import Float, Mask
    from tof_virtual.body import Body

SAME_SURFACE = 2e-3
"""Largest depth difference in metres of two rays on one surface (plus 0.3 % of the range)."""


@dataclass(frozen=True, slots=True, eq=False)
class World:
    """The bodies with their hierarchy."""

    soup: Soup
    tree: bvh.Bvh

    @classmethod
    def of(cls, bodies: Sequence[Body]) -> World:
        """Build the hierarchy once for all views."""
        s = soup(bodies)
        return cls(s, bvh.build(s.corners))


@dataclass(frozen=True, slots=True, eq=False)
class Rays:
    """Rays of any number (N,): distance from the camera in metres (NaN: nothing), face (-1), incidence cosine, direction (N, 3).

    Directions are unit vectors in the cell; `origin` (3,) is the camera.
    """

    distance: Float
    face: NDArray[np.int32]
    cosine: Float
    direction: Float
    origin: Float

    @property
    def points(self) -> Float:
        """Hit points (N, 3) in the cell."""
        return np.asarray(self.origin + self.direction * self.distance[:, None])


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """One view: P pixels in raster order, and S rays for each of the E pixels that see an edge.

    `main` is the surface that fills most of a pixel, met along the pixel's centre; `edge` (E,) are pixel indices
    and `parts` their E * S rays; `z` (P,) is the true depth of `main` along the optical axis.
    """

    main: Rays
    edge: NDArray[np.int64]
    parts: Rays
    samples: int
    z: Float
    length: Float
    shape: tuple[int, int]
    T_cell_camera: Float


def look(world: World, rays: Float, T_cell_camera: Float, *, subsamples: int = 6, width: float = 1.0) -> Sight:
    """Cast a view.

    Args:
        world: the bodies.
        rays: (H, W, 3) directions with z = 1 in the camera frame through the pixel centres.
        T_cell_camera: where the camera is.
        subsamples: rays along each side of a pixel at an edge.
        width: side of a pixel's footprint in pixels.
    """
    height, columns = rays.shape[:2]
    R, origin = T_cell_camera[:3, :3], np.ascontiguousarray(T_cell_camera[:3, 3])
    flat = np.ascontiguousarray(rays.reshape(-1, 3) @ R.T)
    z, face = world.tree.cast(origin, flat)
    s = world.soup
    edge = np.flatnonzero(_edges(z, face, flat, s.normals, s.body, height, columns))
    offsets = (np.arange(subsamples) + 0.5) / subsamples - 0.5
    dv, du = (width * a.ravel() for a in np.meshgrid(offsets, offsets, indexing="ij"))
    step_v, step_u = (g.reshape(-1, 3)[edge] @ R.T for g in np.gradient(rays, axis=(0, 1)))
    bundle = flat[edge][:, None] + du[:, None] * step_u[:, None] + dv[:, None] * step_v[:, None]
    bundle = np.ascontiguousarray(bundle.reshape(-1, 3))
    part_z, part_face = world.tree.cast(origin, bundle)
    nearest = np.argsort(du**2 + dv**2, kind="stable")
    nearest = nearest[np.maximum(np.abs(du), np.abs(dv))[nearest] <= 0.5]  # a wide footprint reaches beyond its own pixel
    if edge.size:
        _majority(edge, du.size, part_z, part_face, bundle, nearest, flat, s.normals, s.body, z, face)
    length = np.linalg.norm(flat, axis=1)
    return Sight(
        main=_rays(z, face, flat, origin, s),
        edge=edge,
        parts=_rays(part_z, part_face, bundle, origin, s),
        samples=du.size,
        z=z,
        length=length,
        shape=(height, columns),
        T_cell_camera=T_cell_camera,
    )


def _rays(z: Float, face: NDArray[np.int32], directions: Float, origin: Float, s: Soup) -> Rays:
    length = np.linalg.norm(directions, axis=1)
    unit = directions / length[:, None]
    cosine = np.abs(np.einsum("ij,ij->i", unit, s.normals[face]))
    return Rays(z * length, face, np.where(face >= 0, cosine, np.nan), unit, origin)


@njit(cache=True, inline="always")
def _apart(z0: float, f0: int, d0: Float, z1: float, f1: int, d1: Float, normals: Float, body: NDArray[np.int32]) -> bool:
    """Whether ray 1 meets something other than the surface on which ray 0 ended."""
    if f0 == f1:
        return False
    if f0 < 0 or f1 < 0 or body[f0] != body[f1]:
        return True
    n = normals[f0]
    slope = n[0] * d1[0] + n[1] * d1[1] + n[2] * d1[2]
    if abs(slope) < 1e-6:
        return True
    expected = z0 * (n[0] * d0[0] + n[1] * d0[1] + n[2] * d0[2]) / slope
    return bool(abs(expected - z1) > SAME_SURFACE + 0.003 * z1)


@njit(cache=True)
def _edges(z: Float, face: NDArray[np.int32], rays: Float, normals: Float, body: NDArray[np.int32], height: int, width: int) -> Mask:
    """Pixels with a neighbour (of eight) on another surface."""
    out = np.zeros(height * width, np.bool_)
    for v in range(height):
        for u in range(width):
            i = v * width + u
            for k in range(4):  # right, down-left, down, down-right: each pair once
                y, x = v + (k > 0), u + (1 if k == 0 else k - 2)
                if y >= height or x < 0 or x >= width:
                    continue
                j = y * width + x
                if _apart(z[i], face[i], rays[i], z[j], face[j], rays[j], normals, body):
                    out[i] = out[j] = True
    return out


@njit(cache=True)
def _majority(
    edge: NDArray[np.int64],
    samples: int,
    part_z: Float,
    part_face: NDArray[np.int32],
    bundle: Float,
    nearest: NDArray[np.int64],
    rays: Float,
    normals: Float,
    body: NDArray[np.int32],
    z: Float,
    face: NDArray[np.int32],
) -> None:
    """Write into z and face the surface that most of each edge pixel's rays meet, prolonged to the pixel's centre."""
    group = np.empty(samples, np.int64)
    for e in range(edge.size):
        first = e * samples
        group[:] = -1
        best, most = -1, 0
        for k in nearest:  # groups form around the rays nearest to the centre
            if group[k] >= 0:
                continue
            i, count = first + k, 0
            for b in nearest:
                j = first + b
                if group[b] < 0 and not _apart(part_z[i], part_face[i], bundle[i], part_z[j], part_face[j], bundle[j], normals, body):
                    group[b] = k
                    count += 1
            if count > most:
                best, most = i, count
        p = edge[e]
        face[p], z[p] = part_face[best], part_z[best]
        if face[p] < 0:
            z[p] = np.nan
            continue
        n, d, c = normals[face[p]], bundle[best], rays[p]
        slope = n[0] * c[0] + n[1] * c[1] + n[2] * c[2]
        along = z[p] * (n[0] * d[0] + n[1] * d[1] + n[2] * d[2])
        if abs(slope) > 1e-6 and abs(along / slope - z[p]) < 0.05 * z[p]:
            z[p] = along / slope
