# SPDX-License-Identifier: Apache-2.0
"""The data sheet of the emerging camera: noise by amplitude and distance, and the photon law fitted to it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from benchmarks.emerging.data_sheet import ALBEDOS, DISTANCES_M, noise_table
from benchmarks.emerging.healthy import draw
from benchmarks.gap_check.foreign.data_sheet import write_data_sheet
from tof_core.camera import Camera
from tof_sensor.model import load_model

if TYPE_CHECKING:
    from pathlib import Path


LENS = Camera(224, 171, 211.0, 211.0, 111.5, 85.0)


def test_a_data_sheet_s_law_is_the_noise_that_targets_show(tmp_path: Path) -> None:
    healthy = draw(np.random.default_rng(4), 4)
    table = write_data_sheet(healthy, LENS, tmp_path / "sensor.yaml")
    law = load_model(tmp_path / "sensor.yaml").law
    assert law is not None
    assert len(table.variance) > 0.5 * len(ALBEDOS) * len(DISTANCES_M)
    np.testing.assert_allclose(law.variance(table.amplitude, table.distance**2), table.variance, rtol=0.35)
    # Electrons of the lamp alone: four times the amplitude at one distance, half of the noise.
    near = table.distance == DISTANCES_M[1]
    bright, dark = table.variance[near][-1], table.variance[near][0]
    assert np.sqrt(dark / bright) == pytest.approx(np.sqrt(table.amplitude[near][-1] / table.amplitude[near][0]), rel=0.35)


def test_coarse_depth_codes_are_no_camera_without_noise(tmp_path: Path) -> None:
    """Near and bright targets have one code of 4 mm in all captures; the law states the variance of the step there, not zero."""
    healthy = draw(np.random.default_rng(4), 4)
    coarse = replace(healthy, firmware=replace(healthy.firmware, step_mm=4.0, denoise_px=5))
    table = write_data_sheet(coarse, LENS, tmp_path / "sensor.yaml")
    law = load_model(tmp_path / "sensor.yaml").law
    assert law is not None
    assert table.variance.min() == pytest.approx(0.004**2 / 12)
    bright = table.amplitude > np.median(table.amplitude)
    np.testing.assert_array_less(0.5 * table.variance[bright], law.variance(table.amplitude, table.distance**2)[bright])


def test_a_data_sheet_covers_the_dark_targets_of_a_camera_that_averages() -> None:
    """Its edge filter passes their noise where pixels are as wide as its own; behind pixels a fifth as wide it removes all but bright targets."""
    healthy = draw(np.random.default_rng(4), 4)
    averaging = replace(healthy, firmware=replace(healthy.firmware, denoise_px=5, filter=True))
    own, narrow = (noise_table(averaging, replace(LENS, fx=f, fy=f)) for f in (LENS.fx, 5.0 * LENS.fx))
    assert own.amplitude.min() < 0.02 * own.amplitude.max()
    assert narrow.amplitude.min() > 3.0 * own.amplitude.min()
