# SPDX-License-Identifier: Apache-2.0
"""Multipath: light reflected by other surfaces arrives late, so that concave corners are measured too far."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from tof_core.config import param
from tof_sensor.action import ASIDE, FARTHER, NEARER
from tof_sensor.effect import Effect, Finer, Form, stack
from tof_sensor.frame import MODULATION, indirect_bias, waves_per_m
from tof_sensor.interreflection import indirect_phasor

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tof_core.arrays import Float, Ints
    from tof_sensor.frame import Frame
    from tof_sensor.session import Session


@dataclass(frozen=True, slots=True)
class Multipath(Effect):
    """dr = c0 / (4 pi f) arg(1 + sum r_k e^{j dphi_k}), r_k from the CAD (docs/effects.md).

    `strength` 1 is that of matt surfaces with the albedo estimated from the session's amplitude, or the scene's without amplitude. It is
    lower if the camera corrects part of the effect, higher if the parts are brighter.
    """

    NAME: ClassVar[str] = "multipath"
    ORDER: ClassVar[int] = 36
    UNEVEN: ClassVar[float] = 0.15  # Of the scene: patches and albedos are coarse, and each view uses others of them.
    MEANING: ClassVar[str] = "light bounces between surfaces before it returns; inner corners are measured too far"
    REMEDY: ClassVar[str] = "mask inner corners, spray the bright neighbour matt, or choose viewpoints from which it lies out of sight"
    SEPARATED_BY: ClassVar[str] = "the same view with the neighbouring surface covered"
    ACTIONS: ClassVar = (ASIDE, NEARER, FARTHER)
    MODULATED: ClassVar[bool] = True
    FINER: ClassVar[tuple[Finer, ...]] = (Finer("modulation_mhz", 0.3),)
    LOCAL: ClassVar[bool] = False
    LINEAR: ClassVar[tuple[str, ...]] = ("strength",)
    ROUGH: ClassVar[float] = 0.06  # Patches are coarse beside the niches of a part: twice as many explain a few per cent more.
    # Compared with a path tracer: squared error of the map, relative to the mean light of a part; 90 % quantile of 24 parts in three scenes.
    # The largest is 0.4. Poses absorb what parts have in common: a part moves only if that explains more than any error of the map.
    LACKS: ClassVar[float] = 0.12
    LACKS_ON_A_PART: ClassVar[float] = 1.0

    strength: float = param(0.0, "relative to Lambertian surfaces of the albedo estimated from amplitude", low=0.0, high=5.0)
    modulation_mhz: float = param(60.0, f"{MODULATION} (weak influence)", unit="MHz", low=5.0, high=400.0)

    @property
    def needs_scene(self) -> bool:
        """Yes: the surfaces between which light is reflected."""
        return True

    def columns(self, frame: Frame) -> Float:
        """The bias at strength 1, along z."""
        return stack([indirect_bias(indirect_phasor(frame, self._waves), self._waves) / frame.length], frame)

    def columns_at(self, frame: Frame, pixels: Ints) -> Float:
        """`columns` at chosen pixels; the light at other pixels is not computed."""
        bias = indirect_bias(indirect_phasor(frame, self._waves, pixels), self._waves)
        return np.asarray(np.nan_to_num(bias / frame.length.ravel()[pixels])[:, None])

    @property
    def _waves(self) -> float:
        return waves_per_m(self.modulation_mhz)

    @classmethod
    def hypotheses(cls, session: Session) -> Iterator[Form]:
        """Two frequencies, on which the bias hardly depends, and one at which only light of short detours counts, as with a short pulse; or the stated ones."""
        for mhz in session.frequencies(30.0, 90.0, SHORT_PULSE_MHZ):
            yield Form(cls(modulation_mhz=mhz), f"{mhz:g} MHz")


SHORT_PULSE_MHZ = 300.0
"""A camera that looks for the peak of a pulse of half a nanosecond takes in light that comes at most 0.25 m later: half of this wave."""
