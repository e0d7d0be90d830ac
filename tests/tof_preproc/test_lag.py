# SPDX-License-Identifier: Apache-2.0
"""Clocks of images and TF: a difference is found from starts and stops, and none is stated without evidence."""

from __future__ import annotations

import numpy as np
import pytest

from tof_preproc.lag import LagMonitor

NOISE_M = 0.003


def watched(
    late_s: float, *, hz: float = 10.0, seconds: float = 24.0, stop_s: float = 2.0, drive_s: float = 1.0, noise: float = NOISE_M
) -> LagMonitor:
    """A camera before a slope, at rest and in motion by turns at 0.2 m/s; its images are stamped `late_s` late."""
    rng = np.random.default_rng(1)
    monitor, slope = LagMonitor(), np.linspace(0.8, 1.6, 60)[:, None] * np.ones(80)
    period = stop_s + drive_s
    for k in range(int(seconds * hz)):
        stamp = k / hz + rng.uniform(-0.1, 0.1) / hz
        true = stamp - late_s
        driven = (true // period) * drive_s + max(true % period - stop_s, 0.0)
        depth = slope - 0.2 * driven + noise * rng.normal(size=slope.shape)
        speed = 0.2 if stamp % period > stop_s else 0.0
        monitor.push(round(1e9 * (100 + stamp)), depth.astype(np.float32), np.array([0.0, 0.0, speed, 0.0, 0.0, 0.0]))
    return monitor


@pytest.mark.parametrize("hz", [5.0, 10.0, 30.0])
@pytest.mark.parametrize("late_s", [0.3, -0.3, 0.5])
def test_a_difference_is_found_to_a_quarter_of_a_frame(late_s: float, hz: float) -> None:
    found = watched(late_s, hz=hz).lag()
    assert found is not None
    assert found.seconds == pytest.approx(late_s, abs=0.25 / hz + 0.02)
    assert found.motions >= 8


@pytest.mark.parametrize("hz", [5.0, 10.0, 30.0])
def test_clocks_that_agree_are_not_accused(hz: float) -> None:
    assert watched(0.0, hz=hz).lag() is None
    assert watched(0.2 / hz, hz=hz).lag() is None


def test_without_drives_or_change_nothing_is_stated() -> None:
    assert watched(0.3, drive_s=0.0).lag() is None
    assert watched(0.3, noise=0.5).lag() is None
    assert watched(0.3, seconds=4.0).lag() is None
    assert LagMonitor().lag() is None


def test_frames_without_a_velocity_or_of_another_size_are_passed_over() -> None:
    monitor = watched(0.3)
    monitor.push(200_000_000_000, np.full((30, 40), np.nan, np.float32), None)
    monitor.push(200_100_000_000, np.full((171, 224), 1.0, np.float32), None)
    assert monitor.lag() is not None
    monitor.reset()
    assert monitor.lag() is None


def test_the_line_names_the_difference_and_the_remedy() -> None:
    assert str(watched(0.3).lag()).startswith("the depth changes about 0.3 s after TF does")
    assert "before TF does" in str(watched(-0.3).lag())
    assert "synchronise the clocks" in str(watched(0.3).lag())
