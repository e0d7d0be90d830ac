# SPDX-License-Identifier: Apache-2.0
"""Radial depth: the camera writes distance along the ray, not z."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from tof_core.config import param
from tof_sensor.action import FARTHER, NEARER
from tof_sensor.effect import Effect, Form, stack

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tof_core.arrays import Float
    from tof_sensor.frame import Frame
    from tof_sensor.session import Session


@dataclass(frozen=True, slots=True)
class RadialDepth(Effect):
    """dz = share (r - z); a share of 1 is a camera that writes r (docs/effects.md)."""

    NAME: ClassVar[str] = "radial_depth"
    ORDER: ClassVar[int] = 84
    MEANING: ClassVar[str] = "the camera gives distance along the ray, not depth"
    REMEDY: ClassVar[str] = "let the driver publish depth along the optical axis (REP 118)"
    SEPARATED_BY: ClassVar[str] = "a flat wall that fills the image"
    ACTIONS: ClassVar = (NEARER, FARTHER)
    LINEAR: ClassVar[tuple[str, ...]] = ("share",)

    share: float = param(0.0, "1: radial given as z", low=-1.5, high=1.5)

    def columns(self, frame: Frame) -> Float:
        """Radial minus z."""
        return stack([frame.radial - frame.depth], frame)

    @classmethod
    def hypotheses(cls, session: Session) -> Iterator[Form]:
        """Its one form."""
        del session
        yield Form(cls())
