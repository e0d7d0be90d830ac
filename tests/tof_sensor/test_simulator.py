# SPDX-License-Identifier: Apache-2.0
"""A simulated camera: each effect by its own formula, seeded, with an amplitude in the camera's unit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tof_core.camera import Camera
from tof_core.capture import Capture
from tof_core.errors import ConfigError, RefusedError
from tof_core.reasons import Reason
from tof_sensor.effects.dropout import Dropout
from tof_sensor.effects.flying_pixels import FlyingPixels
from tof_sensor.effects.multipath import Multipath
from tof_sensor.effects.photon_law import PhotonLaw
from tof_sensor.effects.range_offset import RangeOffset
from tof_sensor.effects.temperature_drift import TemperatureDrift
from tof_sensor.model import SensorModel
from tof_sensor.simulator import Simulator, SimulatorConfig

CAMERA = Camera(64, 48, 60.0, 60.0, 31.5, 23.5)
WALL_M = 1.2


def wall(stamp: int = 7, albedo: float | None = None, **changes: object) -> Capture:
    """A wall across the optical axis."""
    depth = np.full(CAMERA.shape, WALL_M, np.float32)
    light = None if albedo is None else np.full(CAMERA.shape, albedo, np.float32)
    return replace(Capture(stamp, CAMERA, depth, np.zeros(CAMERA.shape, np.uint8), amplitude=light), **changes)  # type: ignore[arg-type]


def test_the_offset_goes_along_the_ray_and_the_amplitude_with_the_square_of_range() -> None:
    made = Simulator(SimulatorConfig(), SensorModel((RangeOffset(0.01),), gain=500.0)).measured(wall(albedo=0.8))
    length = CAMERA.ray_length()
    np.testing.assert_allclose(made.depth, WALL_M + 0.01 / length, atol=1e-6)
    assert made.amplitude is not None
    np.testing.assert_allclose(made.amplitude, 500 * 0.8 / length / (WALL_M * length) ** 2, rtol=1e-4)


def test_noise_follows_the_law_and_is_the_seeds_alone() -> None:
    law = SensorModel((PhotonLaw(floor_m=0.0, shot_m=0.004, reference=100.0),), gain=100.0)
    camera = Simulator(SimulatorConfig(), law)
    frames = [camera.measured(wall(k, albedo=0.5)).depth for k in range(40)]
    length = CAMERA.ray_length()
    expected = 0.004 * np.sqrt((WALL_M * length) ** 2 * length / 0.5) / length
    assert np.std(frames, axis=0).mean() == pytest.approx(expected.mean(), rel=0.05)
    again = Simulator(SimulatorConfig(), law)
    np.testing.assert_array_equal(again.measured(wall(3, albedo=0.5)).depth, frames[3])
    other = Simulator(SimulatorConfig(seed=1), law)
    assert np.abs(other.measured(wall(3, albedo=0.5)).depth - frames[3]).max() > 1e-3


def test_a_surface_that_gives_no_light_has_no_depth() -> None:
    law = SensorModel((PhotonLaw(floor_m=0.0, shot_m=0.001, ambient_m=0.001, reference=100.0),), gain=100.0)
    ideal = wall(albedo=0.5)
    assert ideal.amplitude is not None
    ideal.amplitude[:, :10] = 0.0
    made = Simulator(SimulatorConfig(), law).measured(ideal)
    assert np.isnan(made.depth[:, :10]).all()
    assert (made.reason[:, :10] == Reason.NO_RETURN).all()
    np.testing.assert_allclose(made.depth[:, 10:], WALL_M, atol=0.05)


def test_lost_pixels_say_why_and_what_was_invalid_stays() -> None:
    ideal = wall()
    ideal.depth[0, 0], ideal.reason[0, 0] = np.nan, Reason.OUT_OF_RANGE
    made = Simulator(SimulatorConfig(), SensorModel((Dropout(random=0.3),), gain=1.0)).measured(ideal)
    lost = np.isnan(made.depth)
    assert lost.mean() == pytest.approx(0.3, abs=0.03)
    assert made.reason[0, 0] == Reason.OUT_OF_RANGE
    assert (made.reason[lost][1:] == Reason.NO_RETURN).all()
    assert not made.reason[~lost].any()


def test_amplitude_may_be_the_simulators_own() -> None:
    made = Simulator(SimulatorConfig(light="amplitude"), SensorModel()).measured(wall(albedo=321.0))
    np.testing.assert_array_equal(made.amplitude, 321.0)


def test_albedo_of_eight_bits_is_a_share() -> None:
    config = SimulatorConfig(albedo_per_count=1 / 255)
    one, other = (Simulator(c, SensorModel(gain=10.0)) for c in (config, SimulatorConfig()))
    counted, stated = one.measured(wall(albedo=51)).amplitude, other.measured(wall(albedo=0.2)).amplitude
    assert counted is not None
    assert stated is not None
    np.testing.assert_allclose(counted, stated, rtol=1e-6)


def test_time_runs_from_the_first_capture_and_from_a_reset() -> None:
    drift = TemperatureDrift(warmup_m=0.01, tau_s=600.0)
    camera = Simulator(SimulatorConfig(), SensorModel((drift,), gain=1.0))
    first, later = camera.measured(wall(10**9)), camera.measured(wall(2000 * 10**9))
    assert np.abs(first.depth - later.depth).max() > 1e-3
    camera.reset()
    np.testing.assert_allclose(camera.measured(wall(3000 * 10**9)).depth, first.depth, atol=1e-6)


def test_an_unknown_unit_of_amplitude_and_an_unknown_camera_are_refused() -> None:
    with pytest.raises(RefusedError, match="unit of amplitude"):
        Simulator(SimulatorConfig(), SensorModel()).measured(wall())
    with pytest.raises(ConfigError, match=r"names no sensor\.yaml"):
        Simulator.load(SimulatorConfig())


def test_effects_that_need_a_scene_are_listed() -> None:
    assert Simulator(SimulatorConfig(), SensorModel((Multipath(1.0), RangeOffset(0.01)))).without_effect == ("multipath",)


def test_a_lens_of_another_unit_is_noted_and_another_camera_is_refused() -> None:
    """A pinhole half a pixel beside the camera's is near; a tenth of the width is another lens."""
    near, far = (replace(CAMERA, fx=CAMERA.fx + px, cx=CAMERA.cx + 0.5) for px in (1.4, 0.1 * CAMERA.width))
    noted, refused = (Simulator(SimulatorConfig(), SensorModel((RangeOffset(0.01),), gain=1.0, camera=c)) for c in (near, far))
    assert noted.measured(wall(albedo=0.5)).depth.shape == CAMERA.shape
    (note,) = noted.lens_note(wall())
    assert note.startswith(
        f"the simulator's CameraInfo is not that of sensor.yaml (fx {near.fx:g} against {CAMERA.fx:g}, cx {near.cx:g} against {CAMERA.cx:g})"
    )
    with pytest.raises(RefusedError, match=r"another camera.*CameraInfo of the camera"):
        refused.measured(wall(albedo=0.5))
    assert Simulator(SimulatorConfig(), SensorModel(camera=CAMERA)).lens_note(wall()) == []


def test_what_an_ideal_capture_lacks_is_noted() -> None:
    drift = TemperatureDrift(drift_m=4e-4, warmup_m=0.002, tau_s=60.0)
    camera = Simulator(SimulatorConfig(albedo=0.3), SensorModel((drift,), gain=1.0))
    albedo, temperature, edges = camera.notes(wall())
    assert "0.3 (--albedo)" in albedo
    assert temperature.startswith("no temperature: the drift per kelvin of sensor.yaml is left out")
    assert "pixels that an edge filter in the camera removes are not simulated" in edges
    mixed = Simulator(SimulatorConfig(), SensorModel((drift, FlyingPixels(share=1.0)), gain=1.0))
    assert mixed.notes(wall(albedo=0.5, temperature=30.0)) == []
