# SPDX-License-Identifier: Apache-2.0
"""Motion: the taps are exposed one after the other while the scene moves through the pixel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from tof_core.config import param
from tof_sensor.effect import Effect, stack
from tof_sensor.frame import LIGHT_M_PER_S
from tof_sensor.geometry import image_flow, pose_columns

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_sensor.frame import Frame


@dataclass(frozen=True, slots=True)
class Motion(Effect):
    """Four taps at times 0..3 `tap_s` (TOF_EFFECTS A.12; Jimenez 2014).

    Depth is that of the mean time; besides, a change of brightness between the taps turns the
    phase: c0 / (4 pi f) times (A'/A) tap / 2, by the image's flow over amplitude edges. How much, goes with twice the phase
    and with the order of the taps, which is the maker's: mean, cosine and sine are coefficients.
    """

    NAME: ClassVar[str] = "motion"
    LOCAL: ClassVar[bool] = False
    LINEAR: ClassVar[tuple[str, ...]] = ("axial_s", "edge_s", "edge_cos_s", "edge_sin_s")

    axial_s: float = param(0.0, "time by which the depth is late", unit="s", low=-0.5, high=0.5)
    edge_s: float = param(0.0, "time between taps times the edge term's gain", unit="s", low=-0.5, high=0.5)
    edge_cos_s: float = param(0.0, "its part with the cosine of twice the phase", unit="s", low=-0.5, high=0.5)
    edge_sin_s: float = param(0.0, "its part with the sine", unit="s", low=-0.5, high=0.5)
    modulation_mhz: float = param(60.0, "modulation frequency", unit="MHz", low=5.0, high=400.0)

    def columns(self, frame: Frame) -> Float:
        """Depth rate, and brightness rate in metres; 0 where the camera stands."""
        twist = frame.context.twist
        rate = pose_columns(frame) @ twist
        phase = 4e6 * np.pi * self.modulation_mhz / LIGHT_M_PER_S
        brightness, turn = _log_rate(frame) / phase / frame.length, 2 * phase * np.nan_to_num(frame.radial)
        return stack([rate, brightness, brightness * np.cos(turn), brightness * np.sin(turn)], frame)


def _log_rate(frame: Frame) -> Float:
    """(H, W) d ln A / dt in a pixel, by the flow of the image under the camera's twist."""
    flow_u, flow_v = image_flow(frame)
    log = np.log(np.maximum(frame.amplitude, 1e-12))
    dv, du = np.gradient(np.where(frame.valid, log, np.nan))
    return np.asarray(np.nan_to_num(-(du * flow_u + dv * flow_v)))
