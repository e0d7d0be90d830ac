# SPDX-License-Identifier: Apache-2.0
"""Scores of methods: the right numbers on frames whose every error is known."""

from __future__ import annotations

import numpy as np
import pytest

from tests.tof_eval.made import CAMERA, capture, rendering
from tof_eval.methods import Estimate
from tof_eval.reference import Judged
from tof_eval.scores import Scores

RNG = np.random.default_rng(8)


def test_errors_by_method_bin_and_equal_coverage() -> None:
    true = np.full(CAMERA.shape, 1.0, np.float32)
    raw = true + 0.010
    better = true - 0.002
    better[:, 30:] = np.nan
    scores = Scores(["raw", "model"], ("left", "right"))
    scores.add(Judged((capture(raw),), true, rendering(true), 0), {"raw": Estimate(raw, None, 0.0), "model": Estimate(better, None, 0.02)})
    d = scores.to_dict()
    assert d["raw"]["all"]["mae_mm"] == pytest.approx(10, rel=1e-4)
    assert d["model"]["all"]["bias_mm"] == pytest.approx(-2, rel=1e-4)
    assert d["model"]["all"]["completeness"] == 0.75
    assert d["raw"]["equal_coverage"]["pixels"] == d["model"]["equal_coverage"]["pixels"] == 900
    assert d["raw"]["equal_coverage_share"] == 0.75
    assert d["model"]["by"]["part"]["right"]["completeness"] == 0.5
    assert d["model"]["by"]["albedo"]["0 to 0.1"]["completeness"] == 1.0
    assert d["raw"]["captures_equal_coverage"][0]["alignment"] == pytest.approx(99.0, abs=1e-3)
    assert d["model"]["ms_per_frame"] == pytest.approx(20)


def test_sigma_is_held_to_what_it_says() -> None:
    true = np.full(CAMERA.shape, 1.0, np.float32)
    noisy = (true + RNG.normal(0, 0.004, CAMERA.shape)).astype(np.float32)
    scores = Scores(["model"], ())
    scores.add(
        Judged((capture(noisy),), true, rendering(true), 0), {"model": Estimate(noisy, np.full(CAMERA.shape, 0.004, np.float32), 0.0)}
    )
    d = scores.to_dict()["model"]
    assert d["within_1_sigma"] == pytest.approx(0.683, abs=0.05)
    assert d["within_2_sigma"] == pytest.approx(0.954, abs=0.02)


def test_flying_pixels_left_wrong() -> None:
    """Of four flying pixels at the edge one is repaired, one removed, two stay."""
    true = np.full(CAMERA.shape, 1.0, np.float32)
    raw = true.copy()
    raw[3:7, 20] = 1.1
    out = raw.copy()
    out[3, 20], out[4, 20] = 1.001, np.nan
    scores = Scores(["rules"], ())
    scores.add(Judged((capture(raw),), true, rendering(true), 0), {"rules": Estimate(out, None, 0.0)})
    assert scores.to_dict()["rules"]["flying_left_wrong"] == 0.5
