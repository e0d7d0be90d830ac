# SPDX-License-Identifier: Apache-2.0
"""The shrink and its interval from sums of blocks that are given, term by term."""

from __future__ import annotations

import numpy as np
import pytest

from tof_gap.limits.report import ShrinkLimits
from tof_gap.tell.figures import shrink as room
from tof_gap.tell.figures.shrink import Errors, HeldOut, Shrink, _drawn, _shrink, blocks, measure

LIMITS = ShrinkLimits()
HEALTHY2, HIDDEN2 = (1e-3 * LIMITS.healthy_mm) ** 2, (1e-3 * LIMITS.healthy_most_mm) ** 2 - (1e-3 * LIMITS.healthy_mm) ** 2


def sums(before_mm: tuple[float, ...], after_mm: tuple[float, ...], floor_mm: float = 1.0, n: float = 100.0) -> HeldOut:
    """Blocks of n pixels, all of one error each."""

    def moments(mm: tuple[float, ...]) -> np.ndarray:
        e = 1e-3 * np.array(mm)
        return n * np.stack([e, np.abs(e), e**2])

    count = len(before_mm)
    return HeldOut(np.full(count, n), moments(before_mm), moments(after_mm), np.full(count, n * (1e-3 * floor_mm) ** 2))


def test_errors_are_root_mean_square_mean_absolute_and_mean_in_millimetres() -> None:
    held = sums((3.0, -4.0, 0.0), (1.0, 1.0, 1.0))
    before, after = held.errors("before"), held.errors("after")
    assert (before.rmse, before.mae, before.bias) == pytest.approx((np.sqrt(25 / 3), 7 / 3, -1 / 3))
    assert (after.rmse, after.mae, after.bias) == pytest.approx((1.0, 1.0, 1.0))
    weighted = held.errors("before", np.array([1.0, 0.0, 3.0]))
    assert (weighted.rmse, weighted.mae, weighted.bias) == pytest.approx((1.5, 0.75, 0.75))
    nothing = HeldOut(np.zeros(0), np.zeros((3, 0)), np.zeros((3, 0)), np.zeros(0))
    assert nothing.errors("after") == Errors(0.0, 0.0, 0.0)
    assert nothing.above_mm == (0.0, 0.0)


def test_what_is_above_the_noise() -> None:
    assert sums((5.0, 5.0), (0.5, 0.5), floor_mm=3.0).above_mm == pytest.approx((4.0, 0.0))
    made = Shrink(Errors(5.0, 5.0, 5.0), Errors(2.0, 2.0, 2.0), 3.0, 0.5, None)
    assert made.shown_mm == pytest.approx((4.0, 0.0))
    assert made.off_edges is None
    edges = Shrink(Errors(5.0, 5.0, 5.0), Errors(3.0, 3.0, 3.0), 3.0, 0.5, None, (2.0, 0.5))
    assert edges.shown_mm == (2.0, 0.5)
    assert edges.off_edges == pytest.approx(1 - 0.25**2)
    assert Shrink(Errors(5.0, 5.0, 5.0), Errors(3.0, 3.0, 3.0), 3.0, 0.5, None, (0.0, 0.0)).off_edges is None


def test_blocks_hold_the_pixels_that_all_three_images_have() -> None:
    before = np.arange(20.0).reshape(4, 5) - 8.0
    after, floor2 = 2.0 * before, np.ones((4, 5))
    before[0, 0], after[0, 1], floor2[3, 4] = np.nan, np.nan, np.inf
    held = blocks([before, before], [after, after], [floor2, floor2], 2)
    np.testing.assert_array_equal(held.n, [2, 4, 2, 4, 4, 1] * 2)
    # The first block has the pixels -3 and -2, the last one 6.
    np.testing.assert_allclose(held.before[:, [0, 5]], [[-5, 6], [5, 6], [13, 36]])
    np.testing.assert_allclose(held.after[:, [0, 5]], [[-10, 12], [10, 12], [52, 144]])
    np.testing.assert_allclose(held.floor2, held.n)


@pytest.mark.parametrize(
    ("before", "after", "shrink"),
    [
        (5.0, 3.0, 16 / 25),
        (5.0, 0.0, 24 / 25),  # below the floor of 1 mm nothing is left to go
        (5.0, 6.0, -11 / 25),
        (1.02, 0.5, 0.02),
    ],
)
def test_the_shrink_of_mean_squares_above_the_floor(before: float, after: float, shrink: float) -> None:
    floor2, healthy2 = 1e-6, 1e-6
    found = _shrink(before, after, floor2, healthy2, 0.01)
    expected = shrink if before == 5.0 else (before**2 - 1) / before**2
    assert found == pytest.approx(expected)


