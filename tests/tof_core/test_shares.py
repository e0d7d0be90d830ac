# SPDX-License-Identifier: Apache-2.0
"""Shares in words: whole per cent, and never naught of what is there."""

from __future__ import annotations

import pytest

from tof_core.shares import in_percent
from tof_sensor.effects.interference import Interference
from tof_sensor.effects.phase_wrap import PhaseWrap


@pytest.mark.parametrize(
    ("share", "words"),
    [
        (0.0, "0 %"),
        (7e-7, "under 0.1 %"),
        (0.004, "0.4 %"),
        (0.02, "2 %"),
        (0.98, "98 %"),
        (1.0, "100 %"),
        (-0.24, "-24 %"),
        (-0.004, "-0.4 %"),
        (-1e-9, "0 %"),
    ],
)
def test_no_share_reads_0_but_0(share: float, words: str) -> None:
    assert in_percent(share) == words


def test_effects_of_few_pixels_or_captures_state_them() -> None:
    assert PhaseWrap(share=0.003).stated.endswith("0.3 % of the pixels at those ranges")
    assert Interference(burst_m=0.002, duty=0.004).stated == "2.0 mm in 0.4 % of the captures"


def test_columns_of_a_table_have_the_decimals_that_are_asked_for() -> None:
    assert [in_percent(share, 1) for share in (0.0, 0.0004, 0.98765, 1.0)] == ["0.0 %", "0.0 %", "98.8 %", "100.0 %"]
