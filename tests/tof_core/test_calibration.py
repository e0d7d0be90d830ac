# SPDX-License-Identifier: Apache-2.0
"""A stated calibration: largest errors, and the deviations that follow from them."""

from pathlib import Path

import numpy as np
import pytest

from tof_core.calibration import FILE, Calibration, LensLimits, calibration_beside, load_calibration, save_calibration
from tof_core.errors import ConfigError

TEXT = """
hand_eye: {translation_mm: 2.0, rotation_deg: 0.2}
lens: {principal_point_px: 0.3, focal_pct: 0.1}
albedo: {relative: 0.4}
"""


def test_deviations_are_those_of_errors_drawn_evenly_up_to_the_largest(tmp_path: Path) -> None:
    (tmp_path / "calibration.yaml").write_text(TEXT)
    stated = load_calibration(tmp_path / "calibration.yaml")
    rng = np.random.default_rng(0)
    way = rng.normal(size=(200_000, 3))
    drawn = 2e-3 * rng.uniform(size=(len(way), 1)) * way / np.linalg.norm(way, axis=1, keepdims=True)
    np.testing.assert_allclose(stated.hand_eye_sd[:3], drawn.std(axis=0), rtol=0.01)
    np.testing.assert_allclose(stated.hand_eye_sd[3:], np.radians(0.2) / 3)
    turn = rng.uniform(0, 2 * np.pi, len(way))
    centre = 0.3 * rng.uniform(size=len(way)) * np.cos(turn)
    np.testing.assert_allclose(stated.lens_sd[2:], centre.std(), rtol=0.01)
    np.testing.assert_allclose(stated.lens_sd[:2], 1e-3 / np.sqrt(3))


def test_a_report_of_one_sigma_per_axis_is_converted_as_the_page_says(tmp_path: Path) -> None:
    (tmp_path / "calibration.yaml").write_text(TEXT)
    stated = load_calibration(tmp_path / "calibration.yaml")
    np.testing.assert_allclose(3.0 * stated.hand_eye_sd, [2e-3] * 3 + [np.radians(0.2)] * 3)
    np.testing.assert_allclose(2.4 * stated.lens_sd[2:], 0.3, rtol=0.03)
    np.testing.assert_allclose(1.7 * stated.lens_sd[:2], 1e-3, rtol=0.03)


def test_largest_errors_are_in_metres_radians_and_pixels(tmp_path: Path) -> None:
    (tmp_path / "calibration.yaml").write_text(TEXT)
    stated = load_calibration(tmp_path / "calibration.yaml")
    assert stated.hand_eye_most == pytest.approx((2e-3, np.radians(0.2)))
    assert stated.lens_most_px(100.0) == pytest.approx(0.3 + 0.1)


def test_a_data_sheet_states_up_to_three_modulation_frequencies(tmp_path: Path) -> None:
    (tmp_path / FILE).write_text("modulation: {first_mhz: 80.32, second_mhz: 60.24}\n")
    assert load_calibration(tmp_path / FILE).modulation.stated == (80.32, 60.24)
    assert Calibration().modulation.stated == ()


def test_nothing_stated_is_an_exact_calibration() -> None:
    assert not Calibration().hand_eye_sd.any()
    assert not Calibration().lens_sd.any()


def test_a_scene_s_folder_states_its_calibration_or_none(tmp_path: Path) -> None:
    assert calibration_beside(tmp_path) == Calibration()
    stated = Calibration(lens=LensLimits(principal_point_px=0.3))
    save_calibration(stated, tmp_path / FILE)
    assert calibration_beside(tmp_path) == stated


def test_an_unknown_key_is_refused(tmp_path: Path) -> None:
    (tmp_path / "calibration.yaml").write_text("hand: {translation_mm: 2}\n")
    with pytest.raises(ConfigError, match="unknown key 'hand'"):
        load_calibration(tmp_path / "calibration.yaml")
