# SPDX-License-Identifier: Apache-2.0
"""A diagnosis in lines for a terminal."""

from __future__ import annotations

import pytest

from tof_gap.tell.report.summary import meaning_of


@pytest.mark.parametrize(
    ("verdict", "meaning"),
    [
        (("none",), " (camera and simulation agree to within the noise)"),
        (("unknown",), " (a difference that no effect known here explains)"),
        (("multipath", "unknown"), " (unknown: a difference that no effect known here explains)"),
        (("multipath",), ""),
    ],
)
def test_an_answer_that_is_no_effect_is_explained(verdict: tuple[str, ...], meaning: str) -> None:
    assert meaning_of(verdict) == meaning
