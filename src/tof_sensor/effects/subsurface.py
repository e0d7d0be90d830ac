# SPDX-License-Identifier: Apache-2.0
"""Subsurface scattering: light returns from below the surface of a translucent part."""

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

    At oblique incidence the path in a slab is longer, but light leaves a scattering medium sooner: the sign of `aslant_m` depends on the material.
    """

    NAME: ClassVar[str] = "subsurface"
    ORDER: ClassVar[int] = 32
    REPEATS: ClassVar[bool] = True
    UNEVEN: ClassVar[float] = 0.15  # Of the scene: the depth of penetration varies over a part.
    MEANING: ClassVar[str] = "light enters a translucent part and returns late"
    REMEDY: ClassVar[str] = "spray the part matt, or mask it: light does not return from its surface"
    SEPARATED_BY: ClassVar[str] = "the part sprayed matt"
    ACTIONS: ClassVar = (ASIDE,)
    MODULATED: ClassVar[bool] = True
    LINEAR: ClassVar[tuple[str, ...]] = ("delay_m", "aslant_m")

    delay_m: float = param(0.0, "added along the ray at normal incidence", unit="m", low=0.0, high=0.1)
    aslant_m: float = param(0.0, "added in addition at grazing incidence", unit="m", low=-0.1, high=0.1)
    part: int = param(0, "index of the part in the scene", low=0)

    @property
    def needs_scene(self) -> bool:
        """Yes: its part."""
        return True

    def columns(self, frame: Frame) -> Float:
        """A constant, and one minus the cosine of incidence, on the pixels of the part."""
        here = frame.rendering.part == self.part
        aslant = 1 - np.cos(np.nan_to_num(frame.rendering.incidence))
        return stack([np.where(here, x, 0.0) / frame.length for x in (np.ones_like(aslant), aslant)], frame)

    @classmethod
    def hypotheses(cls, session: Session) -> Iterator[Form]:
        """One form for each part with enough pixels."""
        for part, name in session.parts_seen():
            yield Form(cls(part=part), name)
