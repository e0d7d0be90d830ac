# SPDX-License-Identifier: Apache-2.0
"""A colour image at its pose in the cell, and its tones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tof_core import se3

if TYPE_CHECKING:
    from tof_core.arrays import Bytes, Float, Ints
    from tof_core.camera import Camera
    from tof_core.capture import Colour
    from tof_scene.raycast import Hits, Raycaster

GAMMA = 2.2
"""Exponent from grey values to linear brightness, close to sRGB."""
DARK = 0.003
"""Brightness, as a share of white, below which noise dominates the colour; added before the logarithm."""


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """A colour image at its pose in the cell.

    tones (h, w, 3): log brightness (mean of the channels), log red over green, log blue over green; NaN where saturated.
    Shading and shadow change the first; the two ratios hardly change.
    """

    camera: Camera
    T_cell_camera: Float
    tones: Float

    @classmethod
    def of(cls, colour: Colour | None, T_cell_depth: Float) -> Picture | None:
        """The picture of a colour image, from the pose of its depth image; None without image, calibration or TF."""
        if colour is None or colour.camera is None or colour.T_camera_colour is None:
            return None
        return cls(colour.camera, np.asarray(T_cell_depth @ colour.T_camera_colour), tones_of(colour.image))

    def look(self, caster: Raycaster, rows: Ints, cols: Ints) -> tuple[Hits, Float]:
        """Hits of the rays of pixels (n,), and the points hit (n, 3) in the cell."""
        T = self.T_cell_camera
        rays = self.camera.rays()[rows, cols] @ T[:3, :3].T
        hits = caster.cast(T[:3, 3], rays)
        return hits, T[:3, 3] + rays * hits.t[:, None]

    def recall(self, caster: Raycaster, points: Float) -> Float:
        """Tones (n, 3) of surface points (n, 3) in this image; NaN where they are not visible."""
        eye = self.T_cell_camera[:3, 3]
        uv = self.camera.project(se3.apply(se3.inverse(self.T_cell_camera), points))
        at = np.floor(np.nan_to_num(uv, nan=-9.0) + 0.5).astype(np.int64)
        seen = np.flatnonzero(((at >= 0) & (at < [self.camera.width, self.camera.height])).all(axis=1))
        way = points[seen] - eye
        near = caster.cast(eye, way).t > 1.0 - 0.003 / np.maximum(np.linalg.norm(way, axis=1), 0.1)
        clear = seen[near]
        out = np.full((len(points), 3), np.nan)
        out[clear] = self.tones[at[clear, 1], at[clear, 0]]
        return out


def tones_of(image: Bytes) -> Float:
    """Tones (h, w, 3) of an RGB image (h, w, 3), averaged over 3 x 3 pixels."""
    from scipy import ndimage

    linear = (image.astype(float) / 255.0) ** GAMMA
    mean = np.stack([ndimage.uniform_filter(linear[..., k], 3, mode="nearest") for k in range(3)], axis=-1)
    log = np.log(mean + DARK)
    tones = np.stack([log.mean(axis=-1), log[..., 0] - log[..., 1], log[..., 2] - log[..., 1]], axis=-1)
    saturated = np.asarray((image >= 252).any(axis=-1, keepdims=True))
    return np.asarray(np.where(saturated, np.nan, tones))
