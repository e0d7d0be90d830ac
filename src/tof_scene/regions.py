# SPDX-License-Identifier: Apache-2.0
"""Smooth patches of parts: faces connected across flat edges, as places on a part for reports."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_scene.planes import face_normals
from tof_scene.topology import edges_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tof_scene.scene import Scene

SMOOTH_DEG = 20.0
"""Largest angle between the normals of two neighbouring faces of one patch."""


def surface_regions(scene: Scene) -> NDArray[np.int32]:
    """(m,) region of each face of `Scene.triangles()`, from 0; a region never spans two parts."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    vertices, faces, part = scene.triangles()
    pairs = edges_of(vertices, faces, part).faces
    pairs = pairs[pairs[:, 1] >= 0]
    normal = face_normals(vertices, faces)
    smooth = np.abs(np.einsum("ij,ij->i", normal[pairs[:, 0]], normal[pairs[:, 1]])) > np.cos(np.radians(SMOOTH_DEG))
    i, j = pairs[smooth].T
    graph = coo_matrix((np.ones(len(i), bool), (i, j)), shape=(len(faces), len(faces)))
    return np.asarray(connected_components(graph, directed=False)[1], np.int32)
