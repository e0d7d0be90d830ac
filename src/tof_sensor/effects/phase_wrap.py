# SPDX-License-Identifier: Apache-2.0
"""Phase wrap: range is short by whole periods beyond the unambiguous range, or after a wrong unwrapping."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from tof_core.config import param
from tof_core.shares import in_percent
from tof_sensor.effect import Effect
from tof_sensor.frame import LIGHT_M_PER_S

if TYPE_CHECKING:
    from tof_core.arrays import Float, Mask
    from tof_sensor.frame import Frame
    from tof_sensor.session import Session

SINGLE_PIXELS = 0.5
"""Share of the pixels at a range below which wrapped pixels count as single ones, whose unwrapping failed."""

NEAR_TURN = 0.9
"""Share of the unambiguous range from which noise, and a wrong place of the base, may take a range beyond it."""


@dataclass(frozen=True, slots=True)
class PhaseWrap(Effect):
    """d' = d - k c0 / 2f (docs/effects.md), from `start_m` on, for a `share` of the pixels.

    A wrong unwrapping of several frequencies shifts range by combinations of their periods: `others_m` are such jumps in metres,
    `others_share` their shares of the wrapped pixels.
    """

    NAME: ClassVar[str] = "phase_wrap"
    ORDER: ClassVar[int] = 78
    MEANING: ClassVar[str] = (
        "range jumps by a fixed step: beyond the camera's unambiguous range, or where the camera combines its measurements wrongly"
    )
    REMEDY: ClassVar[str] = (
        "keep within the range that the data sheet calls unambiguous, or choose a mode with a longer one; where single pixels jump, expose longer"
    )
    MODULATED: ClassVar[bool] = True

    modulation_mhz: float = param(100.0, "frequency whose periods are miscounted", unit="MHz", low=1.0, high=400.0)
    start_m: float = param(1.5, "range from which the phase wraps (negative: range up to which pixels are too far)", unit="m")
    share: float = param(0.0, "share of those pixels that wrap", low=0.0, high=1.0)
    others_m: tuple[float, ...] = ()
    others_share: tuple[float, ...] = ()

    @property
    def stated(self) -> str:
        """Jumps, and share of the pixels."""
        jumps = [f"{jump:.2f}" for jump in (self.turn_m, *self.others_m)]
        listed = f"{', '.join(jumps[:-1])} or {jumps[-1]}" if self.others_m else jumps[0]
        return f"off by {listed} m, {in_percent(self.share)} of the pixels at those ranges"

    @property
    def turn_m(self) -> float:
        """Range of one period, metres."""
        return LIGHT_M_PER_S / (2e6 * self.modulation_mhz)

    @classmethod
    def lacks(cls, session: Session) -> str:
        """Surfaces near the unambiguous range, where one frequency is stated: there is nothing to merge wrongly, and no phase wraps nearer."""
        if len(session.stated_mhz) != 1:
            return ""
        farthest, turn = session.farthest_m, cls(modulation_mhz=session.stated_mhz[0]).turn_m
        if farthest > NEAR_TURN * turn:
            return ""
        return f"the only modulation frequency that is stated repeats after {turn:.1f} m, and the farthest surface lies at {farthest:.1f} m"

    @property
    def makes_outliers(self) -> bool:
        """Whether single pixels wrap, because two frequencies disagree, and not all pixels beyond a range."""
        return self.share < SINGLE_PIXELS

    def bias(self, frame: Frame) -> Float:
        """Shift of the median pixel: one period where most pixels wrap, otherwise none."""
        if self.share < SINGLE_PIXELS:
            return np.zeros(frame.depth.shape)
        sign = -1.0 if self.start_m > 0 else 1.0
        return np.where(self.beyond(frame), sign * self.turn_m / frame.length, 0.0)

    def beyond(self, frame: Frame) -> Mask:
        """(H, W) pixels of the CAD at the ranges at which a `share` wraps."""
        return frame.valid & (frame.radial > self.start_m if self.start_m > 0 else frame.radial < -self.start_m)

    def apply(self, frame: Frame, rng: np.random.Generator) -> Frame:
        """Shift randomly chosen pixels by one of the jumps."""
        whole = replace(self, share=1.0).bias(frame)
        wraps = rng.random(frame.depth.shape) < self.share
        if self.others_m:
            first = max(1.0 - sum(self.others_share), 0.0)
            shares = np.array([first, *self.others_share])
            jumps = np.array([self.turn_m, *self.others_m]) / self.turn_m
            whole = whole * rng.choice(jumps, p=shares / shares.sum(), size=frame.depth.shape)
        return replace(frame, depth=frame.depth + whole * wraps)
