# SPDX-License-Identifier: Apache-2.0
"""What a camera at a pose would see of the scene: depth, part, normal, incidence, albedo, and where a pixel sees two surfaces."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from tof_core import se3

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from tof_core.arrays import Float, Image
    from tof_core.camera import Camera
    from tof_scene.raycast import Raycaster


@dataclass(frozen=True, slots=True, eq=False)
class Rendering:
    """One rendered view, all (H, W).

    depth float32 metres along z, NaN where nothing is hit: the mean over the surface that fills most of the pixel;
    part int16 and face int32, -1 for none; normal (H, W, 3) float32 unit, camera frame, toward the camera; incidence
    float32 radians between normal and ray; albedo float32, NaN for none; mixed float32 share of the second surface,
    0..0.5; second float32 its depth along z, NaN for none. Void beside a part is no second surface.
    """

    camera: Camera
    T_cell_camera: Float
    depth: Image
    part: NDArray[np.int16]
    face: NDArray[np.int32]
    normal: NDArray[np.float32]
    incidence: Image
    albedo: Image
    mixed: Image
    second: Image


def render(caster: Raycaster, camera: Camera, T_cell_camera: ArrayLike, *, footprints: bool = True, step: int = 1) -> Rendering:
    """Render one view.

    Args:
        caster: the scene.
        camera: the raster; with `step` every step-th row and column of it.
        T_cell_camera: (4, 4) pose of the camera's optical frame in the cell.
        footprints: average over what each pixel covers; False casts one ray through each centre.
        step: stride of the raster, only without footprints; `camera` of the result is the thinned one.
    """
    T = se3.as_se3("camera pose", T_cell_camera)
    if step > 1:
        camera = thinned(camera, step)
    return centres(caster, camera, T)


def thinned(camera: Camera, step: int) -> Camera:
    """The camera of every step-th row and column, the first ones included."""
    return replace(
        camera, width=-(-camera.width // step), height=-(-camera.height // step),
        fx=camera.fx / step, fy=camera.fy / step, cx=camera.cx / step, cy=camera.cy / step,
    )  # fmt: skip


def centres(caster: Raycaster, camera: Camera, T_cell_camera: Float) -> Rendering:
    """One ray through the centre of each pixel; rays have z = 1, so their length is the depth."""
    R = T_cell_camera[:3, :3]
    rays = camera.rays().reshape(-1, 3)
    hits = caster.cast(T_cell_camera[:3, 3], rays @ R.T)
    normal = hits.normal @ R
    shape = camera.shape
    void = np.full(shape, np.nan, np.float32)
    albedo = np.where(hits.part >= 0, caster.albedo[hits.part], np.float32(np.nan))
    cosine = -np.einsum("ij,ij->i", normal, rays) / camera.ray_length().ravel()
    return Rendering(
        camera, T_cell_camera,
        depth=hits.t.astype(np.float32).reshape(shape), part=hits.part.reshape(shape), face=hits.face.reshape(shape),
        normal=normal.astype(np.float32).reshape(*shape, 3),
        incidence=np.arccos(np.clip(cosine, -1.0, 1.0)).astype(np.float32).reshape(shape),
        albedo=albedo.reshape(shape), mixed=np.where(np.isnan(void), np.float32(0), void), second=void,
    )  # fmt: skip
