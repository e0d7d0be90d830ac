# SPDX-License-Identifier: Apache-2.0
"""Heat in the camera: lamp, sensor and housing warm up; the thermometer lags behind the housing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from benchmarks.emerging.device import Device, Thermal
    from tof_core.arrays import Float

REFERENCE_AIR_C = 24.0
"""Air of the factory calibration, at which the camera was steady."""


@dataclass(frozen=True, slots=True)
class Warmth:
    """Temperatures in degrees Celsius at one moment."""

    lamp: float
    sensor: float
    housing: float
    thermometer: float


class Network:
    """Linear heat network: lamp and sensor lose heat to the housing, the housing to the air, the thermometer follows the housing.

    Of x = (lamp, sensor, housing, thermometer) in kelvin above air: x' = M x + s. Heat capacities follow from the time constants;
    the housing takes up the heat of lamp and sensor.
    """

    def __init__(self, thermal: Thermal) -> None:
        """The network's matrix and its steady state."""
        t = thermal
        self._air = t.ambient_c
        self.steady: Float = np.array([t.housing_K + t.lamp_K, t.housing_K + t.sensor_K, t.housing_K, t.housing_K])
        M = np.zeros((4, 4))
        M[0, [0, 2]] = -1 / t.lamp_s, 1 / t.lamp_s
        M[1, [1, 2]] = -1 / t.sensor_s, 1 / t.sensor_s
        # in steady state all heat passes the housing: what it takes up from both equals what it gives to the air
        share = t.housing_K / max(t.lamp_K + t.sensor_K, 1e-9) / t.housing_s
        M[2, [0, 1, 2]] = share, share, -2 * share - 1 / t.housing_s
        M[3, [2, 3]] = 1 / t.thermometer_s, -1 / t.thermometer_s
        self._rates, self._modes = np.linalg.eig(M)
        # The housing's balance holds its own steady value.
        self._start = np.linalg.solve(self._modes, -t.warmup_ahead * self.steady.astype(complex))

    def at(self, time_s: float) -> Warmth:
        """Temperatures some seconds after the session's start."""
        ahead = (self._modes @ (self._start * np.exp(self._rates * time_s))).real
        return Warmth(*(self._air + self.steady + ahead).tolist())


def reference(device: Device) -> Warmth:
    """Temperatures of the factory calibration: steady, at the reference air."""
    t = device.thermal
    low = REFERENCE_AIR_C + t.housing_K
    return Warmth(low + t.lamp_K, low + t.sensor_K, low, low)


def delay_s(device: Device, warmth: Warmth) -> float:
    """Delay of the pulse behind the gates that heat adds, against the factory calibration."""
    known = reference(device)
    lamp = device.lamp.tempco_ps_K * (warmth.lamp - known.lamp)
    sensor = device.pixel.tempco_ps_K * (warmth.sensor - known.sensor)
    return 1e-12 * (lamp - sensor)


def compensated_s(device: Device, thermometer_c: float) -> float:
    """Delay that the firmware takes off: right once the camera is steady, at any air temperature."""
    known = reference(device)
    return 1e-12 * (device.lamp.tempco_ps_K - device.pixel.tempco_ps_K) * (thermometer_c - known.thermometer)


def power(device: Device, warmth: Warmth) -> float:
    """Emitted power over that at the factory calibration."""
    return 1 + device.lamp.power_tempco * (warmth.lamp - reference(device).lamp)
