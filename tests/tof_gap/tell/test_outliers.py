# SPDX-License-Identifier: Apache-2.0
"""Losses that a filter in the camera makes of outliers: what makes the outliers explains them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from tof_gap.limits.filters import FilterLimits
from tof_gap.seen.finding import Finding
from tof_gap.tell.outliers import fails_to_merge, hides_light, not_outliers, removed_outliers
from tof_sensor.effects.ambient import Ambient
from tof_sensor.effects.dropout import Dropout
from tof_sensor.effects.noise import Noise
from tof_sensor.effects.phase_wrap import PhaseWrap

if TYPE_CHECKING:
    from tof_sensor.effect import Effect

LIMITS = FilterLimits()


@pytest.mark.parametrize(
    ("loss", "may_be"),
    [
        (Finding(Dropout(threshold=0.1), 1.0, rare=True), True),
        (Finding(Dropout(threshold=0.1), 1.0), False),
        (Finding(PhaseWrap(), 1.0), False),
    ],
)
def test_loss_that_is_neither_random_nor_below_a_threshold_may_be_a_filter_s(loss: Finding, *, may_be: bool) -> None:
    noise = Finding(Noise(extra_m=0.001), 1.0)
    assert removed_outliers(loss, [noise], LIMITS) is may_be
    assert not removed_outliers(loss, [], LIMITS), "nothing else makes outliers"


@pytest.mark.parametrize(("share", "scattered"), [(0.02, True), (0.98, False)])
def test_pixels_that_are_unwrapped_wrongly_here_and_there_are_what_a_filter_removes(share: float, *, scattered: bool) -> None:
    loss = Finding(Dropout(threshold=0.3, random=0.2), 1.0)
    assert removed_outliers(loss, [Finding(PhaseWrap(share=share), 1.0)], LIMITS) is scattered


@pytest.mark.parametrize(
    ("wrap", "fails"),
    [
        (PhaseWrap(share=0.004), True),  # single pixels jump by a period of one of two frequencies
        (PhaseWrap(share=0.95), False),  # all pixels beyond the range of one frequency
        (PhaseWrap(share=0.95, others_m=(0.6,), others_share=(0.3,)), True),
        (Dropout(threshold=0.1), False),
    ],
)
def test_frequencies_fail_to_merge_where_single_pixels_jump_or_by_several_lengths(wrap: Effect, *, fails: bool) -> None:
    assert fails_to_merge(Finding(wrap, 0.95, corrects=True)) is fails


def wraps_removed(*at: tuple[int, int]) -> Finding:
    """Wrong unwrapping of which a filter left holes of 3 x 3 pixels around these pixels of one view."""
    holes = np.zeros((40, 40), bool)
    for row, column in at:
        holes[row - 1 : row + 2, column - 1 : column + 2] = True
    return Finding(PhaseWrap(share=0.1), 0.6, holes=(holes,))


def unstable(*at: tuple[int, int]) -> Finding:
    """Noise of these pixels alone."""
    own = np.zeros((40, 40), bool)
    own[tuple(np.transpose(at))] = True
    return Finding(Noise(extra_m=0.002), 0.95, own_noise=own)


def test_holes_around_pixels_with_a_noise_of_their_own_are_no_failed_unwrapping() -> None:
    holes, jumps = wraps_removed((5, 5), (20, 20)), Finding(PhaseWrap(share=0.1), 0.9, corrects=True)
    single, even = unstable((5, 5), (20, 21)), Finding(Noise(extra_m=0.002), 0.95)
    assert removed_outliers(holes, [single, holes], LIMITS)
    assert not removed_outliers(holes, [unstable((12, 12), (30, 8)), holes], LIMITS), "other pixels were removed"
    assert not removed_outliers(holes, [even, holes], LIMITS)
    assert not removed_outliers(jumps, [single, jumps], LIMITS), "jumps of one size are wrapped phases beside any noise"


def test_wraps_that_unstable_pixels_explain_explain_no_loss() -> None:
    loss, holes = Finding(Dropout(threshold=0.1), 0.9), wraps_removed((5, 5))
    assert not_outliers([loss, holes], [unstable((5, 5))], LIMITS) == [loss]
    assert not_outliers([loss, holes], [unstable((30, 30))], LIMITS) == [holes]


@pytest.mark.parametrize(
    ("loss", "may_be"),
    [(Dropout(random=0.03), True), (Dropout(random=0.08), False), (Dropout(threshold=0.1, random=0.03), False)],
    ids=["few", "more than outliers", "in weak light"],
)
def test_noise_of_every_pixel_at_every_amplitude_makes_few_outliers_at_random(loss: Dropout, *, may_be: bool) -> None:
    everywhere, in_the_dark = (Finding(Noise(extra_m=0.005), 0.95, everywhere=of) for of in (True, False))
    assert removed_outliers(Finding(loss, 0.9), [everywhere], LIMITS) is may_be
    assert not removed_outliers(Finding(loss, 0.9), [in_the_dark], LIMITS)


@pytest.mark.parametrize(("lost", "hides"), [(0.03, False), (0.11, True)])
def test_light_is_judged_beside_a_few_pixels_that_fail_to_merge_and_explains_them(lost: float, *, hides: bool) -> None:
    wraps, light = Finding(PhaseWrap(share=0.1), 0.6, holes=(np.ones((4, 4), bool),), lost=lost), Finding(Ambient(surface_m=0.001), 0.95)
    assert hides_light(wraps) is hides
    assert not_outliers([wraps], [light], LIMITS) == ([wraps] if hides else [])
    assert not_outliers([wraps], [], LIMITS) == [wraps]


@pytest.mark.parametrize(("share", "hides"), [(0.02, False), (0.2, True)])
def test_pixels_that_are_seen_to_jump_hide_light_where_they_are_many(share: float, *, hides: bool) -> None:
    jumps = np.zeros((3, 10, 10))
    jumps.ravel()[: round(share * jumps.size)] = 1.5
    assert hides_light(Finding(PhaseWrap(share=share), 0.9, share=jumps, corrects=True)) is hides
