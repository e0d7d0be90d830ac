# SPDX-License-Identifier: Apache-2.0
"""A wrong lens beside the lens within its calibration, on scores that are given."""

from __future__ import annotations

from typing import Any

import pytest

from tests.tof_gap.scored import Judge, hypothesis, named
from tof_gap.solve.choose.lens import with_lens

NAMES = ["wave", "intrinsics", "intrinsics"]


@pytest.mark.parametrize(("lens", "chosen"), [("bc", "ab"), ("", "a")])
def test_a_lens_that_contradicts_its_calibration_is_wrong_though_freeing_it_explains_little(lens: str, chosen: str) -> None:
    """Two forms of a wrong lens: the one beside which less is left."""
    judge: Any = Judge({"a": 500.0, "ab": 498.0, "ac": 499.0}, NAMES, lens=lens)
    assert named(judge, with_lens(judge, hypothesis(judge, "a"))) == chosen
    assert named(judge, with_lens(judge, hypothesis(judge, "ab"))) == "ab", "it is there already"


@pytest.mark.parametrize(("scores", "chosen"), [((400.0, 300.0), "ac"), ((300.0, 400.0), "ab")])
def test_a_wrong_lens_has_the_form_that_leaves_less(scores: tuple[float, float], chosen: str) -> None:
    judge: Any = Judge({"a": 500.0, "ab": scores[0], "ac": scores[1]}, NAMES)
    assert named(judge, with_lens(judge, hypothesis(judge, "ab"))) == chosen
    assert named(judge, with_lens(judge, hypothesis(judge, "a"))) == "a", "there is no wrong lens"
