# SPDX-License-Identifier: Apache-2.0
"""Loss of the same pixels in every view is a filter's; loss of the scene's dark places, of the rim or at random is not."""

from __future__ import annotations

import numpy as np
import pytest

from tests.tof_gap.quiet_views import SHAPE
from tests.tof_gap.seen.missing.test_by_line import session
from tof_gap.limits.missing import MissingLimits
from tof_gap.seen.missing.by_pixel import lost_by_pixels

LIMITS = MissingLimits()


@pytest.mark.parametrize("returned", [0.0, 0.5])
def test_offsets_of_pixels_are_lost_in_every_view(returned: float) -> None:
    steep = np.random.default_rng(2).random(SHAPE) < 0.1
    assert lost_by_pixels(session(lambda _, rng: steep & (rng.random(SHAPE) >= returned)), LIMITS)


@pytest.mark.parametrize("share", [0.0, 0.01, 0.3])
def test_loss_at_random_is_of_other_pixels_in_each_view(share: float) -> None:
    assert not lost_by_pixels(session(lambda _, rng: rng.random(SHAPE) < share), LIMITS)


def test_loss_towards_the_rim_of_the_image_is_alike_around_each_pixel() -> None:
    row, column = np.mgrid[: SHAPE[0], : SHAPE[1]]
    rim = np.hypot(row / SHAPE[0] - 0.5, column / SHAPE[1] - 0.5) / 0.7
    assert not lost_by_pixels(session(lambda _, rng: rng.random(SHAPE) < 0.5 * rim**2), LIMITS)


def test_a_dark_surface_at_the_same_place_in_every_view_is_lost_for_its_light() -> None:
    dark = np.zeros(SHAPE, bool)
    dark[20:26, 30:60] = True
    lossy = session(lambda _, rng: dark & (rng.random(SHAPE) < 0.9))
    assert lost_by_pixels(lossy, LIMITS), "without what the light predicts, they are the same pixels"
    assert not lost_by_pixels(lossy, LIMITS, [np.where(dark, 0.9, 0.0)] * len(lossy))


def test_a_few_dead_pixels_do_not_make_other_loss_one_by_pixels() -> None:
    dead = np.zeros(SHAPE, bool)
    dead[:: SHAPE[0] - 1, :: SHAPE[1] - 1] = True
    assert lost_by_pixels(session(lambda *_: dead), LIMITS), "they are all that is lost"
    assert not lost_by_pixels(session(lambda _, rng: dead | (rng.random(SHAPE) < 0.01)), LIMITS)


def test_few_views_do_not_show_it() -> None:
    steep = np.random.default_rng(2).random(SHAPE) < 0.1
    assert not lost_by_pixels(session(lambda *_: steep)[:1], LIMITS)
