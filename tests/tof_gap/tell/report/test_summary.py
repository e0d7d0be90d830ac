# SPDX-License-Identifier: Apache-2.0
"""A diagnosis in lines for a terminal."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from tof_gap.tell.figures.shrink import Errors, Shrink
from tof_gap.tell.report.summary import gap_lines, meaning_of


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


def found(verdict: str, off_edges_mm: tuple[float, float] | None = None) -> Any:
    """A diagnosis that asserts this effect; all pixels are off by 44.7 mm above the noise before, and by 3 mm after."""
    before, after = (Errors(rmse, rmse, 0.0) for rmse in (5**0.5 * 20, 10**0.5))
    gap = Shrink(before, after, floor_mm=1.0, shrink=0.98, ci95=(0.95, 1.0), off_edges_mm=off_edges_mm)
    return SimpleNamespace(verdict=(verdict,), gap=gap, asserts=True, unexplained=SimpleNamespace(structured=False))


def test_the_gap_of_most_pixels_comes_first_where_few_are_off_by_centimetres() -> None:
    gap, left, shrink = gap_lines(found("flying_pixels", (2.84, 0.12)))
    assert gap.startswith("gap away from edges, measured minus simulated depth: 2.84 mm RMS above the noise of 1.00 mm, ")
    assert gap.endswith("; 44.71 mm with all pixels, of which few are off by centimetres or more")
    assert left == "with the named effects simulated: 0.12 mm remain, without structure; 3.00 mm with all pixels"
    assert shrink == "the squared gap shrinks by 98 %; the true effects would shrink it by 95 % to 100 % with 95 % confidence"


def test_elsewhere_it_is_that_of_all_pixels() -> None:
    gap, left, _ = gap_lines(found("wiggling"))
    assert gap == "gap, measured minus simulated depth: 44.71 mm RMS above the noise of 1.00 mm, on views that took no part in the fit"
    assert left == "with the named effects simulated: 3.00 mm remain, without structure"


@pytest.mark.parametrize(("rmse", "stays"), [(1.0, ""), (10**0.5, ", and this gap stays")])
def test_noise_and_loss_are_said_to_leave_the_gap(rmse: float, stays: str) -> None:
    errors = Errors(rmse, rmse, 0.0)
    named = found("noise")
    named.gap = Shrink(errors, errors, floor_mm=1.0, shrink=None, ci95=None)
    assert gap_lines(named)[1:] == [f"the named effects are noise or lost pixels, which change no mean depth{stays}"]
