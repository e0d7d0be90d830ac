# SPDX-License-Identifier: Apache-2.0
"""Verdicts of views: counted under names without numbers, and a warning with the remedy while views are refused."""

from __future__ import annotations

from tof_sim_label.verdicts import RECENT, Verdicts


def refused(verdicts: Verdicts, pixels: int) -> None:
    verdicts.refuse("fits nowhere", f"fits nowhere: 10 % of {pixels} pixels within 15 mm of the CAD")


def test_a_thousand_refused_views_are_one_key_whose_count_is_theirs() -> None:
    verdicts = Verdicts()
    for pixels in range(1000):
        refused(verdicts, pixels)
    assert verdicts.counts == {"fits nowhere": 1000}
    assert verdicts.why == "fits nowhere: 10 % of 999 pixels within 15 mm of the CAD"


def test_where_no_view_was_accepted_the_warning_says_who_placed_the_cell_and_what_to_do() -> None:
    verdicts = Verdicts()
    assert verdicts.warning("live.initial_pose") == ""
    refused(verdicts, 1839)
    verdicts.refuse("too few pixels on the CAD", "only 7 pixels see the CAD")
    said = verdicts.warning("live.initial_pose")
    assert said.startswith(
        "no view fits the CAD: all 2 of this session are refused (fits nowhere 1, too few pixels on the CAD 1); label/pose and "
        "CAMERA_aligned are not published for them, and their masks are empty."
    )
    assert "the cell is not where live.initial_pose places it: correct it, or draw the pose in RViz (2D Pose Estimate)" in said
    assert said.endswith("The newest: only 7 pixels see the CAD")
    assert "not where TF places it: correct the transform to the cell" in verdicts.warning("TF")


def test_single_refused_views_are_said_until_as_many_good_ones_have_come_as_count() -> None:
    verdicts = Verdicts()
    verdicts.accept("ok")
    refused(verdicts, 500)
    assert verdicts.warning("TF").startswith("views are refused: 1 of the last 2 (fits nowhere 1); label/pose and")
    for _ in range(RECENT - 1):
        verdicts.accept("ok")
    assert verdicts.warning("TF").startswith("views are refused: 1 of the last 10 (fits nowhere 1)")
    verdicts.accept("ok")
    assert verdicts.warning("TF") == ""


def test_a_new_session_judges_anew_and_counts_on() -> None:
    verdicts = Verdicts()
    verdicts.accept("ok")
    refused(verdicts, 1)
    verdicts.begin()
    assert verdicts.warning("TF") == ""
    assert (verdicts.counts, verdicts.why) == ({"fits nowhere": 1, "ok": 1}, "")
    refused(verdicts, 2)
    assert "all 1 of this session are refused" in verdicts.warning("TF")


def test_a_dwell_without_a_label_is_counted_among_all() -> None:
    verdicts = Verdicts()
    verdicts.accept("ok")
    assert verdicts.skip() == "1 of 2 dwells"
    assert verdicts.counts["skipped"] == 1
