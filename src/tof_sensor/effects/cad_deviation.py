# SPDX-License-Identifier: Apache-2.0
"""CAD deviation: a part stands or bends otherwise than drawn, the same in every view."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from tof_core.config import param
from tof_sensor.effect import FieldEffect
from tof_sensor.geometry import cell_points, object_columns

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_sensor.frame import Frame

RIGID, BOW = 6, 3


@dataclass(frozen=True, slots=True)
class CadDeviation(FieldEffect):
    """Rigid motion plus bow of one part (DESIGN section 3; TOF_EFFECTS A.20, A.21).

    `values`: translation (3) m, rotation about `centre` (3) rad, then bow (3) in metres at one
    half-size from the centre: u^2, v^2 and u v along `normal`, u and v across it. Cell frame.
    """

    NAME: ClassVar[str] = "cad_deviation"

    values: tuple[float, ...] = (0.0,) * (RIGID + BOW)
    part: int = param(0, "index of the part in the scene", low=0)
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)
    normal: tuple[float, float, float] = (0.0, 0.0, 1.0)
    half_size_m: float = param(0.1, "half of the part's largest side", unit="m", low=1e-4)

    def columns(self, frame: Frame) -> Float:
        """z by each of the nine values, on the pixels of the part."""
        here = frame.rendering.part == self.part
        arm = np.where(here[..., None], np.nan_to_num(cell_points(frame)) - self.centre, 0.0)
        n = np.asarray(self.normal, float) / np.linalg.norm(self.normal)
        u_axis = np.cross(n, np.eye(3)[np.argmin(np.abs(n))])
        u_axis /= np.linalg.norm(u_axis)
        u, v = arm @ u_axis / self.half_size_m, arm @ np.cross(n, u_axis) / self.half_size_m
        shape = (*frame.depth.shape, 3, RIGID + BOW)
        motion = np.zeros(shape)
        motion[..., :3] = np.eye(3)
        for k, axis in enumerate(np.eye(3)):
            motion[..., 3 + k] = np.cross(axis, arm)
        for k, field in enumerate((u * u, v * v, u * v)):
            motion[..., RIGID + k] = field[..., None] * n
        return np.where(here[..., None], object_columns(frame, motion), 0.0)
