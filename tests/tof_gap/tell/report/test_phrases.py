# SPDX-License-Identifier: Apache-2.0
"""Parts of sentences: names and intervals."""

from __future__ import annotations

from tof_gap.tell.report.phrases import interval, spaced


def test_an_interval_shows_no_more_than_all_of_the_gap() -> None:
    assert interval((0.8, 1.05)) == "80 % to 100 % with 95 % confidence"
    assert interval((-0.12, 0.3)) == "-12 % to 30 % with 95 % confidence", "the gap may have grown"
    assert interval(None) == ""


def test_an_interval_that_says_too_little_says_what_narrows_it() -> None:
    assert interval((0.3, 0.81)) == "30 % to 81 % with 95 % confidence; more views, or more captures of each, narrow this"
    assert "more views" not in interval((0.5, 1.05)), "cut at 100 % it is half as wide as the gap"


def test_the_name_of_an_effect_is_written_as_a_reader_writes_it() -> None:
    assert [spaced(name) for name in ("cad_deviation", "lens_scatter", "noise")] == ["CAD deviation", "lens scatter", "noise"]
