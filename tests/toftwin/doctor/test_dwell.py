# SPDX-License-Identifier: Apache-2.0
"""The first capture of a stop shows what the later ones show, unless the driver filters over time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

import numpy as np
import pytest

from toftwin.doctor.dwell import Ends, ends_of, examine_dwells

if TYPE_CHECKING:
    from tof_core.capture import Capture

SHAPE = 60, 80


class Stub:
    """A capture's depth alone."""

    def __init__(self, depth: Any) -> None:
        self.depth = depth


def stop(kept: float, *, count: int = 5, noise_m: float = 2e-3) -> list[Capture]:
    """Captures of a wall at 1 m, of which each keeps a share of the last image; the stop before showed walls at 0.7 to 1.2 m."""
    rng = np.random.default_rng(1)
    image = rng.uniform(0.7, 1.2, SHAPE)
    out = []
    for _ in range(count):
        image = kept * image + (1.0 - kept) * (1.0 + noise_m * rng.standard_normal(SHAPE))
        out.append(cast("Capture", Stub(image.astype(np.float32))))
    return out


def test_the_first_capture_of_a_filter_over_time_is_off_by_what_it_keeps() -> None:
    ends = ends_of(stop(0.1))
    assert ends is not None
    assert ends.first == pytest.approx(0.1 * 0.5 / np.sqrt(12) * np.sqrt(1 + 0.05**2), rel=0.1), "0.1 of walls 0.145 m RMS about their mean"
    assert ends.off


def test_without_a_filter_both_ends_differ_by_noise_alone() -> None:
    ends = ends_of(stop(0.0))
    assert ends is not None
    assert ends.first == pytest.approx(2e-3 * np.sqrt(1 + 1 / 3), rel=0.05)
    assert ends.last == pytest.approx(ends.first, rel=0.05)
    assert not ends.off


def test_a_difference_below_a_millimetre_changes_no_label() -> None:
    assert not Ends(9e-4, 1e-4).off
    assert Ends(1.2e-3, 1e-4).off


@pytest.mark.parametrize("count", [1, 3])
def test_few_captures_are_not_compared(count: int) -> None:
    assert ends_of(stop(0.1, count=count)) is None


def test_captures_without_a_common_pixel_are_not_compared() -> None:
    assert ends_of([cast("Capture", Stub(np.full(SHAPE, np.nan, np.float32)))] * 5) is None


def test_most_stops_must_show_it() -> None:
    filtered, usual = Ends(0.005, 0.001), Ends(0.001, 0.001)
    (found,) = examine_dwells([filtered, filtered, usual, None])
    assert (found.level, found.check) == ("note", "dwell")
    assert found.what == "at 2 of 3 stops the first capture is off by 4.9 mm RMS from the later ones"
    assert "temporal filter" in found.todo
    assert not list(examine_dwells([filtered, usual, usual]))
    assert not list(examine_dwells([None, usual]))
    assert not list(examine_dwells([]))
