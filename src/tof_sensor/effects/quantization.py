# SPDX-License-Identifier: Apache-2.0
"""Quantization: depth comes in steps."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from tof_core.config import param
from tof_sensor.effect import Effect, Evidence

if TYPE_CHECKING:
    from tof_sensor.frame import Frame

SAME_STEP = 0.05
"""Difference of two steps of the depth code, as a share, up to which they are one."""


@dataclass(frozen=True, slots=True)
class Quantization(Effect):
    """Rounding of depth, or of the range along the ray, to multiples of `step_m` (1 mm: Azure Kinect; docs/effects.md)."""

    NAME: ClassVar[str] = "quantization"
    ORDER: ClassVar[int] = 86
    MEANING: ClassVar[str] = "depth comes in coarse steps"
    REMEDY: ClassVar[str] = "publish depth in finer steps"
    EVIDENCE: ClassVar[Evidence] = Evidence.NOISE

    step_m: float = param(0.0, "step of the depth code", unit="m", low=0.0, high=0.1)
    along_ray: bool = param(False, "whether the range along the ray has steps, and not depth along z")

    @property
    def stated(self) -> str:
        """The step."""
        return f"steps of {1e3 * self.step_m:.1f} mm" + (" along the ray" if self.along_ray else "")

    def apply(self, frame: Frame, rng: np.random.Generator) -> Frame:
        """Round depth or range to the step."""
        del rng
        if self.step_m <= 0:
            return frame
        step = self.step_m / frame.length if self.along_ray else self.step_m
        depth = np.round(frame.depth / step) * step
        return replace(frame, depth=depth, sigma=np.hypot(frame.sigma, self.step_m / np.sqrt(12)))

    @property
    def constant_variance(self) -> float:
        """Variance of rounding: a twelfth of the squared step (Widrow 1956)."""
        return self.step_m**2 / 12

    def includes(self, other: Effect) -> bool:
        """Whether the other step is the same."""
        if not isinstance(other, Quantization):
            return False
        return other.along_ray == self.along_ray and abs(other.step_m - self.step_m) <= SAME_STEP * self.step_m
