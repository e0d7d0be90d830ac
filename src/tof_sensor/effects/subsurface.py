# SPDX-License-Identifier: Apache-2.0
"""Subsurface scattering: a translucent part returns light from below its surface."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from tof_core.config import param
from tof_sensor.action import ASIDE
from tof_sensor.effect import Effect, Form, stack

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tof_core.arrays import Float
    from tof_sensor.frame import Frame
    from tof_sensor.session import Session


@dataclass(frozen=True, slots=True)
class Subsurface(Effect):
    """dr = delay + aslant (1 - cos(incidence)), over one material (docs/effects.md).

    A slab is longer aslant, a scattering medium lets light out sooner: the sign of `aslant_m` is the material's.
    """

    NAME: ClassVar[str] = "subsurface"
    ORDER: ClassVar[int] = 32
    UNEVEN: ClassVar[float] = 0.15  # Of the scene: how deep light goes differs over a part.
    MEANING: ClassVar[str] = "light enters a translucent part and returns late"
    REMEDY: ClassVar[str] = "spray the part matt, or mask it: light does not return from its surface"
    SEPARATED_BY: ClassVar[str] = "the part sprayed matt"
    ACTIONS: ClassVar = (ASIDE,)
    MODULATED: ClassVar[bool] = True
    LINEAR: ClassVar[tuple[str, ...]] = ("delay_m", "aslant_m")

    delay_m: float = param(0.0, "added along the ray at normal incidence", unit="m", low=0.0, high=0.1)
    aslant_m: float = param(0.0, "added besides at grazing incidence", unit="m", low=-0.1, high=0.1)
    part: int = param(0, "index of the part in the scene", low=0)

    @property
    def needs_scene(self) -> bool:
        """Its part."""
        return True

    def columns(self, frame: Frame) -> Float:
        """One, and how far the incidence is from normal, on the pixels of the part."""
        here = frame.rendering.part == self.part
        aslant = 1 - np.cos(np.nan_to_num(frame.rendering.incidence))
        return stack([np.where(here, x, 0.0) / frame.length for x in (np.ones_like(aslant), aslant)], frame)

    @classmethod
    def hypotheses(cls, session: Session) -> Iterator[Form]:
        """One form for each part that enough pixels see."""
        for part, name in session.parts_seen():
            yield Form(cls(part=part), name)
