# SPDX-License-Identifier: Apache-2.0
"""The arrays of a view while it is being rendered, flat over pixels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tof_scene.rendering import Rendering
from tof_scene.shade import shade

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tof_core.arrays import Float, Image
    from tof_core.camera import Camera
    from tof_scene.raycast import Raycaster


@dataclass(frozen=True, slots=True, eq=False)
class Canvas:
    """The fields of `Rendering`, each (H*W, ...), filled in place."""

    face: NDArray[np.int32]
    depth: Image
    part: NDArray[np.int16]
    normal: NDArray[np.float32]
    incidence: Image
    albedo: Image
    mixed: Image
    second: Image

    @classmethod
    def blank(cls, pixels: int, face: NDArray[np.int32]) -> Canvas:
        """A canvas with the faces set and all other fields empty."""
        void = [np.full(pixels, np.nan, np.float32) for _ in range(4)]
        return cls(
            face, void[0], np.empty(pixels, np.int16), np.empty((pixels, 3), np.float32), void[1], void[2],
            np.zeros(pixels, np.float32), void[3],
        )  # fmt: skip

    def shade(self, caster: Raycaster, T: Float, pixels: NDArray[np.int64], rays: Float, turn: Float, near: NDArray[np.float32]) -> None:
        """Fill depth (where it is NaN), part, normal, incidence and albedo of `pixels` from their faces."""
        shade(
            pixels, rays, turn, self.face, near, caster.face_point, caster.face_normal, caster.face_part, caster.albedo, T,
            self.depth, self.part, self.normal, self.incidence, self.albedo,
        )  # fmt: skip

    def rendering(self, camera: Camera, T: Float) -> Rendering:
        """The arrays in the raster's shape."""
        depth, incidence, albedo, mixed, second = (
            a.reshape(camera.shape) for a in (self.depth, self.incidence, self.albedo, self.mixed, self.second)
        )
        part, face, normal = self.part.reshape(camera.shape), self.face.reshape(camera.shape), self.normal.reshape(*camera.shape, 3)
        return Rendering(camera, T, depth, part, face, normal, incidence, albedo, mixed, second)
