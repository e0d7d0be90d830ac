# SPDX-License-Identifier: Apache-2.0
"""Amplitude bias (walk error): dark pixels are measured nearer or farther than bright ones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from tof_core.config import param
from tof_sensor.effect import Effect, stack

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_sensor.frame import Frame


@dataclass(frozen=True, slots=True)
class AmplitudeBias(Effect):
    """dr = a ln(A / A0) + b ln(A / A0)^2 (Lindner 2010; TOF_EFFECTS A.2); A0 only sets the zero."""

    NAME: ClassVar[str] = "amplitude_bias"
    LINEAR: ClassVar[tuple[str, ...]] = ("per_ln_m", "per_ln2_m")

    per_ln_m: float = param(0.0, "bias per e-fold of amplitude", unit="m", low=-0.05, high=0.05)
    per_ln2_m: float = param(0.0, "curvature of the law", unit="m", low=-0.05, high=0.05)
    reference: float = param(1.0, "amplitude without bias, in the camera's unit", low=1e-12)

    def columns(self, frame: Frame) -> Float:
        """Log amplitude and its square, along z."""
        log = np.log(np.maximum(frame.amplitude, 1e-12) / self.reference)
        length = frame.length
        seen = frame.valid & (frame.amplitude > 0)
        return stack([np.where(seen, log, 0) / length, np.where(seen, log * log, 0) / length], frame)
