# SPDX-License-Identifier: Apache-2.0
"""Radial depth: the camera gives distance along the ray, not z."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from tof_core.config import param
from tof_sensor.action import FARTHER, NEARER
from tof_sensor.effect import Effect, stack

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_sensor.frame import Frame


@dataclass(frozen=True, slots=True)
class RadialDepth(Effect):
    """dz = share (r - z); with share 1 the camera gives r (docs/effects.md)."""

    NAME: ClassVar[str] = "radial_depth"
    ORDER: ClassVar[int] = 84
    MEANING: ClassVar[str] = "the camera gives distance along the ray, not depth"
    REMEDY: ClassVar[str] = "let the driver publish depth along the optical axis (REP 118)"
    SEPARATED_BY: ClassVar[str] = "a flat wall that fills the image"
    ACTIONS: ClassVar = (NEARER, FARTHER)
    ONE_FORM: ClassVar[bool] = True
    LINEAR: ClassVar[tuple[str, ...]] = ("share",)

    share: float = param(0.0, "1: radial given as z", low=-1.5, high=1.5)

    def columns(self, frame: Frame) -> Float:
        """Radial minus z."""
        return stack([frame.radial - frame.depth], frame)
