# SPDX-License-Identifier: Apache-2.0
"""The camera's data sheet as `sensor.yaml`: a photon law fitted to the noise of targets that the healthy camera measured."""

from __future__ import annotations

from dataclasses import replace
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


WITHIN_M = np.geomspace(2e-3, 0.2, 60).tolist()
"""Thresholds of the average that are tried: the maker knows that of the camera's filter, which compares pairs of neighbours."""


def write_data_sheet(healthy: Device, lens: Camera, path: Path) -> NoiseTable:
    """Fit the photon law to the table's variances and write it; that of a camera that averages with the threshold that fits best.

    Returns the table.
    """
    table, firmware = noise_table(healthy, lens), healthy.firmware
    step_m, window = 1e-3 * firmware.step_mm / np.sqrt(12), firmware.denoise_px
    laws = [fitted(table, PhotonLaw(floor_m=step_m, window_px=window, within_m=within)) for within in (WITHIN_M if window > 1 else (0.0,))]
    save_model(SensorModel((min(laws, key=lambda law: misfit(table, law)),)), path)
    return table


def fitted(table: NoiseTable, average: PhotonLaw) -> PhotonLaw:
    """The law with the four terms that fit best, by non-negative least squares on relative errors, beside the average and the step of a law."""
    reference = float(np.median(table.amplitude))
    ratio, variance = reference / table.amplitude, average.of_whole(table.variance)
    terms = np.stack([np.ones_like(ratio), ratio, ratio * table.distance**2, ratio**2], axis=1)
    found, _ = nnls(terms / variance[:, None], np.ones(len(ratio)))
    floor, shot, far, ambient = (float(np.sqrt(x)) for x in found)
    darkest = float(table.amplitude.min())
    return replace(average, floor_m=floor, shot_m=shot, far_m=far, ambient_m=ambient, reference=reference, darkest=darkest)


def misfit(table: NoiseTable, law: PhotonLaw) -> float:
    """Mean squared error of the law's ln variance."""
    return float(np.mean(np.log(law.variance(table.amplitude, table.distance**2) / table.variance) ** 2))
