# SPDX-License-Identifier: Apache-2.0
"""Solids as (vertices, faces) in metres, z up: boxes, lathed solids, tubes along paths, and sheets with round holes bent to any surface."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import ArrayLike, NDArray

    from tof_core.arrays import Float

    Surface = Callable[[Float], Float]

Solid: TypeAlias = "tuple[Float, NDArray[np.int32]]"
SEGMENTS = 48
REACH = 4.0
"""Cells around a hole within which the mesh may be changed."""


def join(*solids: Solid) -> Solid:
    """Several solids as one mesh; surfaces within another solid are kept."""
    starts = np.cumsum([0, *(len(v) for v, _ in solids)])
    return np.concatenate([v for v, _ in solids]), np.concatenate([f + np.int32(s) for (_, f), s in zip(solids, starts[:-1], strict=True)])


def moved(solid: Solid, xyz: ArrayLike = (0, 0, 0), *, axis: str = "z") -> Solid:
    """Turn the solid's z axis to `axis` (x, y, z, -x, -y, -z), then shift it."""
    turns = {"z": "xyz", "x": "zxy", "y": "yzx"}
    order = ["xyz".index(c) for c in turns[axis[-1]]]
    v = solid[0].copy()
    if axis.startswith("-"):
        v[:, 1:] *= -1  # half a turn about x, so that it stays right-handed
    return v[:, order] + np.asarray(xyz, float), solid[1]


def rotated(solid: Solid, axis: str, degrees: float, about: ArrayLike = (0, 0, 0)) -> Solid:
    """Turn about a main axis through `about`, right-handed."""
    i = "xyz".index(axis)
    j, k = (i + 1) % 3, (i + 2) % 3
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    v = solid[0] - np.asarray(about, float)
    out = v.copy()
    out[:, j], out[:, k] = c * v[:, j] - s * v[:, k], s * v[:, j] + c * v[:, k]
    return out + np.asarray(about, float), solid[1]


def box(size: ArrayLike, centre: ArrayLike = (0, 0, 0), cells: int = 1) -> Solid:
    """A box; each side is divided into `cells`, which avoids long, thin triangles."""
    faces = []
    for axis in range(3):
        for side in (-1.0, 1.0):
            uv, tri = grid(cells, cells)
            xyz = np.empty((len(uv), 3))
            xyz[:, axis], xyz[:, (axis + 1) % 3], xyz[:, (axis + 2) % 3] = side, 2 * uv[:, 0] - 1, 2 * uv[:, 1] - 1
            faces.append((xyz, tri if side > 0 else tri[:, ::-1]))
    v, f = join(*faces)
    return v * np.asarray(size, float) / 2 + np.asarray(centre, float), np.ascontiguousarray(f)


def grid(nu: int, nv: int) -> Solid:
    """The unit square in nu x nv cells: points (n, 2) and triangles, counter-clockwise."""
    v, u = np.mgrid[: nv + 1, : nu + 1]
    at = (np.arange(nv)[:, None] * (nu + 1) + np.arange(nu)).ravel()
    tri = np.concatenate([np.stack([at, at + 1, at + nu + 2], 1), np.stack([at, at + nu + 2, at + nu + 1], 1)])
    return np.stack([u.ravel() / nu, v.ravel() / nv], 1), tri.astype(np.int32)


def lathe(profile: ArrayLike, segments: int = SEGMENTS, core: tuple[float, float] = (0.0, 0.0)) -> Solid:
    """Turn a profile of (radius, z) about z; the material is on its left: outward at the bottom, up outside, inward at the top.

    With `core` (half sizes along x and y) the circle runs around that rectangle instead of around a point.
    """
    profile = np.asarray(profile, float)
    angle = 2 * np.pi * (np.arange(segments) + 0.5) / segments
    rings = [_ring(r, z, angle, np.asarray(core)) for r, z in profile]
    starts = np.cumsum([0, *(len(ring) for ring in rings)])
    faces = []
    i = np.arange(segments)
    j = (i + 1) % segments
    for a, b, na, nb in zip(starts[:-2], starts[1:-1], map(len, rings[:-1]), map(len, rings[1:]), strict=True):
        if nb > 1:
            faces.append(np.stack([a + i % na, b + j, b + i], 1))
        if na > 1:
            faces.append(np.stack([a + i, a + j, b + j % nb], 1))
    return np.concatenate(rings), np.concatenate(faces).astype(np.int32)


