# SPDX-License-Identifier: Apache-2.0
"""Smooth patches of parts: faces joined across edges that bend little, so that a report can say where on a part."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_scene.planes import face_normals

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tof_scene.scene import Scene

SMOOTH_DEG = 20.0
"""Two faces belong to one patch when their normals differ by less across the edge they share."""


def surface_regions(scene: Scene) -> NDArray[np.int32]:
    """(m,) region of each face of `Scene.triangles()`, from 0; a region never spans two parts."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    vertices, faces, part = scene.triangles()
    pairs = neighbours(vertices, faces, part)
    normal = face_normals(vertices, faces)
    smooth = np.abs(np.einsum("ij,ij->i", normal[pairs[:, 0]], normal[pairs[:, 1]])) > np.cos(np.radians(SMOOTH_DEG))
    i, j = pairs[smooth].T
    graph = coo_matrix((np.ones(len(i), bool), (i, j)), shape=(len(faces), len(faces)))
    return np.asarray(connected_components(graph, directed=False)[1], np.int32)


def neighbours(vertices: NDArray[np.float64], faces: NDArray[np.int32], part: NDArray[np.int16]) -> NDArray[np.int64]:
    """(k, 2) faces of one part that share an edge; vertices closer than a micrometre count as one."""
    edges, owner = shared_edges(vertices, faces, part)
    order = np.lexsort(edges.T)
    edges, owner = edges[order], owner[order]
    same = np.flatnonzero((edges[1:] == edges[:-1]).all(axis=1))
    return np.stack([owner[same], owner[same + 1]], 1)


def shared_edges(
    vertices: NDArray[np.float64], faces: NDArray[np.int32], part: NDArray[np.int16]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """(3 m, 2) edges as sorted ids of distinct vertices (of a part), and the face (3 m,) that each belongs to."""
    corner_part = np.zeros(len(vertices), np.int64)
    corner_part[faces] = part[:, None]
    keys = np.column_stack([np.round(vertices * 1e6).astype(np.int64), corner_part])
    _, welded = np.unique(keys.view([("", np.int64)] * 4).ravel(), return_inverse=True)
    edges = np.sort(welded[faces[:, [0, 1, 1, 2, 2, 0]]].reshape(-1, 2), axis=1)
    return edges, np.repeat(np.arange(len(faces)), 3)
