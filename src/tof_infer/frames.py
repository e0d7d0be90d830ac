# SPDX-License-Identifier: Apache-2.0
"""Inputs and outputs of the network: unit rays, padding, and the marks of a corrected frame."""

from __future__ import annotations

from enum import IntEnum
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from tof_core.arrays import Image
    from tof_core.camera import Camera


class Mark(IntEnum):
    """Result of a pixel."""

    REPAIRED = 0
    RAW_KEPT = 1
    """The network's sigma is too large: the raw depth is kept."""
    INVALID = 2
    """There was no depth."""


def unit_rays(camera: Camera) -> Image:
    """(3, H, W) unit directions of the pixels; the optical axis where the lens model has no ray.

    A single NaN would reach every pixel of the network's coarse levels.
    """
    rays = camera.rays()
    rays = np.where(np.isfinite(rays), rays, (0.0, 0.0, 1.0))
    return np.ascontiguousarray((rays / np.linalg.norm(rays, axis=-1, keepdims=True)).transpose(2, 0, 1), np.float32)


def padded_size(shape: tuple[int, int], multiple: int) -> tuple[int, int]:
    """Height and width padded to the next multiple, below and to the right."""
    return -(-shape[0] // multiple) * multiple, -(-shape[1] // multiple) * multiple
