# SPDX-License-Identifier: Apache-2.0
"""The photon law of a camera that averages over neighbours within a threshold."""

from __future__ import annotations

import numpy as np
import pytest

from tof_sensor.effects.photon_law import PhotonLaw


def test_a_camera_that_leaves_out_noisy_neighbours_is_as_noisy_in_the_dark_as_one_pixel() -> None:
    law = PhotonLaw(floor_m=0.0, shot_m=0.001, reference=1000.0, window_px=5, within_m=0.03)
    amplitude, head_on = np.array([4000.0, 0.5]), np.ones(2)
    of_whole = law.whole.variance(amplitude, head_on)
    assert law.variance(amplitude, head_on) == pytest.approx(of_whole * [1.0, 25.0], rel=0.01)


def test_the_variance_of_a_whole_average_is_found_from_the_measured_one() -> None:
    law = PhotonLaw(floor_m=0.0003, shot_m=0.001, reference=1000.0, window_px=5, within_m=0.03)
    amplitude = np.geomspace(1.0, 1e5, 20)
    measured = law.variance(amplitude, np.ones(20))
    assert law.of_whole(measured) == pytest.approx(law.whole.variance(amplitude, np.ones(20)), rel=1e-6)
    assert PhotonLaw(shot_m=0.001).of_whole(measured) is measured
