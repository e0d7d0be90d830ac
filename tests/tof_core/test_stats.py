# SPDX-License-Identifier: Apache-2.0
"""Robust spread, second differences and groups, against values worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import ndtri

from tof_core.stats import (
    MAD_TO_STD,
    beside,
    blocks,
    by_group,
    group_medians,
    grouped,
    hats,
    joined,
    least_deviations,
    pairs_below,
    robust_std,
    robust_stds,
    second_differences,
    squares,
    touched,
    trimmed_std,
)


def test_factor_is_that_of_a_normal_distribution() -> None:
    assert pytest.approx(1 / ndtri(0.75), abs=5e-5) == MAD_TO_STD


def test_robust_std_of_five_numbers_and_of_none() -> None:
    assert robust_std([1.0, 2.0, 3.0, 4.0, 100.0]) == pytest.approx(1.4826 * 1.0)
    assert robust_std([1.0, 2.0, 3.0, 4.0, 100.0], centre=0.0) == pytest.approx(1.4826 * 3.0)
    assert robust_std([]) == 0.0


def test_parts_are_joined_in_single_precision_and_may_be_fewer_than_expected() -> None:
    one = joined(iter([np.array([1.0, 2.0]), np.zeros(0), np.array([0.1])]), 5)
    assert one.tolist() == [1.0, 2.0, float(np.float32(0.1))]
    assert len(joined([], 0)) == 0


def test_robust_stds_of_columns() -> None:
    samples = np.array([[1.0, 10.0], [2.0, 20.0], [4.0, 70.0]])
    assert robust_stds(samples) == pytest.approx([1.4826 * 1.0, 1.4826 * 10.0])
    assert robust_stds(samples, np.array([1.0, 20.0])) == pytest.approx([1.4826 * 1.0, 1.4826 * 10.0])


def test_trimmed_std_drops_outliers_and_keeps_tails() -> None:
    rng = np.random.default_rng(0)
    mixture = np.concatenate([rng.normal(0, 1.0, 9000), rng.normal(0, 2.0, 1000)])
    spoilt = np.concatenate([mixture, np.full(100, 50.0)])
    assert trimmed_std(spoilt) == pytest.approx(mixture.std(), rel=0.02)
    assert spoilt.std() > 3 * mixture.std()
    assert robust_std(spoilt) < 0.97 * trimmed_std(spoilt), "the median alone does not see the tails"
    mostly_equal = np.array([0.0, 0.0, 0.0, 3.0])
    assert trimmed_std(mostly_equal) == pytest.approx(mostly_equal.std())


def test_second_differences_by_hand() -> None:
    assert second_differences(np.array([1.0, 4.0, 9.0, 17.0])) * np.sqrt(6) == pytest.approx([2.0, 3.0])
    assert second_differences(np.array([0.0, 5.0, 1.0, 7.0, 4.0]), step=2) * np.sqrt(6) == pytest.approx([2.0])


def test_second_differences_remove_a_plane_and_keep_the_noise_std() -> None:
    rng = np.random.default_rng(1)
    y, x = np.mgrid[:200, :300]
    image = 3.0 * x - 2.0 * y + rng.normal(0, 0.5, (200, 300))
    for axis, shape in ((0, (198, 300)), (1, (200, 298))):
        d2 = second_differences(image, axis=axis)
        assert d2.shape == shape
        assert d2.std() == pytest.approx(0.5, rel=0.02)
        assert abs(d2.mean()) < 0.01
    assert second_differences(image, axis=1, step=5).shape == (200, 290)


def test_groups_are_counted_summed_and_averaged() -> None:
    view, part = np.array([0, 1, 0, 1, 1]), np.array([7, 2, 7, 2, 9])
    groups = grouped(view, part)
    assert groups.which.tolist() == [0, 1, 0, 1, 2]
    assert groups.count.tolist() == [2, 2, 1]
    assert [k.tolist() for k in groups.keys] == [[0, 1, 1], [7, 2, 9]]
    values = np.array([1.0, 2.0, 3.0, 4.0, 5.0])
    assert groups.sum(values).tolist() == [4.0, 6.0, 5.0]
    assert groups.mean(values).tolist() == [2.0, 3.0, 5.0]
    assert groups.sum(values > 1).tolist() == [1.0, 2.0, 1.0]


@pytest.mark.parametrize("part", [203, 999, 1000, 1203, 70_000])
def test_block_keeps_the_number_of_its_part(part: int) -> None:
    where = np.ones((12, 18), bool)
    parts = np.where(np.arange(18) < 6, part, 3)[None, :].repeat(12, axis=0)
    groups = blocks(where, 6, parts[where])
    assert sorted(zip(*(k.tolist() for k in groups.keys), strict=True)) == [
        *((0, 0, part), (0, 1, 3), (0, 2, 3)),
        *((1, 0, part), (1, 1, 3), (1, 2, 3)),
    ]
    assert groups.count.tolist() == [36] * 6


def test_blocks_follow_the_order_of_the_masked_image() -> None:
    image = np.arange(24.0).reshape(4, 6)
    where = image != 7.0
    groups = blocks(where, 2)
    assert groups.count.tolist() == [3, 4, 4, 4, 4, 4]
    assert groups.mean(image[where])[0] == pytest.approx((0 + 1 + 6) / 3)
    assert groups.mean(image[where])[-1] == pytest.approx((16 + 17 + 22 + 23) / 4)


def test_no_samples_make_no_groups() -> None:
    groups = blocks(np.zeros((4, 4), bool), 2)
    assert groups.count.size == 0
    assert groups.sum(np.zeros(0)).size == groups.mean(np.zeros(0)).size == 0


def test_a_negative_key_is_refused() -> None:
    with pytest.raises(ValueError, match="invalid entry"):
        grouped(np.array([0, 1]), np.array([-1, 2]))


KEYS = st.lists(st.tuples(st.integers(0, 5000), st.integers(0, 5000), st.integers(0, 5000)), min_size=1, max_size=50)


@given(KEYS)
def test_samples_share_a_group_exactly_when_all_their_keys_agree(rows: list[tuple[int, int, int]]) -> None:
    groups = grouped(*np.array(rows).T)
    named = list(zip(*(k.tolist() for k in groups.keys), strict=True))
    assert [named[g] for g in groups.which] == rows
    assert named == sorted(set(rows))


def test_of_pairs_the_smaller_ones_count_and_half_of_the_equal_ones() -> None:
    """1 lies below 2 and 3, 2 below 3, and one pair of two is equal: of six pairs three and a half."""
    assert pairs_below(np.array([1.0, 2.0, 4.0]), np.array([2.0, 3.0])) == 3.5
    assert pairs_below(np.array([1.0]), np.zeros(0)) == 0.0


def test_hats_are_one_at_their_knot_and_constant_beyond_the_ends() -> None:
    columns = hats(np.array([-1.0, 0.0, 0.25, 1.0, 3.0, 9.0]), [0.0, 1.0, 3.0])
    np.testing.assert_allclose(columns, [[1.0, 0, 0], [1.0, 0, 0], [0.75, 0.25, 0], [0.0, 1.0, 0], [0.0, 0, 1.0], [0.0, 0, 1.0]])


@pytest.mark.parametrize("scale", [1e-3, 1.0, 50.0])
def test_trimmed_std_goes_with_the_scale(scale: float) -> None:
    samples = np.random.default_rng(4).normal(2.0, 1.0, 5000)
    assert trimmed_std(scale * samples) == pytest.approx(scale * trimmed_std(samples))


def test_touched_are_entries_above_a_tenth_of_nearly_the_largest() -> None:
    """Of 201 sizes other than 0 the 99.5 % quantile is the largest but one: 2, so 0.201 is touched and 0.199 is not."""
    values = np.concatenate([np.zeros(500), np.full(99, -2.0), np.full(50, 0.201), np.full(51, -0.199), [1000.0]])
    np.testing.assert_array_equal(touched(values), np.abs(values) > 0.2)


def test_a_map_of_zeros_is_touched_nowhere() -> None:
    assert not touched(np.zeros(4)).any()
    assert touched(np.array([0.0, 1e-9])).tolist() == [False, True]
    assert touched(np.zeros(0)).shape == (0,)


def test_squares_of_an_image_have_zeros_beyond_its_end() -> None:
    found = squares(np.arange(1.0, 7.0).reshape(2, 3), 2)
    assert found.shape == (1, 2, 2, 2)
    assert found[0, :, 0].tolist() == [[1.0, 2.0], [4.0, 5.0]]
    assert found[0, :, 1].tolist() == [[3.0, 0.0], [6.0, 0.0]]


def test_the_median_of_each_group_counts_from_the_fewest_samples_on() -> None:
    values, group = np.array([5.0, 1.0, 9.0, 2.0, 4.0]), np.array([2, 0, 2, 0, 2])
    np.testing.assert_array_equal(group_medians(values, group, 4), [1.5, 0.0, 5.0, 0.0])
    np.testing.assert_array_equal(group_medians(values, group, 4, least=3), [0.0, 0.0, 5.0, 0.0])


@pytest.mark.parametrize("last", [255, 256, 65536])
def test_samples_of_any_number_of_groups_are_told_apart(last: int) -> None:
    found = by_group(np.array([3.0, 1.0, 2.0]), np.array([last, 0, last]), last + 1)
    assert len(found) == last + 1
    assert found[0].tolist() == [1.0]
    assert found[last].tolist() == [3.0, 2.0]


def test_values_beside_orthonormal_columns_have_no_part_in_them() -> None:
    basis = np.array([[0.6], [0.8]])
    np.testing.assert_allclose(beside(basis, np.array([1.0, 0.0])), [0.64, -0.48])
    np.testing.assert_allclose(beside(basis, np.eye(2)), [[0.64, -0.48], [-0.48, 0.36]])


def test_least_deviations_do_not_follow_outliers() -> None:
    """A line through 20 points, of which three are off by 10: least squares would have a slope of 0.4 more."""
    x = np.arange(20.0)
    y = 2.0 + 3.0 * x
    y[-3:] += 10.0
    assert least_deviations(np.column_stack([np.ones(20), x]), y, 0.02) == pytest.approx([2.0, 3.0], abs=0.05)
