# SPDX-License-Identifier: Apache-2.0
"""Label errors against their deviation, with the range offset in both or in neither."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.strong_sessions import LabelScore

OFFSET_M = 2e-3


def scored(own_m: float) -> LabelScore:
    """Labels with an offset of 5 mm along the ray beside errors of 1 mm (one sigma), of a camera that states `own_m` beside the offset."""
    rng = np.random.default_rng(0)
    length = rng.uniform(1.0, 1.2, 20000)
    error = 5e-3 / length + rng.normal(0.0, 1e-3, length.size)
    return LabelScore(error, np.hypot(own_m, OFFSET_M / length), length, 0.0, 0.0, 1.0, {})


def test_an_offset_of_five_millimetres_is_beyond_what_two_are_stated_for() -> None:
    # 4.5 mm of z with an error of 1 mm, within 4.2 mm.
    assert scored(1e-3).within(2) == pytest.approx(35.0, abs=1.5)


@pytest.mark.parametrize(("own_m", "per_cent"), [(1e-3, 95.4), (0.5e-3, 68.3), (2e-3, 100.0)])
def test_errors_aside_from_the_offset_are_counted_against_what_is_stated_beside_it(own_m: float, per_cent: float) -> None:
    assert scored(own_m).shape_within(2, OFFSET_M) == pytest.approx(per_cent, abs=1.0)
