# SPDX-License-Identifier: Apache-2.0
"""The virtual scene: named triangle meshes with a reflectance, and all their triangles in one array."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tof_core.errors import SceneError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from tof_core.arrays import Float, Mask


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """One rigid body: vertices (n, 3) in metres in the cell frame, faces (m, 3) indices, diffuse albedo 0..1.

    `roughness` 1 is a perfectly matt surface; smaller ones shine where the `specular` effect is on.
    `subject`: the views aim at this body (at all of them if none is marked).
    """

    name: str
    vertices: Float
    faces: NDArray[np.int32]
    albedo: float = 0.5
    roughness: float = 1.0
    subject: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Soup:
    """All bodies as triangles: corners (m, 3, 3), unit normals (m, 3), and per face its body, albedo and roughness.

    `subject` (bodies,) marks those that the views aim at, `names` (bodies,) names all; `extent` is the diagonal of everything in metres.
    """

    corners: Float
    normals: Float
    body: NDArray[np.int32]
    albedo: Float
    roughness: Float
    subject: Mask
    names: tuple[str, ...]
    extent: float

    @property
    def box(self) -> tuple[Float, Float]:
        """Lowest and highest corner of the subjects."""
        points = self.corners[self.subject[self.body]].reshape(-1, 3)
        return points.min(axis=0), points.max(axis=0)

    @property
    def centre(self) -> Float:
        """Centre (3,) of the subjects."""
        low, high = self.box
        return np.asarray(0.5 * (low + high))


def soup(bodies: Sequence[Body]) -> Soup:
    """Join bodies into one soup; faces without area are dropped."""
    if not bodies:
        msg = "there are no bodies"
        raise SceneError(msg, where="virtual robot", todo="pass at least one body")
    corners = np.concatenate([np.asarray(b.vertices, float)[np.asarray(b.faces)] for b in bodies])
    counts = [len(b.faces) for b in bodies]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.linalg.norm(cross, axis=1)
    if not np.isfinite(size).all():
        msg = "a mesh has vertices that are not finite"
        raise SceneError(msg, where="virtual robot")
    keep = size > 1e-14

    def per_face(values: list[float]) -> Float:
        return np.asarray(np.repeat(np.asarray(values, float), counts)[keep])

    return Soup(
        corners=np.ascontiguousarray(corners[keep]),
        normals=cross[keep] / size[keep, None],
        body=per_face([float(i) for i in range(len(bodies))]).astype(np.int32),
        albedo=per_face([b.albedo for b in bodies]),
        roughness=per_face([b.roughness for b in bodies]),
        subject=np.array([b.subject for b in bodies]) | (not any(b.subject for b in bodies)),
        names=tuple(b.name for b in bodies),
        extent=float(np.linalg.norm(np.ptp(corners[keep].reshape(-1, 3), axis=0))),
    )
