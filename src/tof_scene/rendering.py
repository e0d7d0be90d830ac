# SPDX-License-Identifier: Apache-2.0
"""One rendered view, as passed to the other rooms."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tof_core.arrays import Float, Image
    from tof_core.camera import Camera


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class Rendering:
    """One rendered view, all (H, W).

    depth float32 metres along z, NaN where nothing is hit: the mean over the surface that fills most of the pixel;
    part int16 and face int32, -1 for none; normal (H, W, 3) float32 unit, camera frame, toward the camera; incidence
    float32 radians between normal and ray; albedo float32, NaN for none; mixed float32 share of the second surface,
    0..0.5; second float32 its depth along z, NaN for none. Empty space beside a part does not count as a second surface.
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


def depth_only(camera: Camera, depth: Image) -> Rendering:
    """A rendering with depth (H, W) alone, from the origin of the cell: without parts, normals and second surfaces."""
    unknown = np.broadcast_to(np.float32(np.nan), camera.shape)
    part, face = np.broadcast_to(np.int16(-1), camera.shape), np.broadcast_to(np.int32(-1), camera.shape)
    normal = np.broadcast_to(np.float32(np.nan), (*camera.shape, 3))
    mixed = np.broadcast_to(np.float32(0), camera.shape)
    return Rendering(camera, np.eye(4), depth, part, face, normal, unknown, unknown, mixed, unknown)