def _ring(r: float, z: float, angle: Float, core: Float) -> Float:
    if r == 0:
        return np.array([[0.0, 0.0, z]])
    around = np.stack([np.cos(angle), np.sin(angle)], 1)
    return np.column_stack([r * around + core * np.sign(around), np.full_like(angle, z)])


def cylinder(radius: float, height: float, segments: int = SEGMENTS) -> Solid:
    """A closed cylinder standing on z = 0, with chamfers of a twentieth of the radius."""
    c = min(radius, height) / 20
    return lathe([(0, 0), (radius - c, 0), (radius, c), (radius, height - c), (radius - c, height), (0, height)], segments)


def hexagon_bolt(size: float) -> Solid:
    """Head and washer of a bolt of nominal diameter `size` (ISO 4017, ISO 7089), standing on z = 0."""
    across, washer, height = 0.92 * size, 1.05 * size, 0.18 * size
    top = height + 0.64 * size
    head = lathe([(0, height), (across, height), (across, top - 0.1 * size), (0.85 * across, top), (0, top)], 6)
    return join(lathe([(0, 0), (washer, 0), (washer, height), (0, height)]), head)


def socket_screw(size: float) -> Solid:
    """Head of a socket screw (ISO 4762) with its hole, standing on z = 0."""
    r = 0.75 * size
    return lathe([(0, 0), (r, 0), (r, 0.9 * size), (0.93 * r, size), (0.45 * size, size), (0.45 * size, 0.45 * size), (0, 0.4 * size)])


def torus(radius: float, thickness: float, segments: int = SEGMENTS) -> Solid:
    """A ring around z with a round section of radius `thickness`."""
    a = np.linspace(-np.pi, np.pi, 25)
    return lathe(np.stack([radius + thickness * np.cos(a), thickness * np.sin(a)], 1), segments)


