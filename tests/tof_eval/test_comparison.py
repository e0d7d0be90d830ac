# SPDX-License-Identifier: Apache-2.0
"""Methods compared on views: each gets the captures that it takes; the view with most parts is shown."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.tof_eval.made import CAMERA, capture, rendering
from tof_core.errors import RefusedError
from tof_eval.comparison import compare
from tof_eval.methods import Raw, Rules
from tof_eval.reference import Judged
from tof_preproc.config import PreprocConfig


def test_every_method_is_scored_on_every_view_with_the_captures_that_it_takes() -> None:
    rng = np.random.default_rng(3)
    true = np.full(CAMERA.shape, 1.0, np.float32)
    captures = tuple(capture(true + rng.normal(0, 0.003, CAMERA.shape), stamp=1 + 60_000_000 * k) for k in range(8))
    one_part = replace(rendering(true), part=np.zeros(CAMERA.shape, np.int16))
    views = [Judged(captures, true, one_part, 0), Judged(captures, true, rendering(true), 1)]
    found = compare(views, [Raw(), Rules(PreprocConfig(), 8)], ("left", "right"))
    assert found.result["views"] == 2
    assert len(found.result["methods"]["raw"]["captures"]) == 2
    assert found.result["methods"]["raw"]["all"]["rmse_mm"] == pytest.approx(3.0, rel=0.05)
    assert found.result["methods"]["rules8"]["all"]["rmse_mm"] < 0.5 * found.result["methods"]["raw"]["all"]["rmse_mm"]
    assert found.shown[0] is views[1], "two parts are more than one"
    assert found.shown[1]["raw"].depth is captures[-1].depth


def test_no_view_with_a_reference_is_refused() -> None:
    with pytest.raises(RefusedError, match="no view has a reference"):
        compare([], [Raw()], ())
