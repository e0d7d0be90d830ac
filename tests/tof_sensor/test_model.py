# SPDX-License-Identifier: Apache-2.0
"""A sensor model survives its file, and sorts itself into physical order."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.tof_sensor.plane import plane_frame
from tests.vocabulary import EFFECT_NAMES
from tof_core.errors import ConfigError
from tof_sensor.effects.quantization import Quantization
from tof_sensor.effects.wiggling import Wiggling
from tof_sensor.model import SensorModel, load_model, save_model, simulate
from tof_sensor.registry import EFFECTS, PHYSICAL_ORDER, VOCABULARY

if TYPE_CHECKING:
    from pathlib import Path


def test_vocabulary_is_the_designs() -> None:
    assert set(VOCABULARY) == EFFECT_NAMES


def test_every_effect_survives_its_file(tmp_path: Path) -> None:
    model = SensorModel(tuple(kind() for kind in EFFECTS.values()))
    save_model(model, tmp_path / "sensor.yaml")
    assert load_model(tmp_path / "sensor.yaml") == model


def test_effects_are_sorted_whatever_the_order_given() -> None:
    model = SensorModel((Quantization(), Wiggling()))
    assert [type(e) for e in model.effects] == [k for k in PHYSICAL_ORDER if k in (Quantization, Wiggling)]


@pytest.mark.parametrize("kind", [k for k in PHYSICAL_ORDER if k.LINEAR and k.NAME != "fixed_pattern"])
def test_bias_is_linear_in_the_coefficients(kind: type) -> None:
    effect, frame = kind(), plane_frame()
    values = np.full(len(effect.coefficients), 1e-3)
    one, two = (effect.with_coefficients(s * values).bias(frame) for s in (1, 2))
    np.testing.assert_allclose(two, 2 * one, atol=1e-12)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("schema: toftwin.sensor/1\neffects:\n- {effect: wobbling}\n", "unknown effect 'wobbling'"),
        ("schema: toftwin.sensor/1\neffects:\n- {effect: wiggling, size: 1}\n", "unknown key 'size'"),
        ("schema: toftwin.sensor/1\neffects:\n- {effect: wiggling, sine_m: 5.0}\n", "above 0.1"),
        ("schema: other\neffects: []\n", "schema must be"),
        ("- 1\n", "must be a mapping"),
        ("schema: toftwin.sensor/1\neffects:\n- {effect: fixed_pattern, values: [a]}\n", "list of numbers"),
    ],
)
def test_bad_files_are_refused_in_one_line(tmp_path: Path, text: str, says: str) -> None:
    path = tmp_path / "sensor.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=says) as error:
        load_model(path)
    assert "\n" not in str(error.value)


def test_simulation_is_the_sum_of_its_biases_and_repeats_with_its_seed() -> None:
    frame = plane_frame()
    model = SensorModel((Wiggling(sine_m=0.003),))
    one = simulate(frame.rendering, model, np.random.default_rng(1))
    np.testing.assert_allclose(one.depth, frame.depth + model.bias(frame), atol=1e-9)
