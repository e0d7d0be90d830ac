# SPDX-License-Identifier: Apache-2.0
"""Steps of the range along the ray: found at their size, also in means of captures, and not where there are none."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.tof_gap.quiet_views import CAMERA, SHAPE, rendering, views
from tof_core.capture import Capture, View
from tof_gap.limits.evidence import CodeLimits
from tof_gap.limits.noise import NoiseLimits
from tof_gap.seen.evidence.range_code import range_step, steps_along_ray
from tof_gap.seen.noise.effects import noise_effects
from tof_sensor.effects.quantization import Quantization

if TYPE_CHECKING:
    from tof_core.arrays import Float

LENGTH = CAMERA.ray_length()


def view(depth: Float, captures: int = 1) -> View:
    made = View.of_capture(Capture(0, CAMERA, depth.astype(np.float32), np.zeros(SHAPE, np.uint8)))
    return replace(made, captures=captures)


def recorded(step_m: float, noise_m: float, captures: int) -> Float:
    """Mean of captures of an oblique plane whose ranges are rounded to `step_m`, in metres of z."""
    rng = np.random.default_rng(3)
    ranges = [rendering(0.0).depth * LENGTH + rng.normal(0, noise_m, SHAPE) for _ in range(captures)]
    return np.asarray(np.mean([np.round(r / step_m) * step_m if step_m else r for r in ranges], axis=0) / LENGTH)


@pytest.mark.parametrize("captures", [1, 2, 4])
@pytest.mark.parametrize("step_m", [0.003, 0.0112])
def test_the_step_of_one_capture_is_found(step_m: float, captures: int) -> None:
    assert range_step(view(recorded(step_m, 0.1 * step_m, captures), captures), CodeLimits()) == pytest.approx(step_m, rel=0.01)


@pytest.mark.parametrize("captures", [1, 3])
@pytest.mark.parametrize("noise_m", [0.0, 0.002])
def test_a_continuous_range_has_no_step(noise_m: float, captures: int) -> None:
    assert range_step(view(recorded(0.0, noise_m, captures), captures), CodeLimits()) == 0.0


def test_depth_in_whole_millimetres_or_coarser_along_z_is_no_step_of_range() -> None:
    z = rendering(0.0).depth
    for step in (0.001, 0.008):
        assert range_step(view(np.round(z / step) * step), CodeLimits()) == 0.0


def test_junk_that_is_kilometres_away_takes_no_memory() -> None:
    junk = recorded(0.0112, 0.001, 1)
    junk.ravel()[:50] = 1e30
    assert range_step(view(junk), CodeLimits()) == pytest.approx(0.0112, rel=0.01)


def test_few_pixels_or_a_step_above_the_largest_show_nothing() -> None:
    few = np.full(SHAPE, np.nan)
    few.ravel()[:500] = recorded(0.0112, 0.001, 1).ravel()[:500]
    assert range_step(view(few), CodeLimits()) == 0.0
    assert range_step(view(recorded(0.0112, 0.001, 1)), CodeLimits(least_mm=12.0)) == 0.0


@pytest.mark.parametrize("along_ray", [True, False])
def test_the_finding_says_along_what_the_steps_are(along_ray: bool) -> None:  # noqa: FBT001
    step = 0.0112 / LENGTH if along_ray else np.full(SHAPE, 0.0112)
    plain = views(np.random.default_rng(0), photons=False)
    seen = [replace(v, step_m=0.0112, view=replace(v.view, depth=(np.round(v.view.depth / step) * step).astype(np.float32))) for v in plain]
    assert steps_along_ray(seen, 0.0112) == along_ray
    (found,) = noise_effects(seen, NoiseLimits())
    assert found.effect == Quantization(step_m=0.0112, along_ray=along_ray)


@pytest.mark.parametrize(("written_m", "stated_m"), [(0.0, 0.004), (0.012, 0.012)])
def test_the_step_of_a_message_is_stated_and_not_that_of_a_mean_of_captures(written_m: float, stated_m: float) -> None:
    """Three captures in steps of 12 mm, whose noise takes all thirds of a step alike."""
    evidence = [replace(v, step_m=0.004, view=replace(v.view, captures=3, written_m=written_m)) for v in views(np.random.default_rng(0))]
    (found,) = noise_effects(evidence, NoiseLimits())
    assert isinstance(found.effect, Quantization)
    assert found.effect.step_m == pytest.approx(stated_m)