def sphere(radius: float, segments: int = SEGMENTS) -> Solid:
    """A sphere around the origin."""
    a = np.linspace(-np.pi / 2, np.pi / 2, segments // 2 + 1)
    profile = np.stack([radius * np.cos(a), radius * np.sin(a)], 1)
    profile[[0, -1], 0] = 0
    return lathe(profile, segments)


def tube(path: ArrayLike, radius: float, segments: int = 24) -> Solid:
    """A closed round bar along a path of points (n, 3), no sharp turns."""
    path = np.asarray(path, float)
    tangent = np.gradient(path, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    side = np.cross(tangent[0], np.eye(3)[np.argmin(np.abs(tangent[0]))])
    angle = 2 * np.pi * np.arange(segments) / segments
    rings = []
    for p, t in zip(path, tangent, strict=True):
        side = side - (side @ t) * t
        side /= np.linalg.norm(side)
        rings.append(p + radius * (np.cos(angle)[:, None] * side + np.sin(angle)[:, None] * np.cross(t, side)))
    i, n = np.arange(segments), len(path)
    j = (i + 1) % segments
    base = np.arange(n - 1)[:, None] * segments
    quads = [np.stack([base + i, base + j, base + segments + j], -1), np.stack([base + i, base + segments + j, base + segments + i], -1)]
    first, last = n * segments, n * segments + 1
    caps = [
        np.stack([np.full_like(i, first), j, i], 1),
        np.stack([np.full_like(i, last), (n - 1) * segments + i, (n - 1) * segments + j], 1),
    ]
    faces = np.concatenate([*(q.reshape(-1, 3) for q in quads), *caps])
    return np.concatenate([*rings, path[:1], path[-1:]]), faces.astype(np.int32)


def arc(centre: ArrayLike, start: ArrayLike, end: ArrayLike, n: int = 16) -> Float:
    """Points (n, 3) on a quarter circle about `centre` from `start` to `end`, which must be perpendicular."""
    centre, start, end = (np.asarray(p, float) for p in (centre, start, end))
    a = np.linspace(0, np.pi / 2, n)[:, None]
    return np.asarray(centre + np.cos(a) * (start - centre) + np.sin(a) * (end - centre))


def sheet(
    size: tuple[float, float], cells: tuple[int, int], thickness: float, surface: Surface, holes: Sequence[tuple[float, float, float]] = ()
) -> Solid:
    """A bent sheet of constant thickness with round holes.

    Args:
        size: (u, v) extent of the flat pattern in metres, from (0, 0).
        cells: number of cells along u and v.
        thickness: material behind `surface`, against its normal.
        surface: maps flat points (n, 2) to points (n, 3) of the visible side; its normal is d/du x d/dv.
        holes: (u, v, radius) in the flat pattern.
    """
    uv, tri = grid(*cells)
    uv = uv * size
    for hole in holes:
        uv, tri = _pierced(uv, tri, hole, np.asarray(size) / cells)
    front = surface(uv)
    du, dv = np.array([1e-6, 0]), np.array([0, 1e-6])
    normal = np.cross(surface(uv + du) - surface(uv - du), surface(uv + dv) - surface(uv - dv))
    back = front - thickness * normal / np.linalg.norm(normal, axis=1, keepdims=True)
    n = np.int32(len(uv))
    rim = _rim(tri)
    walls = np.concatenate([np.stack([rim[:, 0], rim[:, 0] + n, rim[:, 1]], 1), np.stack([rim[:, 1], rim[:, 0] + n, rim[:, 1] + n], 1)])
    return np.concatenate([front, back]), np.concatenate([tri, tri[:, ::-1] + n, walls]).astype(np.int32)


def _rim(tri: NDArray[np.int32]) -> NDArray[np.int32]:
    """(k, 2) directed edges that belong to one triangle only, in ascending order."""
    a, b = tri[:, [0, 1, 2]].ravel().astype(np.int64), tri[:, [1, 2, 0]].ravel().astype(np.int64)
    points = max(int(tri.max(initial=0)) + 1, 1)
    edges, reverse = np.sort(a * points + b), np.sort(b * points + a)
    alone = edges[reverse[np.minimum(np.searchsorted(reverse, edges), len(reverse) - 1)] != edges]
    return np.stack([alone // points, alone % points], 1).astype(np.int32)


def _pierced(uv: Float, tri: NDArray[np.int32], hole: tuple[float, float, float], cell: Float) -> Solid:
    """Remove the cells around a hole from a flat mesh, and fill the space between them and the circle with triangles."""
    u, v, radius = hole
    inside = np.asarray(np.all(np.abs(uv - [u, v]) < radius + REACH * cell, axis=1))
    near = np.asarray(np.any(inside[tri], axis=1))
    corners = uv[tri[near]]
    centre = (corners[:, 0] + corners[:, 1] + corners[:, 2]) / 3
    middle = (np.floor(centre / cell) + 0.5) * cell
    keep = ~near
    keep[near] = (np.abs(middle - [u, v]) > radius + 0.75 * cell).any(axis=1)
    frame = np.flatnonzero(np.bincount(_rim(tri[~keep])[:, 0])).astype(np.int32)
    angle_of = np.arctan2(uv[frame, 1] - v, uv[frame, 0] - u)
    outer = frame[np.argsort(angle_of, kind="stable")]
    angle = 2 * np.pi * (np.arange(SEGMENTS) + 0.5) / SEGMENTS - np.pi
    inner = np.arange(SEGMENTS, dtype=np.int32) + len(uv)
    points = np.concatenate([uv, np.stack([u + radius * np.cos(angle), v + radius * np.sin(angle)], 1)])
    return points, np.concatenate([tri[keep], _zip(outer, np.sort(angle_of), inner, angle)])


def _zip(outer: NDArray[np.int32], at_outer: Float, inner: NDArray[np.int32], at_inner: Float) -> NDArray[np.int32]:
    """Triangles between two closed loops sorted by angle, one inside the other."""
    n, m = len(outer), len(inner)
    ahead_o, ahead_i = np.append(at_outer, at_outer[0] + 2 * np.pi), np.append(at_inner, at_inner[0] + 2 * np.pi)
    i = j = 0
    faces = []
    while i < n or j < m:
        if j == m or (i < n and ahead_o[i] + ahead_o[i + 1] <= 2 * ahead_i[j + 1]):
            faces.append((inner[j % m], outer[i], outer[(i + 1) % n]))
            i += 1
        else:
            faces.append((inner[j], outer[i % n], inner[(j + 1) % m]))
            j += 1
    return np.asarray(faces, np.int32)
