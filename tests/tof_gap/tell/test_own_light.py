# SPDX-License-Identifier: Apache-2.0
"""Noise beyond the photon law: of the camera's own light, or of foreign light."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.tof_gap.quiet_views import SHAPE, views
from tof_gap.seen.finding import Finding
from tof_gap.seen.photons import variance_of_mean
from tof_gap.tell.own_light import of_own_light, times_law
from tof_sensor.effects.ambient import Ambient
from tof_sensor.effects.noise import Noise
from tof_sensor.effects.photon_law import PhotonLaw

LAW = PhotonLaw(floor_m=0.0, shot_m=0.004, reference=1000.0)


def light(surface_m: float) -> Finding:
    """Noise in excess of the photon law, of which some is by light off the surfaces."""
    return Finding(Ambient(surface_m=surface_m, uniform_m=0.001, reference=1000.0), 0.95)


def naming(effect: str, bare: Any = ()) -> Any:
    """A solution that names one effect."""
    return SimpleNamespace(names=lambda name: name == effect, bare=bare)


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


@pytest.mark.parametrize(("excess", "own"), [(0.5, True), (0.9, True), (1.2, False), (4.0, False)])
def test_a_lamp_that_is_on_for_longer_at_most_doubles_the_variance(*, excess: float, own: bool) -> None:
    """Beside `wiggling`, foreign light is named from twice the law's variance on."""
    seen = views(np.random.default_rng(1))
    noise_m = np.stack([np.sqrt(excess * variance_of_mean(LAW, v)) / v.frame.length for v in seen])
    noise_m[:, :10] = np.nan
    found = Finding(Ambient(surface_m=0.002, reference=1000.0), 0.95, share=noise_m, beside=LAW)
    assert noise_m.shape[1:] == SHAPE
    assert times_law(found, seen) == pytest.approx(excess, rel=1e-6)
    assert of_own_light(found, naming("wiggling", seen)) is own
    assert not of_own_light(found, naming("intrinsics", seen))
