# SPDX-License-Identifier: Apache-2.0
"""The parts of a scene as BOP models: ASCII PLY in millimetres, centred, with their extents."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from pathlib import Path

    from tof_core.arrays import Float, Ints
    from tof_scene.scene import Scene


@dataclass(frozen=True, slots=True, eq=False)
class Model:
    """One part as BOP names it: object `part` + 1, its origin at `centre` (3,) of the cell, metres."""

    part: int
    centre: Float

    @property
    def obj_id(self) -> int:
        """BOP counts objects from 1."""
        return self.part + 1

    def pose(self, T_camera_cell: Float) -> dict[str, Any]:
        """The model's pose in the camera, as in scene_gt.json; its axes are the cell's."""
        t = T_camera_cell[:3, :3] @ self.centre + T_camera_cell[:3, 3]
        return {"cam_R_m2c": T_camera_cell[:3, :3].ravel().tolist(), "cam_t_m2c": (1e3 * t).tolist(), "obj_id": self.obj_id}


def write_models(scene: Scene, folder: Path) -> list[Model]:
    """Write obj_000001.ply and so on, and models_info.json with the part's name beside BOP's keys."""
    folder.mkdir(parents=True, exist_ok=True)
    models, info = [], {}
    for index, part in enumerate(scene.parts):
        low, high = part.vertices.min(axis=0), part.vertices.max(axis=0)
        model = Model(index, 0.5 * (low + high))
        vertices = 1e3 * (part.vertices - model.centre)
        write_ply(folder / f"obj_{model.obj_id:06d}.ply", vertices, part.faces)
        size = 1e3 * (high - low)
        info[str(model.obj_id)] = {
            "diameter": diameter(vertices),
            **dict(zip(("min_x", "min_y", "min_z"), (-0.5 * size).tolist(), strict=True)),
            **dict(zip(("size_x", "size_y", "size_z"), size.tolist(), strict=True)),
            "name": part.name,
        }
        models.append(model)
    (folder / "models_info.json").write_text(json.dumps(info, indent=1))
    return models


def diameter(vertices: Float) -> float:
    """The largest distance between two vertices (n, 3), over their hull where there is one."""
    from scipy.spatial import ConvexHull, QhullError
    from scipy.spatial.distance import pdist

    try:
        vertices = vertices[ConvexHull(vertices).vertices]
    except QhullError:  # flat: its hull has no volume
        vertices = np.unique(vertices, axis=0)
    # A fine mesh's hull can still have tens of thousands of vertices; extremes along many directions bound it to 1e-3.
    if len(vertices) > 2000:
        turns = np.random.default_rng(0).normal(size=(1000, 3))
        along = vertices @ turns.T
        vertices = vertices[np.unique(np.concatenate([along.argmax(axis=0), along.argmin(axis=0)]))]
    return float(pdist(vertices).max())


def write_ply(path: Path, vertices: Float, faces: Ints) -> None:
    """An ASCII PLY with angle-weighted vertex normals, which BOP asks for."""
    normals = vertex_normals(vertices, faces)
    header = [
        "ply",
        "format ascii 1.0",
        f"element vertex {len(vertices)}",
        *(f"property float {n}" for n in ("x", "y", "z", "nx", "ny", "nz")),
        f"element face {len(faces)}",
        "property list uchar int vertex_indices",
        "end_header",
    ]
    with path.open("w") as file:
        file.write("\n".join(header) + "\n")
        np.savetxt(file, np.hstack([vertices, normals]), fmt="%.6g")
        np.savetxt(file, np.hstack([np.full((len(faces), 1), 3), faces]), fmt="%d")


def vertex_normals(vertices: Float, faces: Ints) -> Float:
    """(n, 3) unit normals: face normals weighted by the angle each face has at the vertex."""
    corners = vertices[faces]
    out = np.zeros_like(vertices)
    for k in range(3):
        a, b = corners[:, (k + 1) % 3] - corners[:, k], corners[:, (k + 2) % 3] - corners[:, k]
        cross = np.cross(a, b)
        area = np.linalg.norm(cross, axis=1)
        angle = np.arctan2(area, (a * b).sum(axis=1))
        np.add.at(out, faces[:, k], cross / np.maximum(area, 1e-300)[:, None] * angle[:, None])
    length = np.linalg.norm(out, axis=1, keepdims=True)
    return np.asarray(np.where(length > 0, out / np.maximum(length, 1e-300), [0.0, 0.0, 1.0]))
