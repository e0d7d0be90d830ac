# SPDX-License-Identifier: Apache-2.0
"""A sensor model survives its file, and sorts itself into physical order."""

from __future__ import annotations

from pathlib import Path
from textwrap import dedent
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.tof_sensor.plane import plane_frame
from tests.vocabulary import EFFECT_NAMES
from tof_core.errors import ConfigError
from tof_sensor.effects.ambient import Ambient
from tof_sensor.effects.cad_deviation import CadDeviation
from tof_sensor.effects.dropout import Dropout
from tof_sensor.effects.interference import Interference
from tof_sensor.effects.multipath import Multipath
from tof_sensor.effects.noise import Noise
from tof_sensor.effects.photon_law import PhotonLaw
from tof_sensor.effects.quantization import Quantization
from tof_sensor.effects.wiggling import Wiggling
from tof_sensor.model import SensorModel, load_model, save_model, simulate
from tof_sensor.registry import EFFECTS, PHYSICAL_ORDER, VOCABULARY

if TYPE_CHECKING:
    from tof_sensor.effect import Effect


def test_every_effect_is_explained_and_every_explained_effect_is_there() -> None:
    assert set(VOCABULARY) == EFFECT_NAMES


def test_every_effect_survives_its_file(tmp_path: Path) -> None:
    model = SensorModel(tuple(kind() for kind in EFFECTS.values()))
    save_model(model, tmp_path / "sensor.yaml")
    assert load_model(tmp_path / "sensor.yaml") == model


def test_effects_are_sorted_whatever_the_order_given() -> None:
    model = SensorModel((Quantization(), Wiggling()))
    assert [type(e) for e in model.effects] == [k for k in PHYSICAL_ORDER if k in (Quantization, Wiggling)]


@pytest.mark.parametrize("kind", [k for k in PHYSICAL_ORDER if k.LINEAR and k.NAME != "fixed_pattern"])
def test_bias_of_small_coefficients_is_that_of_the_columns(kind: type) -> None:
    effect, frame = kind(), plane_frame()
    values = np.full(len(effect.coefficients), 1e-6)
    bias = effect.with_coefficients(values).bias(frame)
    np.testing.assert_allclose(bias, effect.columns(frame) @ values, atol=1e-4 * np.abs(bias).max())


def test_every_effect_states_what_it_means_and_its_own_place() -> None:
    assert len({kind.ORDER for kind in PHYSICAL_ORDER}) == len(PHYSICAL_ORDER) == len(EFFECTS)
    assert all(EFFECTS[name].MEANING and EFFECTS[name].REMEDY and EFFECTS[name].SEPARATED_BY for name in VOCABULARY)


def test_the_law_of_a_model_holds_what_its_effects_add_to_every_capture() -> None:
    law = PhotonLaw(floor_m=3e-4, shot_m=1e-3, reference=50.0)
    light, steps = Ambient(surface_m=2e-3, uniform_m=1e-3, reference=100.0), Quantization(step_m=1e-3)
    both, amplitude, range2 = SensorModel((law, light, steps)).law, np.array([10.0, 80.0]), np.array([0.5, 2.0])
    assert both is not None
    expected = law.variance(amplitude, range2) + light.variance(amplitude, range2) + 1e-6 / 12
    np.testing.assert_allclose(both.variance(amplitude, range2), expected, rtol=1e-12)
    assert SensorModel((light,)).law is None


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


def test_effects_of_parts_and_their_light_hold_in_their_own_scene_alone(tmp_path: Path) -> None:
    wave, law = Wiggling(sine_m=1e-3), PhotonLaw()
    model = SensorModel((Multipath(strength=0.6), CadDeviation(part=2), wave, law), scene="a1")
    save_model(model, tmp_path / "sensor.yaml")
    again = load_model(tmp_path / "sensor.yaml")
    assert again.scene == "a1"
    assert again.holding_in("a1") == again
    assert set(again.holding_in("b2").effects) == {wave, law}
    anywhere = SensorModel(model.effects)
    assert anywhere.holding_in("b2") == anywhere, "a file without a scene holds everywhere"


@pytest.mark.parametrize(
    ("known", "found", "included"),
    [
        (Dropout(threshold=60.0), Dropout(threshold=80.0), True),
        (Dropout(threshold=60.0), Dropout(threshold=100.0), False),
        (Dropout(threshold=60.0), Dropout(threshold=60.0, random=0.05), False),
        (Dropout(random=0.10), Dropout(random=0.105), True),
        (Noise(extra_m=0.004, duty=0.25), Noise(extra_m=0.0045, duty=0.4), True),
        (Noise(extra_m=0.004, duty=0.25), Noise(extra_m=0.008, duty=0.25), False),
        (Noise(extra_m=0.004, duty=0.25), Noise(extra_m=0.004), False),
        (Interference(burst_m=0.004), Interference(burst_m=0.0045), True),
        (Interference(burst_m=0.004), Interference(burst_m=0.006), False),
        (Quantization(step_m=0.004), Quantization(step_m=0.00401), True),
        (Quantization(step_m=0.004), Quantization(step_m=0.008), False),
        (Interference(burst_m=0.004), Noise(extra_m=0.001, duty=0.25), False),
        (Wiggling(sine_m=1e-3), Wiggling(sine_m=1e-3), False),
    ],
)
def test_noise_and_loss_of_a_known_camera_are_expected_up_to_their_size(known: Effect, found: Effect, *, included: bool) -> None:
    assert SensorModel((known,)).stated.includes(found) is included


def test_the_data_sheet_of_the_guide_is_a_photon_law(tmp_path: Path) -> None:
    """docs/gap.md shows the file: noise of 4 mm at amplitude 800, half of its variance at twice the amplitude."""
    guide = (Path(__file__).parents[2] / "docs" / "gap.md").read_text()
    block = guide[guide.index("    schema: toftwin.sensor/1") :].split("\n\n")[0]
    (tmp_path / "sensor.yaml").write_text(dedent(block) + "\n")
    (law,) = load_model(tmp_path / "sensor.yaml").effects
    assert isinstance(law, PhotonLaw)
    around = np.ones(2)
    np.testing.assert_allclose(law.variance(np.array([800.0, 1600.0]), around), [0.004**2 + 0.0005**2, 0.004**2 / 2 + 0.0005**2])
