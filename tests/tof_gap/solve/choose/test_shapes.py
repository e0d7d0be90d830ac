# SPDX-License-Identifier: Apache-2.0
"""The finer search finds the form between two candidates."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from tests.tof_gap.quiet_views import VIEWS, chain, views
from tof_align.folds import deal
from tof_core.calibration import Calibration, Modulation
from tof_gap.config import GapConfig
from tof_gap.solve.choose import shapes
from tof_gap.solve.choose.shapes import refined
from tof_gap.solve.hypotheses.candidate import Candidate
from tof_gap.solve.hypotheses.columns import ColumnStore
from tof_sensor.effects.range_offset import RangeOffset
from tof_sensor.effects.wiggling import Wiggling

TRUE_MHZ = 66.0


def finer(
    *candidates: Candidate, across_m: float = 0.0, suspected: tuple[int, ...] = (), config: GapConfig | None = None
) -> list[Candidate]:
    """The refined forms of chosen candidates, in a session with a wiggle of `TRUE_MHZ` whose phase runs ahead over the columns."""
    true = Wiggling(modulation_mhz=TRUE_MHZ, sine_m=0.006, cosine_m=0.003, across_m=across_m)
    extra = np.stack([true.bias(v.frame) * v.frame.length for v in views(np.random.default_rng(1))])
    seen = views(np.random.default_rng(1), extra)
    store = ColumnStore(seen, deal([0] * VIEWS, 6))
    selection = SimpleNamespace(chosen=SimpleNamespace(members=tuple(range(len(candidates))), inflate=1.0), suspected=suspected)
    return refined(store, cast("Any", SimpleNamespace(candidates=candidates)), cast("Any", selection), chain(), config or GapConfig())


@pytest.mark.parametrize("start_mhz", [60.0, 72.0, 46.0])  # the last one is two widths of the first pass away
def test_a_frequency_between_candidates_is_found(start_mhz: float) -> None:
    (found,) = finer(Candidate("wiggling", Wiggling(modulation_mhz=start_mhz)), Candidate("range_offset", RangeOffset()))
    assert (found.name, found.note) == ("wiggling", "refined")
    assert cast("Wiggling", found.effect).modulation_mhz == pytest.approx(TRUE_MHZ, rel=0.02)


def test_a_stated_frequency_is_searched_within_its_rounding_only() -> None:
    stated = GapConfig(calibration=Calibration(modulation=Modulation(first_mhz=60.0)))
    (found,) = finer(Candidate("wiggling", Wiggling(modulation_mhz=60.0)), config=stated)
    # The passes of 1.2 % to either side go on three times; those of 20 and 5 % would reach the 66 MHz of the wave.
    assert 60.0 < cast("Wiggling", found.effect).modulation_mhz < 60.0 * 1.012**8


@pytest.mark.parametrize("across_m", [-0.04, 0.04])
def test_a_skew_of_the_phase_over_the_columns_is_found(across_m: float) -> None:
    (found,) = finer(Candidate("wiggling", Wiggling(modulation_mhz=TRUE_MHZ)), across_m=across_m)
    # Of a wave of 0.57 m, 10 mm of skew are a hundredth of a turn at either border: 0.4 mm of its 6.7.
    assert cast("Wiggling", found.effect).across_m == pytest.approx(across_m, abs=0.01)


@pytest.mark.parametrize("across_m", [0.0, 0.002])
def test_a_skew_that_wins_no_more_than_noise_stays_out(across_m: float) -> None:
    (found,) = finer(Candidate("wiggling", Wiggling(modulation_mhz=TRUE_MHZ)), across_m=across_m)
    assert (cast("Wiggling", found.effect).across_m, cast("Wiggling", found.effect).down_m) == (0.0, 0.0)


def test_an_effect_of_one_form_has_no_finer_one() -> None:
    assert finer(Candidate("range_offset", RangeOffset()), Candidate("hand_eye", None)) == []


def test_a_suspected_effect_keeps_its_form() -> None:
    wave, offset = Candidate("wiggling", Wiggling(modulation_mhz=60.0)), Candidate("range_offset", RangeOffset())
    assert finer(wave, offset, suspected=(0,)) == []


def test_a_search_ends_at_what_the_parameter_may_be(monkeypatch: pytest.MonkeyPatch) -> None:
    """Beyond 1000 MHz, sensor.yaml would be refused."""
    tried: list[float] = []
    monkeypatch.setattr(shapes, "FARTHER", 20)

    def fastest(_: Any, effects: list[Candidate], *__: Any) -> Any:
        tried.extend(cast("Wiggling", c.effect).modulation_mhz for c in effects)
        return SimpleNamespace()

    judge = SimpleNamespace(beside=lambda *_: lambda i: SimpleNamespace(score=-float(i)))
    monkeypatch.setattr(shapes, "build", fastest)
    monkeypatch.setattr(shapes, "Selector", lambda *_: judge)
    (found,) = finer(Candidate("wiggling", Wiggling(modulation_mhz=300.0)))
    assert cast("Wiggling", found.effect).modulation_mhz == pytest.approx(1000.0)
    assert max(tried) == pytest.approx(1000.0)
