# SPDX-License-Identifier: Apache-2.0
"""Edges and their faces, found by position, since STL files repeat their vertices; smooth patches of faces."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tof_scene.planes import face_normals

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tof_core.arrays import Float

WELD_M = 1e-6
"""Grid in metres to which vertices are rounded; vertices of one part at one grid point count as one."""
SMOOTH_DEG = 20.0
"""Largest angle between the normals of two neighbouring faces of one patch."""


@dataclass(frozen=True, slots=True, eq=False)
class Edges:
    """Edges of a mesh: ends (e, 2) vertex ids; faces (e, 2), the second -1 unless exactly two faces meet."""

    ends: NDArray[np.int32]
    faces: NDArray[np.int32]


def edges_of(vertices: Float, faces: NDArray[np.int32], part: NDArray[np.int16]) -> Edges:
    """The edges of faces (m, 3) over vertices (n, 3); faces of different parts have no common edge."""
    welded = _welded(vertices, faces, part)
    corners = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    pair = np.sort(welded[corners], axis=1)
    key = pair[:, 0] * np.int64(len(vertices)) + pair[:, 1]
    order = np.argsort(key, kind="stable")
    first = np.flatnonzero(np.diff(key[order], prepend=-1))
    count = np.diff(first, append=len(order))
    second = np.where(count == 2, order[np.minimum(first + 1, len(order) - 1)] // 3, -1)
    return Edges(corners[order[first]].astype(np.int32), np.stack([order[first] // 3, second], 1).astype(np.int32))


def _welded(vertices: Float, faces: NDArray[np.int32], part: NDArray[np.int16]) -> NDArray[np.int64]:
    """(n,) id of each vertex, equal for vertices of one part at one place (64-bit hashes of the rounded position)."""
    owner = np.zeros(len(vertices), np.int64)
    owner[faces] = part[:, None]
    place = np.column_stack([np.round(vertices / WELD_M).astype(np.int64), owner]).view(np.uint64)
    primes = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9, 0xD6E8FEB86659FD93], np.uint64)
    mixed = place * primes
    mixed ^= mixed >> np.uint64(29)
    return np.unique((mixed * primes[::-1]).sum(axis=1, dtype=np.uint64), return_inverse=True)[1]


def surface_regions(vertices: Float, faces: NDArray[np.int32], part: NDArray[np.int16]) -> NDArray[np.int32]:
    """(m,) smooth region of each of the faces (m, 3) over vertices (n, 3), from 0; a region never spans two parts (m,)."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    pairs = edges_of(vertices, faces, part).faces
    pairs = pairs[pairs[:, 1] >= 0]
    normal = face_normals(vertices, faces)
    smooth = np.abs(np.einsum("ij,ij->i", normal[pairs[:, 0]], normal[pairs[:, 1]])) > np.cos(np.radians(SMOOTH_DEG))
    i, j = pairs[smooth].T
    graph = coo_matrix((np.ones(len(i), bool), (i, j)), shape=(len(faces), len(faces)))
    return np.asarray(connected_components(graph, directed=False)[1], np.int32)
