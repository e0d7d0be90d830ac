# SPDX-License-Identifier: Apache-2.0
"""Where the gap lies: regions with their share, discoveries at their rate, and bins of quantities."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.tof_gap.quiet_views import SHAPE, VIEWS, views
from tof_gap.limits.report import ReportLimits
from tof_gap.tell.figures.where import _discoveries, by_quantity, regions
from tof_gap.tell.report.words import sentence

NOISE_M = 0.002
FLOOR2 = [np.full(SHAPE, NOISE_M**2)] * VIEWS
SCENE: Any = SimpleNamespace(parts=[SimpleNamespace(name="panel")])


def halves() -> list[np.ndarray]:
    """Region 4 on the left half of every view, region 9 on the right."""
    region = np.full(SHAPE, 4, np.int32)
    region[:, SHAPE[1] // 2 :] = 9
    return [region] * VIEWS


def gap(right_m: float, columns: slice = slice(SHAPE[1] // 2, None)) -> list[np.ndarray]:
    """Noise, and a constant gap on some columns."""
    rng = np.random.default_rng(5)
    bias = np.zeros(SHAPE)
    bias[:, columns] = right_m
    return [rng.normal(0, NOISE_M, SHAPE) + bias for _ in range(VIEWS)]


def test_the_region_with_the_gap_has_its_share_and_bias() -> None:
    (found,) = regions(views(np.random.default_rng(1)), gap(0.003), FLOOR2, halves(), SCENE, ReportLimits())
    assert (found.id, found.part, found.name) == (9, "panel", "panel, face 9")
    assert found.share == pytest.approx(1.0, abs=0.01)
    assert found.bias_mm == pytest.approx(3.0, abs=0.02)
    assert found.gap_mm == pytest.approx(3.0, abs=0.02), "above the noise"
    assert found.rmse_mm == pytest.approx(np.hypot(3, 2), abs=0.02)
    assert found.pixels == VIEWS * SHAPE[0] * SHAPE[1] // 2


def test_noise_alone_discovers_no_region() -> None:
    assert regions(views(np.random.default_rng(1)), gap(0.0), FLOOR2, halves(), SCENE, ReportLimits()) == []


def test_energy_is_shared_between_regions() -> None:
    quarter = SHAPE[1] // 4
    both = regions(views(np.random.default_rng(1)), gap(0.003, slice(quarter, None)), FLOOR2, halves(), SCENE, ReportLimits())
    assert [r.id for r in both] == [9, 4]
    assert [r.share for r in both] == pytest.approx([2 / 3, 1 / 3], abs=0.01)


def test_bins_of_a_quantity_hold_equal_numbers_and_the_mean_gap() -> None:
    found = by_quantity(views(np.random.default_rng(1)), gap(0.003), FLOOR2, bins=4)
    columns = found["column"]
    assert [b.pixels for b in columns] == [VIEWS * SHAPE[0] * SHAPE[1] // 4] * 4
    assert [b.bias_mm for b in columns] == pytest.approx([0.0, 0.0, 3.0, 3.0], abs=0.05)
    assert [b.floor_mm for b in columns] == pytest.approx([2.0] * 4)
    assert columns[0].low == 0.0
    assert columns[-1].high == SHAPE[1] - 1
    assert found["speed_m_s"] == [], "a quantity that does not vary has no bins"


def test_false_discoveries_stay_below_their_rate() -> None:
    rng = np.random.default_rng(0)
    found = [bool(_discoveries(rng.uniform(size=200), 0.05).any()) for _ in range(400)]
    assert np.mean(found) < 0.09


def test_small_p_values_are_found_among_many() -> None:
    p = np.concatenate([np.full(5, 1e-8), np.random.default_rng(1).uniform(size=200)])
    assert _discoveries(p, 0.05)[:5].all()


def test_the_verdict_reads_as_a_sentence() -> None:
    shrunk = {"shrink": 0.97}
    assert sentence({"verdict": ["none"], "gap": shrunk, "causes": []}).startswith("Camera and simulation agree")
    few = [{"effect": "wiggling", "asserted": False}]
    assert sentence({"verdict": ["none"], "gap": shrunk, "causes": few}) == (
        "Camera and simulation differ perhaps by wiggling: the views are too few to be sure."
    )
    one = sentence({"verdict": ["multipath"], "gap": shrunk})
    assert one == "Camera and simulation differ by multipath, which explains 97 % of the gap."
    two = sentence({"verdict": ["amplitude_bias|wiggling", "multipath"], "gap": shrunk})
    assert two == "Camera and simulation differ by amplitude bias or wiggling and multipath, which together explain 97 % of the gap."
    clue = {"depends_on": ["amplitude", "x_m", "z_m"], "where": ["floor", "wall"]}
    assert sentence({"verdict": ["unknown"], "gap": shrunk, "unexplained": clue, "causes": []}) == (
        "Camera and simulation differ, and no effect known here explains the difference. "
        "It varies with amplitude and place in the cell; it shows most on floor and wall."
    )
    suspected = [{"effect": "lens_scatter", "asserted": False}]
    assert sentence({"verdict": ["unknown"], "gap": shrunk, "unexplained": clue, "causes": suspected}).endswith(
        "Part of it looks like lens scatter, but too much is left to be sure."
    )
    nowhere: dict[str, list[str]] = {"depends_on": [], "where": []}
    assert sentence({"verdict": ["multipath", "unknown"], "gap": shrunk, "unexplained": nowhere}).endswith("no effect known here explains.")
