# SPDX-License-Identifier: Apache-2.0
"""Albedo from amplitude: ratios of parts, a lamp that is weaker at the border, and what is kept as stated."""

from __future__ import annotations

import numpy as np
import pytest

from tof_scene.albedo import HIGHEST, albedo_by_amplitude


def seen(albedo: list[float], pixels: int = 3000) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pixels of parts, each part towards its own side of an image whose lamp falls to a third in the corners."""
    rng = np.random.default_rng(0)
    part = np.repeat(np.arange(len(albedo)), pixels)
    off_axis = np.clip(rng.uniform(0.0, 0.6, len(part)) + 0.4 * part / len(albedo), 0.0, 1.0)
    noise = 0.1 * rng.standard_normal(len(part))
    return part, np.log(700.0 * np.array(albedo)[part]) - 1.1 * off_axis**2 + noise, off_axis


def test_ratios_of_parts_are_found_under_a_lamp_with_a_weak_border() -> None:
    part, returned, off_axis = seen([0.2, 0.8, 0.4])
    found = albedo_by_amplitude(np.full(3, 0.5), part, returned, off_axis)
    assert found / found[0] == pytest.approx([1.0, 4.0, 2.0], rel=0.03)
    assert np.exp(np.log(found).mean()) == pytest.approx(0.5, rel=0.01), "the scale is the stated one"


def test_a_highlight_and_missing_pixels_change_nothing() -> None:
    part, returned, off_axis = seen([0.2, 0.8])
    returned[:900] += 3.0
    returned[3000:4000] = np.nan
    found = albedo_by_amplitude(np.full(2, 0.4), part, returned, off_axis)
    assert found[1] / found[0] == pytest.approx(4.0, rel=0.08)


def test_a_part_of_few_pixels_keeps_its_stated_albedo() -> None:
    part, returned, off_axis = seen([0.2, 0.8])
    found = albedo_by_amplitude(
        np.array([0.3, 0.3, 0.7]), np.append(part, [2] * 20), np.append(returned, [0.0] * 20), np.append(off_axis, [0.5] * 20)
    )
    assert found[2] == 0.7
    assert albedo_by_amplitude(np.array([0.3]), np.zeros(100, int), np.full(100, np.nan), np.zeros(100)).tolist() == [0.3]


def test_no_part_returns_more_than_all_light() -> None:
    part, returned, off_axis = seen([0.02, 0.9, 0.9])
    assert albedo_by_amplitude(np.full(3, 0.6), part, returned, off_axis).max() == HIGHEST
