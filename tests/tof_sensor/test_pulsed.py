# SPDX-License-Identifier: Apache-2.0
"""A camera without a modulation frequency: no word presumes one, and at the lowest frequency light adds by its amount alone."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from tof_sensor.effects.flying_pixels import Edge, FlyingPixels
from tof_sensor.effects.multipath import Multipath
from tof_sensor.effects.range_offset import RangeOffset
from tof_sensor.frame import indirect_bias, waves_per_m
from tof_sensor.model import FREQUENCY, SensorModel, load_model, save_model
from tof_sensor.registry import EFFECTS

if TYPE_CHECKING:
    from pathlib import Path

PULSED_MHZ = 5.0
PRESUMED = ("modulat", "frequenc", "harmonic", "phase", "whole period", "beats")
"""Words that a camera with a pulse and gates has no use for."""


@pytest.mark.parametrize("name", sorted(EFFECTS))
def test_no_word_of_an_effect_presumes_a_modulation(name: str) -> None:
    effect = EFFECTS[name]
    for text in (effect.MEANING, effect.REMEDY, effect.SEPARATED_BY):
        assert not [word for word in PRESUMED if word in text.lower()], text


@pytest.mark.parametrize("step_m", [0.1, 0.5, 1.0])
def test_a_pulsed_cameras_mixed_pixel_lies_at_the_mean_weighed_by_light(step_m: float) -> None:
    mixed, light = np.array([0.2, 0.5, 0.7]), np.array([1.0, 0.5, 1.5])
    edge = Edge((np.zeros(3, int), np.arange(3)), mixed, light, np.full(3, step_m), np.ones(3))
    weight = mixed * light / (1 - mixed + mixed * light)
    np.testing.assert_allclose(FlyingPixels(share=1.0, modulation_mhz=PULSED_MHZ).mixture(edge), weight * step_m, atol=2e-3)


def test_a_pulsed_cameras_indirect_light_moves_range_by_its_share() -> None:
    detour_m, ratio, waves = 0.6, 0.1, waves_per_m(PULSED_MHZ)
    moved = indirect_bias(np.array(ratio * np.exp(2j * waves * detour_m)), waves)
    assert moved == pytest.approx(ratio / (1 + ratio) * detour_m, rel=0.02)


def test_a_sensor_file_says_that_its_frequency_is_no_statement_of_the_camera(tmp_path: Path) -> None:
    path, model = tmp_path / "sensor.yaml", SensorModel((Multipath(strength=0.05), RangeOffset(offset_m=0.002)))
    save_model(model, path)
    assert path.read_text().startswith(FREQUENCY)
    assert load_model(path).effects == model.effects
    save_model(SensorModel((RangeOffset(offset_m=0.002),)), path)
    assert path.read_text().startswith("schema: ")
