# SPDX-License-Identifier: Apache-2.0
"""The signature of each effect in the pixel and in the output, on noise-free frames."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.tof_virtual.made import biases, session
from tof_virtual.pipeline import expose

if TYPE_CHECKING:
    from tof_virtual.session import Session


def lengths(made: Session) -> np.ndarray:
    return made.moment(0).sight.length


def distances(made: Session) -> np.ndarray:
    """(V, P) true distances along the rays."""
    return np.stack([made.moment(i).sight.main.distance for i in range(len(made.shutters))])


@pytest.mark.parametrize("mhz", [100.0, 60.0])
def test_wiggling_has_the_period_c_over_8f(mhz: float) -> None:
    made = session({"wiggling": 1.0}, camera__modulation_mhz=mhz)
    error, d = biases(made, "wiggling") * lengths(made), distances(made)
    valid = np.isfinite(error)
    phase = 2 * np.pi * d[valid] * 8 * mhz * 1e6 / 299_792_458.0

    def explained(harmonic: float) -> float:
        columns = np.stack([np.sin(harmonic * phase), np.cos(harmonic * phase)], axis=1)
        left = error[valid] - columns @ np.linalg.lstsq(columns, error[valid], rcond=None)[0]
        return float(1 - (left @ left) / (error[valid] @ error[valid]))

    assert explained(1.0) > 0.99
    assert explained(2.0) < 0.3
    wave = made.effects[0].params()
    scale = 299_792_458.0 / (4 * np.pi * mhz * 1e6)
    expected = scale * wave["amplitude_rad"] * np.sin(phase + wave["psi_rad"])
    assert np.sqrt(np.mean((error[valid] - expected) ** 2)) < 1e-4


def test_fixed_pattern_stays_in_the_image_whatever_is_seen() -> None:
    made = session({"fixed_pattern": 1.0})
    error = biases(made, "fixed_pattern") * lengths(made)
    both = np.isfinite(error).all(axis=0)
    np.testing.assert_allclose(error[0, both], error[-1, both], atol=1e-9)
    columns = np.nanstd(np.nanmean(error[0].reshape(60, 80), axis=0))
    assert columns > 4 * np.nanstd(error[0]) / np.sqrt(60), "columns share an error"


def test_temperature_drift_is_one_offset_that_follows_the_temperature() -> None:
    made = session({"temperature_drift": 1.0}, plan__views=6)
    error = biases(made, "temperature_drift") * lengths(made)
    assert np.nanmax(np.nanstd(error, axis=1)) < 1e-9
    kelvin = np.array([made.moment(i).temperature for i in range(6)])
    assert kelvin[-1] - kelvin[0] > 8, "the session is long enough to warm up"
    slope = np.polyfit(kelvin, np.nanmean(error, axis=1), 1)
    np.testing.assert_allclose(np.polyval(slope, kelvin), np.nanmean(error, axis=1), atol=1e-6)
    assert slope[0] == pytest.approx(made.effects[0].params()["rad_per_K"] * 0.23856, rel=1e-3)


def test_amplitude_bias_goes_with_the_logarithm_of_the_amplitude() -> None:
    made = session({"amplitude_bias": 1.0})
    error = (biases(made, "amplitude_bias") * lengths(made)).ravel()
    amplitude = np.concatenate([expose(made.moment(i), ()).amplitude for i in range(4)])
    valid = np.isfinite(error)
    slope, offset = np.polyfit(np.log(amplitude[valid]), error[valid], 1)
    np.testing.assert_allclose(slope * np.log(amplitude[valid]) + offset, error[valid], atol=1e-9)
    assert slope == pytest.approx(made.effects[0].params()["rad_per_ln"] * 0.23856, rel=1e-3)


def test_interference_strikes_some_captures_and_has_both_signs() -> None:
    made = session({"interference": 1.0}, plan__captures=5)
    error = biases(made, "interference")
    struck = np.nanmax(np.abs(error), axis=1) > 1e-4
    assert 0.3 < struck.mean() < 1.0
    assert np.nanmax(np.abs(error[~struck])) == 0
    assert abs(np.nanmean(error[struck])) < 0.25 * np.nanstd(error[struck])


@pytest.mark.parametrize("seed", range(4))
def test_noise_adds_three_millimetres_of_noise_and_no_bias(seed: int) -> None:
    made = session({"noise": 1.0}, seed=seed, plan__captures=1)
    photons = np.random.default_rng(0)
    calm, wild = [], []
    for k in range(60):
        moment = made.moment(0)
        moment.index = k
        calm.append(expose(moment, (), photons).depth)
        wild.append(expose(moment, made.effects, photons).depth)
    extra = np.nanmean(np.var(wild, axis=0)) - np.nanmean(np.var(calm, axis=0))
    assert np.sqrt(extra) * 1e3 == pytest.approx(3.0 / np.nanmean(lengths(made)), rel=0.2)
    assert abs(np.nanmean(wild) - np.nanmean(calm)) < 1.5e-4


def test_phase_wrap_is_a_whole_unambiguous_range() -> None:
    for seed in (0, 1):
        made = session({"phase_wrap": 1.0}, seed=seed)
        error = biases(made, "phase_wrap") * lengths(made)
        wrapped = np.isfinite(error) & (np.abs(error) > 1e-9)
        assert 0.01 < wrapped.mean() < 0.12
        np.testing.assert_allclose(np.abs(error[wrapped]), 1.49896229, atol=1e-8)


@pytest.mark.parametrize("seed", range(5))
def test_dropout_loses_a_tenth_at_the_pixels_in_its_truth(seed: int) -> None:
    made = session({"dropout": 1.0}, seed=seed)
    plain = np.stack([expose(made.moment(i), ()).depth for i in range(4)])
    lost = np.isfinite(plain) & ~np.isfinite(np.stack([expose(made.moment(i), made.effects).depth for i in range(4)]))
    chance = biases(made, "dropout")
    assert lost.sum() / np.isfinite(plain).sum() == pytest.approx(0.1, abs=0.06)
    assert chance[lost].mean() > 1.5 * np.nanmean(chance) or made.effects[0].params()["where"] == "any"
    amplitude = np.stack([expose(made.moment(i), ()).amplitude for i in range(4)])
    if made.effects[0].params()["where"] == "weak":
        assert np.median(amplitude[lost]) < 0.5 * np.median(amplitude[np.isfinite(plain)])


def test_stored_units() -> None:
    radial, scale, step = session({"radial_depth": 1.0}), session({"depth_scale": 1.0}), session({"quantization": 1.0})
    true = radial.moment(0).sight.z
    valid = np.isfinite(true)
    np.testing.assert_allclose(
        expose(radial.moment(0), radial.effects).depth[valid], radial.moment(0).sight.main.distance[valid], rtol=1e-9
    )
    measured = expose(scale.moment(0), scale.effects).depth[valid] / true[valid]
    np.testing.assert_allclose(measured, scale.effects[0].params()["scale"], rtol=1e-9)
    steps = expose(step.moment(0), step.effects).depth[valid] / step.effects[0].params()["step_m"]
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)
    assert step.effects[0].params()["step_m"] == pytest.approx(0.003 * np.sqrt(12))


def test_range_offset_is_along_the_ray() -> None:
    made = session({"range_offset": 1.0})
    error = biases(made, "range_offset") * lengths(made)
    assert np.nanstd(error) < 1e-9
    assert np.nanmean(error) == pytest.approx(made.effects[0].params()["offset_m"])
