# SPDX-License-Identifier: Apache-2.0
"""Steps of a camera's code that no grid of the image shows: single pixels jump by whole steps over the captures of a dwell."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from tof_preproc.jumps import step_over_time
from tof_preproc.stack import Stack

if TYPE_CHECKING:
    from collections.abc import Callable

    from tof_core.arrays import Float

SHAPE = 60, 80
CAPTURES = 5
LENGTH = np.linspace(1.0, 1.25, SHAPE[1])[None] * np.ones(SHAPE)
"""Range along the ray over z."""
GRID = np.linspace(0.5, 1.5, 2000)


def stack(
    noise_m: Float | float, step_m: float, *, message_m: float = 1e-3, outliers: float = 0.0, bent: Callable[[Float], Float] | None = None
) -> Stack:
    """Captures of ranges that are rounded to steps, and moved by an offset of each pixel before depth is rounded to the message's steps.

    bent: what is rounded instead of the range, as a function of it.
    """
    rng = np.random.default_rng(4)
    truth, offset = rng.uniform(0.8, 1.2, SHAPE), rng.normal(0.0, 0.02, SHAPE)
    out = Stack(SHAPE, CAPTURES, in_time=False)
    for _ in range(CAPTURES):
        along = truth + noise_m * rng.standard_normal(SHAPE)
        code = bent(along) if bent is not None else along
        code = np.round(code / step_m) * step_m if step_m else code
        along = (np.interp(code, bent(GRID), GRID) if bent is not None else code) + offset
        along += rng.uniform(-0.5, 0.5, SHAPE) * (rng.random(SHAPE) < outliers)
        z = along / LENGTH
        depth = np.asarray(np.round(z / message_m) * message_m if message_m else z, np.float32)
        depth[rng.random(SHAPE) < 0.05] = np.nan
        out.add(depth, np.isnan(depth).astype(np.uint8))
    return out


@pytest.mark.parametrize("step_m", [0.0073, 0.0094, 0.03])
@pytest.mark.parametrize("message_m", [1e-3, 0.0])
@pytest.mark.parametrize("noise_m", [0.0016, 0.006])
def test_pixels_jump_by_whole_steps(step_m: float, message_m: float, noise_m: float) -> None:
    assert step_over_time(stack(noise_m, step_m, message_m=message_m), LENGTH, message_m) == pytest.approx(step_m, rel=0.02)


@pytest.mark.parametrize(
    ("noise_m", "step_m", "message_m"),
    [
        pytest.param(0.0003, 0.0, 1e-3, id="noise below the message's step"),
        pytest.param(0.004, 0.0, 1e-3, id="noise above it"),
        pytest.param(0.004, 0.0, 0.0, id="depth without any step"),
        pytest.param(0.004, 0.003, 1e-3, id="a code hardly coarser than the message's"),
        pytest.param(0.0016, 1.9, 1e-3, id="phases that wrap"),
        pytest.param(0.0, 0.0, 1e-3, id="captures that are all the same"),
    ],
)
def test_other_differences_are_no_steps(noise_m: float, step_m: float, message_m: float) -> None:
    assert step_over_time(stack(noise_m, step_m, message_m=message_m), LENGTH, message_m) == 0.0


def test_outliers_are_no_jumps_and_hide_none() -> None:
    assert step_over_time(stack(0.0003, 0.0, outliers=0.02), LENGTH, 1e-3) == 0.0
    assert step_over_time(stack(0.0016, 0.0094, outliers=0.002), LENGTH, 1e-3) == pytest.approx(0.0094, rel=0.02)


@pytest.mark.parametrize("noise_m", [0.0016, 0.004])
def test_steps_may_be_longer_at_some_ranges(noise_m: float) -> None:
    """A ratio of charges whose steps are 7.5 to 14 mm long."""
    found = step_over_time(stack(noise_m, 0.01, bent=lambda r: r + 0.02 * np.sin(15.0 * r)), LENGTH, 1e-3)
    assert found == pytest.approx(0.0105, abs=0.001)


def test_pixels_that_are_noisier_than_others_follow_no_code() -> None:
    noise = np.where(np.random.default_rng(6).random(SHAPE) < 0.06, 0.02, 0.0003)
    assert step_over_time(stack(noise, 0.0), LENGTH, 1e-3) == 0.0


def test_one_capture_shows_nothing() -> None:
    one = Stack(SHAPE, 1, in_time=False)
    one.add(np.ones(SHAPE, np.float32), np.zeros(SHAPE, np.uint8))
    assert step_over_time(one, LENGTH, 1e-3) == 0.0
