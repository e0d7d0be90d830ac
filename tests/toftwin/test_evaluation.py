# SPDX-License-Identifier: Apache-2.0
"""Scores of methods: the right numbers on frames whose every error is known; rivals that are as good as they can be."""

from __future__ import annotations

import numpy as np
import pytest

from tof_core.camera import Camera
from tof_core.capture import Capture
from tof_core.errors import UsageError
from tof_preproc.config import PreprocConfig
from tof_scene.render import Rendering
from toftwin.evaluation.methods import Estimate, Raw, Rules, make_methods
from toftwin.evaluation.reference import Judged
from toftwin.evaluation.rivals import Example, correction, fit_correction, search_rules
from toftwin.evaluation.score import Scores

CAMERA = Camera(40, 30, 40.0, 40.0, 19.5, 14.5, frame_id="cam")
RNG = np.random.default_rng(8)


def rendering(depth: np.ndarray, albedo: float = 0.5) -> Rendering:
    """Left half part 0 (dark), right half part 1."""
    shape = CAMERA.shape
    part = np.zeros(shape, np.int16)
    part[:, 20:] = 1
    none = np.full(shape, np.nan, np.float32)
    light = np.where(part == 0, 0.05, albedo).astype(np.float32)
    return Rendering(
        CAMERA,
        np.eye(4),
        depth,
        part,
        part.astype(np.int32),
        np.zeros((*shape, 3), np.float32),
        np.full(shape, 0.3, np.float32),
        light,
        np.zeros(shape, np.float32),
        none,
    )


def capture(depth: np.ndarray, stamp: int = 1, amplitude: np.ndarray | None = None) -> Capture:
    depth = depth.astype(np.float32)
    return Capture(
        stamp, CAMERA, depth, np.isnan(depth).astype(np.uint8), None, None if amplitude is None else amplitude.astype(np.float32)
    )


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


def test_the_fitted_correction_finds_wiggling_and_amplitude_bias() -> None:
    length = CAMERA.ray_length()
    shown = []
    for k in range(6):
        true = (0.5 + 0.15 * k + 0.004 * np.arange(40)[None] * np.ones(CAMERA.shape)).astype(np.float32)
        light = np.exp(RNG.normal(6, 1, CAMERA.shape))
        bias = (0.004 * np.sin(2 * np.pi * true * length / 0.3747405725) + 0.003 * np.log(light / 400)) / length
        measured = true + bias + RNG.normal(0, 1e-3, CAMERA.shape)
        measured[RNG.uniform(size=CAMERA.shape) < 0.05] += 0.2
        shown.append(Example(capture(measured, amplitude=light), true))
    model = fit_correction(shown)
    for example in shown:
        left = example.capture.depth - correction(model, example.capture) - example.label
        before = np.median(np.abs(example.capture.depth - example.label))
        assert np.median(np.abs(left)) < 0.4 * before
        assert np.median(np.abs(left)) < 1e-3


def test_the_search_is_no_worse_than_the_defaults_and_keeps_coverage() -> None:
    true = np.full(CAMERA.shape, 1.0, np.float32)
    true[:, 20:] = 1.3
    shown = []
    for _ in range(2):
        measured = true + RNG.normal(0, 1e-3, CAMERA.shape)
        measured[:, 20] = RNG.uniform(1.05, 1.25, 30)
        shown.append(Example(capture(measured), true))
    config, found = search_rules(shown, rounds=1)
    raw, default = (
        1e3 * np.mean([np.nanmean(np.abs(m.estimate([e.capture]).depth - e.label)) for e in shown]) for m in (Raw(), Rules(PreprocConfig()))
    )
    assert found["train_mae_mm"] < 0.5 * raw
    assert found["train_mae_mm"] <= default + 1e-6
    assert np.isfinite(Rules(config).estimate([shown[0].capture]).depth).mean() >= 0.8


def test_methods_by_name() -> None:
    names = [m.name for m in make_methods(["raw", "rules"], PreprocConfig(), None, None, 10)]
    assert names == ["raw", "rules", "rules10"]
    assert isinstance(make_methods(["raw"], PreprocConfig(), None, None, 1)[0], Raw)
    with pytest.raises(UsageError, match="there is no method 'magic'; methods: raw, rules, corrected, model"):
        make_methods(["magic"], PreprocConfig(), None, None, 1)
    with pytest.raises(UsageError, match="'corrected' needs a fitted sensor model"):
        make_methods(["corrected"], PreprocConfig(), None, None, 1)


def test_rules_with_more_frames_scatter_less() -> None:
    true = np.full(CAMERA.shape, 1.0, np.float32)
    captures = [capture(true + RNG.normal(0, 0.003, CAMERA.shape), stamp=1 + 60_000_000 * k) for k in range(10)]
    one, ten = (Rules(PreprocConfig(), n).estimate(captures[-n:]) for n in (1, 10))
    assert np.nanstd(ten.depth) < 0.5 * np.nanstd(one.depth)
