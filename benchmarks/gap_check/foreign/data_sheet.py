# SPDX-License-Identifier: Apache-2.0
"""The camera's data sheet as `sensor.yaml`: a photon law fitted to the noise of targets that the healthy camera measured."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import nnls

from benchmarks.emerging.data_sheet import noise_table
from tof_sensor.effects.photon_law import PhotonLaw
from tof_sensor.model import SensorModel, save_model

if TYPE_CHECKING:
    from pathlib import Path

    from benchmarks.emerging.data_sheet import NoiseTable
    from benchmarks.emerging.device import Device
    from tof_core.camera import Camera


def write_data_sheet(healthy: Device, lens: Camera, path: Path) -> NoiseTable:
    """Fit the law's four terms to the table's variances by non-negative least squares on relative errors, and write them.

    Returns the table.
    """
    table = noise_table(healthy, lens)
    reference = float(np.median(table.amplitude))
    ratio = reference / table.amplitude
    terms = np.stack([np.ones_like(ratio), ratio, ratio * table.distance**2, ratio**2], axis=1)
    found, _ = nnls(terms / table.variance[:, None], np.ones(len(ratio)))
    floor, shot, far, ambient = (float(np.sqrt(x)) for x in found)
    darkest = float(table.amplitude.min())
    law = PhotonLaw(floor_m=floor, shot_m=shot, far_m=far, ambient_m=ambient, reference=reference, darkest=darkest)
    save_model(SensorModel((law,)), path)
    return table
