# SPDX-License-Identifier: Apache-2.0
"""The shrink that a sensor model keeps on another session, measured as the promise was."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.tof_gap.quiet_views import SHAPE, VIEWS
from tof_gap.config import GapConfig
from tof_gap.tell.report.kept import kept

HELD = (1, 3, 4)
NOISE_M = 0.002


def diagnosed(left_m: float, shown_m: float) -> Any:
    """Views whose error after correction is noise and `left_m`; the held-out views show noise of `shown_m`, others are 9 m off."""
    rng = np.random.default_rng(1)
    residual = [rng.normal(left_m if v in HELD else 9.0, shown_m, SHAPE) for v in range(VIEWS)]
    figures = SimpleNamespace(held=HELD, floors_shown=[np.full(SHAPE, shown_m**2)] * len(HELD), rng=np.random.default_rng(2))
    views = [SimpleNamespace(frame=None)] * VIEWS
    solved = SimpleNamespace(caster=SimpleNamespace(scene=SimpleNamespace(digest="here")))
    return SimpleNamespace(residual=residual, evidence=views, account=SimpleNamespace(figures=figures), config=GapConfig(), solved=solved)


def model(bias_m: float) -> Any:
    """A model that adds the same bias to every pixel, and promises to remove 97 %."""
    made = SimpleNamespace(
        names=("dropout", "range_offset"),
        bias=lambda _frame: np.full(SHAPE, bias_m),
        promise=SimpleNamespace(shrink=0.97, low=0.9, high=1.0),
    )
    made.holding_in = {"here": made}.__getitem__
    return made


@pytest.mark.parametrize("shown_m", [NOISE_M, 1.3 * NOISE_M])
def test_noise_above_the_law_is_no_part_of_the_gap(shown_m: float) -> None:
    found = kept(diagnosed(0.0, shown_m), model(0.005))
    assert found is not None
    assert found.promised is not None
    # 5 mm less what poses may hide, 0.3 mm
    assert found.here.shrink == pytest.approx(25.0 / 25.09, abs=0.01)
    assert found.here.above_mm(found.here.before) == pytest.approx(5.0, rel=0.02)


def test_what_the_model_leaves_is_not_kept() -> None:
    """2 mm of 7 are left: of the energy above the noise a share of 4 / 49."""
    found = kept(diagnosed(0.002, NOISE_M), model(0.005))
    assert found is not None
    assert found.here.shrink == pytest.approx(45.0 / 49.09, abs=0.01)
    assert "promised 97 %, 90 % to 100 %" in found.line()


@pytest.mark.parametrize(("left_m", "grows"), [(0.002, False), (-0.007, True)])
def test_a_model_that_enlarges_the_gap_is_said_not_to_hold(left_m: float, *, grows: bool) -> None:
    """2 mm of 7 are left, and -7 mm where the camera has -2 and the model takes 5 off."""
    found = kept(diagnosed(left_m, NOISE_M), model(0.005))
    assert found is not None
    assert found.line().endswith("do not simulate this session with it") == grows


def test_what_was_removed_is_stated_with_its_size() -> None:
    found = kept(diagnosed(0.0, NOISE_M), model(0.005))
    assert found is not None
    assert found.removed == ("range_offset",), "loss has no bias"
    assert found.removed_mm == pytest.approx(5.0)
    assert found.line().startswith("removed by --sensor, so not in the verdict: range_offset (5.0 mm RMS)\nshrink by --sensor: ")


def test_a_model_without_a_bias_promises_nothing() -> None:
    assert kept(diagnosed(0.0, NOISE_M), None) is None
    data_sheet = model(0.0)
    data_sheet.promise = None
    assert kept(diagnosed(0.0, NOISE_M), data_sheet) is None
    assert kept(diagnosed(0.0, NOISE_M), model(0.0)) is not None, "a promise is answered"
