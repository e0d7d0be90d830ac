# SPDX-License-Identifier: Apache-2.0
"""The outline of each part alone, also beyond the image: the reference for its visibility."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from tof_core import se3

if TYPE_CHECKING:
    from tof_core.arrays import Float, Mask
    from tof_core.camera import Camera
    from tof_scene.raycast import Raycaster
    from tof_scene.scene import Scene


@dataclass(frozen=True, slots=True, eq=False)
class Silhouette:
    """A part seen alone.

    inside (H, W): its outline in the image; pixels: of the outline, with what lies outside the
    image; box: (x, y, width, height) of all of it, in pixels of the image.
    """

    inside: Mask
    pixels: int
    box: list[int]


class Silhouettes:
    """Casts each part alone; as BOP does, on a canvas of three times the image's size."""

    def __init__(self, scene: Scene, camera: Camera) -> None:
        self._scene, self._camera = scene, camera
        self._casters: dict[int, Raycaster] = {}

    def of(self, part: int, T_camera_cell: Float) -> Silhouette:
        """The silhouette of one part for one pose of the camera."""
        left, top, right, bottom = self._window(part, T_camera_cell)
        camera = self._camera
        inside = np.zeros(camera.shape, bool)
        if right <= left or bottom <= top:
            return Silhouette(inside, 0, [-1, -1, -1, -1])
        hit = self._cast(part, T_camera_cell, left, top, right, bottom)
        rows, columns = np.flatnonzero(hit.any(axis=1)), np.flatnonzero(hit.any(axis=0))
        if not len(rows):
            return Silhouette(inside, 0, [-1, -1, -1, -1])
        v, u = np.nonzero(hit)
        v, u = v + top, u + left
        seen = (v >= 0) & (v < camera.height) & (u >= 0) & (u < camera.width)
        inside[v[seen], u[seen]] = True
        box = [left + int(columns[0]), top + int(rows[0]), int(columns[-1] - columns[0] + 1), int(rows[-1] - rows[0] + 1)]
        return Silhouette(inside, len(v), box)

    def _window(self, part: int, T_camera_cell: Float) -> tuple[int, int, int, int]:
        """Pixels of the canvas that may see the part; all of it where the part reaches behind the camera."""
        w, h = self._camera.width, self._camera.height
        points = se3.apply(T_camera_cell, self._scene.parts[part].vertices)
        if (points[:, 2] <= 0).all():
            return 0, 0, 0, 0
        if (points[:, 2] <= 1e-3).any():
            return -w, -h, 2 * w, 2 * h
        uv = self._camera.project(points)
        left, top = (np.floor(uv.min(axis=0)).astype(int) - 1).tolist()
        right, bottom = (np.ceil(uv.max(axis=0)).astype(int) + 2).tolist()
        return max(left, -w), max(top, -h), min(right, 2 * w), min(bottom, 2 * h)

    def _cast(self, part: int, T_camera_cell: Float, left: int, top: int, right: int, bottom: int) -> Mask:
        v, u = np.mgrid[top:bottom, left:right]
        T_cell_camera = se3.inverse(T_camera_cell)
        directions = self._camera.rays_at(np.stack([u, v], axis=-1)).reshape(-1, 3) @ T_cell_camera[:3, :3].T
        origins = np.broadcast_to(T_cell_camera[:3, 3], directions.shape)
        hits = self._caster(part).cast(origins, directions)
        return np.asarray(np.isfinite(hits.t).reshape(bottom - top, right - left))

    def _caster(self, part: int) -> Raycaster:
        from tof_scene.raycast import Raycaster

        if part not in self._casters:
            alone = replace(self._scene, parts=(self._scene.parts[part],))
            self._casters[part] = Raycaster(alone)
        return self._casters[part]
