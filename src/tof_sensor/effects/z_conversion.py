# SPDX-License-Identifier: Apache-2.0
"""Conversion to depth: the driver divides distance by a table of ray lengths with reversed rows or columns."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from tof_core.config import param
from tof_sensor.action import ASIDE, FARTHER, NEARER
from tof_sensor.effect import Effect

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_core.camera import Camera
    from tof_sensor.frame import Frame
    from tof_sensor.session import Session

REVERSED: dict[str, tuple[int, ...]] = {"stated": (), "rows": (0,), "columns": (1,), "both": (0, 1)}
"""Axes of the image along which a table is reversed."""


@dataclass(frozen=True, slots=True)
class ZConversion(Effect):
    """z' = r / l', where l' is the table of ray lengths l with its rows or columns reversed: z' / z = l / l' (docs/effects.md).

    The rays are those of CameraInfo; only the table is wrong. The effect is present or absent, and has no size to fit.
    """

    NAME: ClassVar[str] = "z_conversion"
    ORDER: ClassVar[int] = 83
    MEANING: ClassVar[str] = "the driver converts distance to depth with a table that is upside down or mirrored"
    REMEDY: ClassVar[str] = "let the driver flip its table of ray lengths with the image, or convert distance to depth by camera_info"
    SEPARATED_BY: ClassVar[str] = "a flat board in several parts of the image"
    ACTIONS: ClassVar = (ASIDE, NEARER, FARTHER)
    LOCAL: ClassVar[bool] = False

    table: str = param("stated", "reversed axes of the table of ray lengths", choices=tuple(REVERSED))

    @property
    def stated(self) -> str:
        """The reversed axes."""
        return {"stated": "", "both": "rows and columns run the wrong way"}.get(self.table, f"{self.table} run the wrong way")

    def published(self, stated: Camera) -> Float:
        """(H, W) ratio of the ray's length to that of its mirror image; 1 where the lens model has no ray."""
        return _ratio(stated, self.table)

    def bias(self, frame: Frame) -> Float:
        """Depth times (ratio - 1)."""
        return np.nan_to_num(frame.depth * (self.published(frame.camera) - 1.0))

    @classmethod
    def lacks(cls, session: Session) -> str:
        """Poses that are independent of depth: the effect is tested before depth is fitted."""
        return "" if session.posed_apart else "poses are fitted to depth and absorb its tilt: record a checkerboard (toftwin gap --board)"


@lru_cache(maxsize=8)
def _ratio(camera: Camera, table: str) -> Float:
    length = camera.ray_length().astype(np.float64)
    ratio = length / np.flip(length, REVERSED[table])
    return np.where(np.isfinite(ratio), ratio, 1.0)
