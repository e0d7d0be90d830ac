# SPDX-License-Identifier: Apache-2.0
"""Fitted planes and spheres as meshes and a scene.yaml, in the frame of the camera that measured them."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.primitives import Plane, Sphere

if TYPE_CHECKING:
    from collections.abc import Sequence

    from benchmarks.primitives import Fitted
    from tof_core.arrays import Float, Ints, Mask
    from tof_core.camera import Camera
    from tof_scene.scene import Scene

CELL = 3
"""Raster points along one side of a patch of a plane's mesh."""


def mesh(fitted: Fitted, camera: Camera, stride: int) -> tuple[Float, Ints]:
    """Vertices (n, 3) and faces (m, 3) of a fitted surface: the measured region of a plane, the whole of a sphere."""
    surface = fitted.surface
    if isinstance(surface, Sphere):
        import trimesh

        ball = trimesh.creation.icosphere(subdivisions=5, radius=surface.radius)
        return np.asarray(ball.vertices) + surface.centre, np.asarray(ball.faces)
    return plane_mesh(surface, fitted.pixels, camera, stride)


def plane_mesh(plane: Plane, pixels: Mask, camera: Camera, stride: int) -> tuple[Float, Ints]:
    """Quads of CELL raster points a side, split in two, where most of the points are the plane's."""
    rows, columns = pixels.shape[0] // CELL, pixels.shape[1] // CELL
    share = pixels[: rows * CELL, : columns * CELL].reshape(rows, CELL, columns, CELL).mean(axis=(1, 3))
    v, u = np.nonzero(share > 0.5)
    corner = np.arange((rows + 1) * (columns + 1)).reshape(rows + 1, columns + 1)
    a, b, c, d = corner[v, u], corner[v, u + 1], corner[v + 1, u + 1], corner[v + 1, u]
    faces = np.concatenate([np.stack([a, d, c], axis=-1), np.stack([a, c, b], axis=-1)])
    used, faces = np.unique(faces, return_inverse=True)
    at = np.stack(np.divmod(used, columns + 1)[::-1], axis=-1) * (CELL * stride) - 0.5 * stride
    rays = camera.rays_at(at)
    return rays * (plane.offset / (rays @ plane.normal))[:, None], faces.reshape(-1, 3)


def primitive_scene(found: Sequence[Fitted], camera: Camera, stride: int, frame: str = "cell") -> Scene:
    """The fitted surfaces as a scene whose cell frame is the frame of the camera that measured them.

    A part's `tolerance_mm` is three times the RMS at which its surface was fitted.
    """
    from tof_scene.scene import Part, Scene

    count: Counter[str] = Counter()
    parts = []
    for fitted in found:
        kind = type(fitted.surface).__name__.lower()
        count[kind] += 1
        vertices, faces = mesh(fitted, camera, stride)
        parts.append(Part(f"{kind}_{count[kind]}", vertices, np.asarray(faces, np.int32), tolerance_mm=3e3 * fitted.rms))
    return Scene(frame, tuple(parts))
