# SPDX-License-Identifier: Apache-2.0
"""A glossy coat: its lobe biases depth near the mirror direction, and it reflects other surfaces."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from tof_core.config import param
from tof_sensor.action import ASIDE, FARTHER, NEARER
from tof_sensor.effect import Effect, Finer, Form
from tof_sensor.frame import MODULATION, indirect_bias, once_per_frame, waves_per_m
from tof_sensor.mirrored import mirrored_light

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tof_core.arrays import Float
    from tof_sensor.frame import Frame
    from tof_sensor.session import Session


@dataclass(frozen=True, slots=True)
class Specular(Effect):
    """dr = b S / (S + M) + c0 / (4 pi f) arg(1 + coat m e^{j dphi}): reflection of the lamp, and of other surfaces (docs/effects.md).

    The lobe S of the coat and the matt light M = albedo cos(incidence) add up in a pixel. S = gloss exp(-(tan(incidence) / tan(lobe))^2)
    (Beckmann): lamp and camera are together, so that the mirror direction is the normal. m is the light of other surfaces reflected by a
    lacquer on `part`, divided by M; a coat on all parts (-1) has no m, since the reflected surfaces would be glossy, too.
    """

    NAME: ClassVar[str] = "specular"
    ORDER: ClassVar[int] = 38
    REPEATS: ClassVar[bool] = True
    UNEVEN: ClassVar[float] = 0.15  # Of the scene: gloss depends on facets that the CAD lacks.
    # A coat mirrors surfaces whose light is hardly known: on a lacquered part in its place, a displacement wins 0.2 of the coat's own map.
    LACKS_ON_A_PART: ClassVar[float] = 0.3
    MEANING: ClassVar[str] = "shiny surfaces are measured wrongly: their highlights, and where they mirror another surface"
    REMEDY: ClassVar[str] = "spray the part matt, look at it from another direction, or mask its highlights"
    SEPARATED_BY: ClassVar[str] = "the part sprayed matt"
    ACTIONS: ClassVar = (ASIDE, NEARER, FARTHER)
    MODULATED: ClassVar[bool] = True
    FINER: ClassVar[tuple[Finer, ...]] = (
        Finer("lobe_deg", 0.3),
        Finer("gloss", 0.7),
        Finer("lobe_deg", 0.15),
        Finer("gloss", 0.4),
        Finer("modulation_mhz", 0.3),
    )
    LINEAR: ClassVar[tuple[str, ...]] = ("bias_m", "coat")

    bias_m: float = param(0.0, "bias of the coat's own light", unit="m", low=-0.2, high=0.2)
    coat: float = param(0.0, "light reflected by the part, relative to a lacquer of refractive index 1.5", low=0.0, high=25.0)
    lobe_deg: float = param(12.0, "angle at which the lobe falls to 1/e", unit="deg", low=0.5, high=60.0)
    gloss: float = param(0.5, "the lobe's peak, as an albedo", low=1e-3, high=100.0)
    part: int = param(-1, "index of the shining part, -1: all", low=-1)
    modulation_mhz: float = param(60.0, f"{MODULATION} (weak influence)", unit="MHz", low=5.0, high=400.0)

    @property
    def needs_scene(self) -> bool:
        """Whether the coat is on one part."""
        return self.part >= 0

    def occurs_beside(self, other: Effect) -> bool:
        """Whether both are coats, each of a part of its own."""
        return isinstance(other, Specular) and self.part != other.part and min(self.part, other.part) >= 0

    def columns(self, frame: Frame) -> Float:
        """The coat's share of the light, and the bias by light reflected by a lacquer, along z; both are 0 off the part."""
        steepness2, matt = (image.ravel() for image in _surface(frame))
        here = frame.valid & (frame.rendering.part == self.part) if self.part >= 0 else frame.valid
        at, length, waves = np.flatnonzero(here), frame.length.ravel(), waves_per_m(self.modulation_mhz)
        coat = self.gloss * np.exp(-steepness2[at] / np.tan(np.radians(self.lobe_deg)) ** 2)
        mirrored = mirrored_light(frame, self.part)
        out = np.zeros((frame.depth.size, 2))
        out[at, 0] = coat / (coat + matt[at]) / length[at]
        out[mirrored.pixels, 1] = indirect_bias(mirrored.phasor(waves), waves) / length[mirrored.pixels]
        return out.reshape(*frame.depth.shape, 2)

    @classmethod
    def hypotheses(cls, session: Session) -> Iterator[Form]:
        """Widths and peaks of the lobe on all parts, from silk to mirror; and a lacquer on each part."""
        for lobe in (5.0, 10.0, 16.0, 24.0, 34.0):
            for gloss in (0.05, 0.3, 1.5):
                yield Form(cls(lobe_deg=lobe, gloss=gloss), f"lobe {lobe:g} deg, gloss {gloss:g}")
        for part, name in session.parts_seen():
            for mhz in session.frequencies(50.0, 100.0, 190.0):
                yield Form(cls(part=part, modulation_mhz=mhz), f"{name} is lacquered, {mhz:g} MHz")


@once_per_frame
def _surface(frame: Frame) -> tuple[Float, Float]:
    """(H, W), (H, W) squared tangent of the incidence, and matt light: albedo times its cosine."""
    incidence = np.minimum(np.nan_to_num(frame.rendering.incidence.astype(np.float64), nan=1.5), 1.5)
    matt = np.maximum(np.nan_to_num(frame.rendering.albedo.astype(np.float64)) * np.cos(incidence), 1e-6)
    return np.tan(incidence) ** 2, matt
