# SPDX-License-Identifier: Apache-2.0
"""Methods that repair depth: by name, with one capture and with several."""

from __future__ import annotations

import numpy as np
import pytest

from tests.tof_eval.made import CAMERA, capture
from tof_core.errors import UsageError
from tof_eval.methods import Corrected, Raw, Rules, make_methods
from tof_preproc.config import PreprocConfig

RNG = np.random.default_rng(8)


def test_the_correction_is_subtracted_before_the_filters() -> None:
    true = np.full(CAMERA.shape, 1.0, np.float32)
    corrected = Corrected(lambda c: np.full(c.depth.shape, 0.02), PreprocConfig())
    depth = corrected.estimate([capture(true + 0.02 + RNG.normal(0, 1e-3, CAMERA.shape))]).depth
    assert abs(np.nanmean(depth) - 1.0) < 2e-4
    assert corrected.name == "corrected"


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
