# SPDX-License-Identifier: Apache-2.0
"""Noise beyond the photon law: of the camera's own light, or of foreign light."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from tof_gap.seen.finding import Finding
from tof_gap.tell.own_light import of_own_light
from tof_sensor.effects.ambient import Ambient
from tof_sensor.effects.noise import Noise


def light(surface_m: float) -> Finding:
    """Noise in excess of the photon law, of which some is by light off the surfaces."""
    return Finding(Ambient(surface_m=surface_m, uniform_m=0.001, reference=1000.0), 0.95)


def naming(effect: str) -> Any:
    """A solution that names one effect."""
    return SimpleNamespace(names=lambda name: name == effect)


def test_noise_like_read_out_beside_an_amplitude_bias_is_of_charge_that_traps_hold_back() -> None:
    assert of_own_light(light(0.0), naming("amplitude_bias"))
    assert not of_own_light(light(0.002), naming("amplitude_bias")), "foreign light off the surfaces"
    assert of_own_light(light(0.0), naming("multipath"))
    assert of_own_light(light(0.0), naming("lens_scatter"))
    assert not of_own_light(light(0.002), naming("multipath"))
    assert not of_own_light(light(0.0), naming("wiggling"))
    assert not of_own_light(Finding(Noise(extra_m=0.001), 0.95), naming("amplitude_bias"))


def test_noise_like_read_out_beside_named_noise_is_of_the_read_out() -> None:
    rows = [Finding(Noise(extra_m=0.003), 0.95)]
    assert of_own_light(light(0.0), naming("none"), rows)
    assert not of_own_light(light(0.0), naming("none"), [])
    assert not of_own_light(light(0.002), naming("none"), rows), "foreign light off the surfaces"
