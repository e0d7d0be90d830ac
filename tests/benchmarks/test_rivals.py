# SPDX-License-Identifier: Apache-2.0
"""Baselines of the benchmarks: tuned as well as they can be."""

from __future__ import annotations

import numpy as np

from benchmarks.rivals import Example, fit_correction, search_rules
from tests.tof_eval.made import CAMERA, capture
from tof_eval.methods import Raw, Rules
from tof_preproc.config import PreprocConfig
from toftwin.evaluating import frame_bias

RNG = np.random.default_rng(8)


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
    correction = frame_bias(fit_correction(shown))
    for example in shown:
        left = example.capture.depth - correction(example.capture) - example.label
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
