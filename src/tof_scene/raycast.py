# SPDX-License-Identifier: Apache-2.0
"""Ray casting against the CAD: part, face, distance (in float64 from the face's plane) and normal."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from tof_scene.backends import make_backend
from tof_scene.planes import face_normals, plane_hits, ways_between
from tof_scene.seams import face_curvature, outline_edges
from tof_scene.topology import edges_of

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from tof_core.arrays import Float, Mask
    from tof_scene.scene import Scene
    from tof_scene.topology import Edges

    Indices = NDArray[np.int32]

JITTER = 1e-6
"""Radians by which a ray without a hit is turned before it is cast again (Embree works in float32: 6e-8)."""


@dataclass(frozen=True, slots=True, eq=False)
class Hits:
    """First hits of N rays, in the rays' order.

    t (N,) float64 in lengths of the direction, NaN for a miss; part (N,) int16 and face (N,) int32 (index into
    `Scene.triangles()`), -1 for a miss; normal (N, 3) float64, unit, cell frame, toward the ray's origin.
    """

    t: Float
    part: NDArray[np.int16]
    face: NDArray[np.int32]
    normal: Float


class Raycaster:
    """Casts rays against a scene, both sides of every face.

    The library finds the face; the distance is computed here in float64 from the face's plane. A ray without a hit is cast
    again, turned by a microradian to either side, since it may have passed between two triangles.
    Threads may share a caster.
    """

    def __init__(self, scene: Scene, backend: str = "auto") -> None:
        """Build the tree. `backend`: auto (the faster installed), embree, open3d."""
        self.scene = scene
        self.vertices, self.faces, self.face_part = scene.triangles()
        self.face_normal = face_normals(self.vertices, self.faces)
        self.face_point = np.ascontiguousarray(self.vertices[self.faces[:, 0]])
        # float32 is finest near zero, so the library gets the scene relative to its centre.
        self._middle = scene.bounds().mean(axis=0)
        self._backend = make_backend(backend, self.vertices - self._middle, self.faces)
        self.albedo = np.array([part.material.albedo for part in scene.parts], np.float32)
        self.roughness = np.array([part.material.roughness for part in scene.parts], np.float32)

    @property
    def backend(self) -> str:
        """Name of the ray casting library."""
        return self._backend.name

    def cast(self, origins: ArrayLike, directions: ArrayLike) -> Hits:
        """First hits of rays from origins (N, 3) or (3,) along directions (N, 3), cell frame, any length."""
        directions = np.ascontiguousarray(directions, np.float64).reshape(-1, 3)
        # One point for one ray stays read-only where it is broadcast, and a kernel is compiled again for read-only arrays.
        origins = np.require(np.broadcast_to(origins, directions.shape), np.float64, ["C", "W"])
        face, near = self.first_faces(origins, directions)
        t, normal = plane_hits(origins, directions, face, near, self.face_point, self.face_normal)
        return Hits(t, np.where(face >= 0, self.face_part[face], np.int16(-1)), face, normal)

    def blocked(self, origins: ArrayLike, directions: ArrayLike, reach: float) -> Mask:
        """(N,) whether a ray hits anything within `reach` lengths of its direction; in half the time of `cast`."""
        return self._backend.blocked(*self._rays(origins, directions), reach)

    def blocked_between(self, starts: Float, ends: Float, one: Indices, other: Indices, reach: float) -> Mask:
        """(k,) whether anything stands within `reach` of the ways from points starts[one] to ends[other], (n, 3) and (m, 3) in the cell.

        As `blocked`, without the ways' origins and directions in double precision: there are a hundred times as many ways as points.
        """
        origins, directions = ways_between(starts, ends, one, other, self._middle)
        return self._backend.blocked(origins, directions, reach)

    def first_faces(self, origins: ArrayLike, directions: ArrayLike) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        """The face that each ray hits first (-1 for none), and its float32 distance; rays without a hit are cast again."""
        start, along = self._rays(origins, directions)
        face, near = self._backend.nearest(start, along)
        lost = np.flatnonzero(face < 0)
        for turn in (JITTER, -JITTER):
            if not len(lost):
                break
            found, distance = self._backend.nearest(start[lost], _turned(along[lost], turn))
            face[lost], near[lost] = found, distance
            lost = lost[found < 0]
        return face, near

    def _rays(self, origins: ArrayLike, directions: ArrayLike) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Origins relative to the scene's centre, and directions, (N, 3) float32 for the library."""
        along = np.ascontiguousarray(directions, np.float32)
        start = np.empty_like(along)
        start[:] = np.asarray(origins, np.float64) - self._middle
        return start, along

    @cached_property
    def outline(self) -> tuple[NDArray[np.int32], NDArray[np.int32], Mask]:
        """Edges that may be outlines in an image (see `seams.outline_edges`), computed on first use."""
        return outline_edges(self._edges, self.face_normal)

    @cached_property
    def curvature(self) -> NDArray[np.float32]:
        """(m,) 1/m, largest curvature between each face and a neighbour; 0 across sharp edges."""
        return face_curvature(self._edges, self.vertices, self.faces, self.face_normal)

    @cached_property
    def _edges(self) -> Edges:
        return edges_of(self.vertices, self.faces, self.face_part)


def _turned(directions: NDArray[np.float32], angle: float) -> NDArray[np.float32]:
    """Directions (N, 3) tilted by about an angle, in radians."""
    aside = np.roll(directions, 1, axis=1) * np.array([1.0, -1.0, 0.7], np.float32)
    return directions + np.float32(angle) * aside
