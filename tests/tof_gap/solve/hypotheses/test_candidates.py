# SPDX-License-Identifier: Apache-2.0
"""The hypotheses of a session: whatever may be named can be written to sensor.yaml and read again."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.tof_gap.quiet_views import views
from tests.tof_scene.solids import scene, wall
from tof_gap.limits.noise import NoiseLimits
from tof_gap.solve.hypotheses.candidate import Candidate
from tof_gap.solve.hypotheses.candidates import candidates
from tof_sensor.effects.amplitude_bias import AmplitudeBias
from tof_sensor.effects.depth_scale import DepthScale
from tof_sensor.effects.lens_scatter import LensScatter
from tof_sensor.effects.specular import Specular
from tof_sensor.effects.subsurface import Subsurface
from tof_sensor.effects.temperature_drift import TemperatureDrift
from tof_sensor.effects.wiggling import Wiggling, longer, periods
from tof_sensor.frame import LIGHT_M_PER_S
from tof_sensor.model import SensorModel, load_model, save_model

if TYPE_CHECKING:
    from pathlib import Path

    from tof_sensor.effect import Effect


@pytest.mark.parametrize("span_m", [0.05, 0.5, 4.0, 12.0])
def test_every_period_that_is_tried_can_be_saved(span_m: float, tmp_path: Path) -> None:
    tried = [Wiggling(modulation_mhz=float(LIGHT_M_PER_S / (8e6 * p))) for p in periods(span_m)]
    save_model(SensorModel(tuple(tried)), tmp_path / "sensor.yaml")
    assert [e.period_m for e in load_model(tmp_path / "sensor.yaml").effects] == pytest.approx([e.period_m for e in tried])  # type: ignore[attr-defined]
    assert tried[-1].period_m == pytest.approx(0.06, rel=0.5) or len(tried) == 40


def test_every_candidate_of_a_session_can_be_saved(tmp_path: Path) -> None:
    made = candidates(views(np.random.default_rng(0)), scene(wall=wall()), NoiseLimits())
    effects = [c.effect for c in made if c.effect is not None]
    assert {"wiggling", "lens_scatter", "specular", "cad_deviation", "subsurface"} <= {e.NAME for e in effects}
    save_model(SensorModel(tuple(effects)), tmp_path / "sensor.yaml")
    assert len(load_model(tmp_path / "sensor.yaml").effects) == len(effects)


def test_a_long_wave_occurs_only_beside_a_shorter_one_and_beside_no_line_over_range() -> None:
    long, short = Candidate("wiggling", Wiggling(modulation_mhz=15.0), further=True), Candidate("wiggling", Wiggling())
    scale, drift = Candidate("depth_scale", DepthScale()), Candidate("temperature_drift", TemperatureDrift())
    assert not long.stands_beside([])
    assert not long.stands_beside([drift])
    assert long.stands_beside([short, drift])
    assert long.stands_beside([long, short]), "it counts for nothing beside itself"
    assert not long.stands_beside([long])
    assert not long.stands_beside([short, scale])
    assert short.stands_beside([scale])


def test_long_waves_are_tried_up_to_twice_the_span() -> None:
    assert longer(0.6) == []
    assert longer(2.0) == pytest.approx([4.0, 8 / 3, 2.0, 1.6, 4 / 3])
    assert len(longer(12.0)) == 12


def test_stated_frequencies_replace_the_usual_ones() -> None:
    made = candidates(views(np.random.default_rng(0)), scene(wall=wall()), NoiseLimits(), stated_mhz=(80.0, 60.0))
    tried = {name: {c.effect.modulation_mhz for c in made if c.name == name} for name in ("lens_scatter", "multipath", "wiggling")}  # type: ignore[union-attr]
    # Two frequencies are merged: stray light acts on range as at one of them, or between both.
    assert tried == {"lens_scatter": {80.0, 60.0, 70.0}, "multipath": {80.0, 60.0, 70.0}, "wiggling": {80.0, 60.0}}
    assert not any(c.effect.reach_m for c in made if isinstance(c.effect, LensScatter))
    waves = {
        further: {round(c.effect.period_m, 3) for c in made if isinstance(c.effect, Wiggling) and c.further is further}
        for further in (False, True)
    }
    assert waves == {False: {0.234, 0.312, 0.375, 0.416, 0.468, 0.5, 0.625, 0.833}, True: {0.937, 1.249, 1.874}}


@pytest.mark.parametrize(
    ("one", "other", "together"),
    [
        (Subsurface(part=0), Subsurface(part=1), True),
        (Specular(part=0), Specular(part=1), True),
        (Specular(part=0, modulation_mhz=50.0), Specular(part=0, modulation_mhz=100.0), False),
        (Specular(part=0), Specular(), False),
        (Specular(lobe_deg=5.0), Specular(lobe_deg=10.0), False),
        (Wiggling(modulation_mhz=20.0), Wiggling(modulation_mhz=80.0), True),
        (AmplitudeBias(form="log"), AmplitudeBias(form="inverse"), False),
        (AmplitudeBias(), Wiggling(), True),
    ],
)
def test_effects_of_a_part_occur_on_several_parts(one: Effect, other: Effect, together: bool) -> None:  # noqa: FBT001
    a, b = (Candidate(e.NAME, e) for e in (one, other))
    assert (a.excludes(b), b.excludes(a)) == (not together, not together)
