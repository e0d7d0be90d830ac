# SPDX-License-Identifier: Apache-2.0
"""Radial distance in place of z, as some cameras store it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from tof_core.arrays import Image
    from tof_core.camera import Camera


def z_to_radial(camera: Camera, depth: Image) -> Image:
    """Distances along the rays (H, W) of z-depth (H, W), metres."""
    return (depth * camera.ray_length()).astype(np.float32)
