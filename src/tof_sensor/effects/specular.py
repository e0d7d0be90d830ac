# SPDX-License-Identifier: Apache-2.0
"""Specular highlight: near the mirror direction the lobe biases and saturates."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from tof_core.config import param
from tof_sensor.action import ASIDE, FARTHER, NEARER
from tof_sensor.effect import Effect, Finer, Form, stack

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tof_core.arrays import Float
    from tof_sensor.frame import Frame
    from tof_sensor.session import Session


@dataclass(frozen=True, slots=True)
class Specular(Effect):
    """dr = b S / (S + M): the coat's lobe S and the matt light M = albedo cos(incidence) share the pixel.

    S = gloss exp(-(tan(incidence) / tan(lobe))^2) (Beckmann): light and camera sit together, so the
    mirror direction is the normal's (docs/effects.md).
    """

    NAME: ClassVar[str] = "specular"
    ORDER: ClassVar[int] = 38
    MEANING: ClassVar[str] = "highlights of shiny surfaces are measured wrongly"
    REMEDY: ClassVar[str] = "spray the part matt, look at it from another direction, or mask its highlights"
    SEPARATED_BY: ClassVar[str] = "the part sprayed matt"
    ACTIONS: ClassVar = (ASIDE, NEARER, FARTHER)
    MODULATED: ClassVar[bool] = True
    FINER: ClassVar[tuple[Finer, ...]] = (Finer("lobe_deg", 0.3), Finer("gloss", 0.7), Finer("lobe_deg", 0.15), Finer("gloss", 0.4))
    LINEAR: ClassVar[tuple[str, ...]] = ("bias_m",)

    bias_m: float = param(0.0, "bias of the coat's own light", unit="m", low=-0.2, high=0.2)
    lobe_deg: float = param(12.0, "angle at which the lobe falls to 1/e", unit="deg", low=0.5, high=60.0)
    gloss: float = param(0.5, "the lobe's peak, as an albedo", low=1e-3, high=100.0)
    part: int = param(-1, "index of the shining part, -1: all", low=-1)

    @property
    def needs_scene(self) -> bool:
        """Its part, unless it is on all."""
        return self.part >= 0

    def columns(self, frame: Frame) -> Float:
        """The coat's share of the light, along z."""
        incidence = np.minimum(np.nan_to_num(frame.rendering.incidence.astype(np.float64), nan=1.5), 1.5)
        coat = self.gloss * np.exp(-((np.tan(incidence) / np.tan(np.radians(self.lobe_deg))) ** 2))
        matt = np.maximum(np.nan_to_num(frame.rendering.albedo.astype(np.float64)) * np.cos(incidence), 1e-6)
        here = frame.valid & ((frame.rendering.part == self.part) | (self.part < 0))
        return stack([np.where(here, coat / (coat + matt), 0.0) / frame.length], frame)

    @classmethod
    def hypotheses(cls, session: Session) -> Iterator[Form]:
        """Widths of the lobe and sizes of its peak, coats from silk to mirror."""
        del session
        for lobe in (5.0, 10.0, 16.0, 24.0, 34.0):
            for gloss in (0.05, 0.3, 1.5):
                yield Form(cls(lobe_deg=lobe, gloss=gloss), f"lobe {lobe:g} deg, gloss {gloss:g}")