@pytest.mark.parametrize(("before", "none"), [(1.0999, True), (1.1001, False)])
def test_a_gap_is_above_the_floor_by_a_share(before: float, *, none: bool) -> None:
    assert (_shrink(before, 0.5, 1e-6, 0.0, 0.1) is None) is none


def test_sets_of_blocks_are_drawn_with_replacement() -> None:
    held = sums((1.0, 2.0, 3.0, 4.0), (0.5, 1.0, 1.5, 2.0), floor_mm=1.0)
    drawn = _drawn(held, np.random.default_rng(1), 130)
    assert drawn.shape == (3, 130)
    np.testing.assert_allclose(drawn[1], drawn[0] / 4)
    np.testing.assert_allclose(drawn[2], 1e-6)
    again = np.concatenate([np.random.default_rng(1).multinomial(4, np.full(4, 0.25), size=50)])
    np.testing.assert_allclose(drawn[0, :50], again @ (1e-6 * np.array([1.0, 4.0, 9.0, 16.0])) / 4)
    assert drawn[0].mean() == pytest.approx(7.5e-6, rel=0.1)
    assert drawn[0].min() >= 1e-6
    assert drawn[0].max() <= 16e-6


def interval(monkeypatch: pytest.MonkeyPatch, draws: np.ndarray, held: HeldOut, unsure2: float = 0.0) -> tuple[float, tuple[float, float]]:
    """Value and interval where the bootstrap draws these mean squares (3, rounds)."""
    monkeypatch.setattr(room, "_drawn", lambda *_: draws)
    found = measure(held, np.random.default_rng(0), LIMITS, unsure2)
    assert found.shrink is not None
    assert found.ci95 is not None
    assert found.floor_mm == pytest.approx(1e3 * np.sqrt(held.floor2.sum() / held.n.sum()))
    return found.shrink, found.ci95


B2, A2, F2 = 25e-6, 9e-6, 1e-6
WHOLE = B2 - F2 + HEALTHY2
VALUE = (B2 - A2) / WHOLE
FLOOR = VALUE * LIMITS.noise_known * F2 / WHOLE
HELD = sums((5.0, 5.0), (3.0, 3.0))


def test_without_spread_the_interval_is_what_the_method_can_resolve_and_the_floor(monkeypatch: pytest.MonkeyPatch) -> None:
    same = np.tile(np.array([[B2], [A2], [F2]]), 200)
    value, (low, high) = interval(monkeypatch, same, HELD)
    assert value == pytest.approx(VALUE)
    assert low == pytest.approx(VALUE - np.hypot(LIMITS.resolution, FLOOR) - HIDDEN2 / WHOLE)
    assert high == 1.0
    _, (_, higher) = interval(monkeypatch, same, HELD, unsure2=20e-6)
    assert higher == pytest.approx(VALUE + np.hypot(LIMITS.resolution, FLOOR) + 20e-6 / WHOLE)


def test_draws_widen_it_by_their_quantiles(monkeypatch: pytest.MonkeyPatch) -> None:
    after = np.linspace(5e-6, 21e-6, 401)
    draws = np.stack([np.full(401, B2), after, np.full(401, F2)])
    _, (low, high) = interval(monkeypatch, draws, HELD, unsure2=20e-6)
    least, most = np.quantile((B2 - after) / WHOLE, [0.025, 0.975])
    assert low == pytest.approx(VALUE - np.hypot(VALUE - least, FLOOR) - HIDDEN2 / WHOLE)
    assert high == pytest.approx(VALUE + np.hypot(most - VALUE, FLOOR) + 20e-6 / WHOLE)


def test_draws_without_a_gap_say_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Half of the draws have less than the stated share of the gap: they do not count."""
    above = B2 - F2
    thin = F2 + 0.99 * LIMITS.drawn_share * above
    draws = np.stack([np.repeat([B2, thin], 100), np.repeat([A2, 0.0], 100), np.full(200, F2)])
    _, (low, _) = interval(monkeypatch, draws, HELD)
    assert low == pytest.approx(VALUE - np.hypot(LIMITS.resolution, FLOOR) - HIDDEN2 / WHOLE)
    _, (low, _) = interval(monkeypatch, np.stack([np.full(9, thin), np.zeros(9), np.full(9, F2)]), HELD)
    assert low == pytest.approx(VALUE - np.hypot(LIMITS.resolution, FLOOR) - HIDDEN2 / WHOLE)


def test_where_nothing_is_removed_nothing_shrinks() -> None:
    found = measure(sums((5.0, 4.0), (5.0, 4.0)), np.random.default_rng(0), LIMITS)
    assert found.shrink == 0.0
    assert found.ci95 == (0.0, 0.0)
