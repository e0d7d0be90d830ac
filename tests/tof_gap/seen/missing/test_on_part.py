# SPDX-License-Identifier: Apache-2.0
"""A part loses pixels by itself where neither its darkness nor a filter in the camera explains them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.tof_gap.quiet_views import views
from tof_gap.limits.missing import MissingLimits
from tof_gap.seen.missing.on_part import may_lose, neighbours_span, own_light, worst_part

LIMITS = MissingLimits()
PART = np.repeat([0, 1], [20_000, 2000])
"""A floor and a small part."""
CAD_LIGHT = np.full(len(PART), 100.0)
FLAT = np.full(len(PART), 0.2)
VIEW = np.arange(len(PART)) % 2
"""Two views see every part."""


def rng(seed: int = 4) -> np.random.Generator:
    return np.random.default_rng(seed)


def lost_on_the_part(share: float) -> np.ndarray:
    """(n,) 1 for a share of the small part's pixels, at random."""
    return np.where(PART == 1, rng().uniform(size=len(PART)) < share, 0.0).astype(float)


def test_the_worst_part_is_the_one_that_loses_the_largest_share() -> None:
    light = rng(5).uniform(90, 110, len(PART))
    assert worst_part(lost_on_the_part(0.2), PART, VIEW, light, FLAT, np.inf, LIMITS) == pytest.approx(0.2, abs=0.03)
    assert worst_part(np.zeros(len(PART)), PART, VIEW, light, FLAT, np.inf, LIMITS) == 0.0


@pytest.mark.parametrize(("share", "may"), [(0.2, True), (0.06, True), (0.001, False), (0.0, False)])
def test_few_lost_pixels_end_the_search(share: float, *, may: bool) -> None:
    assert may_lose(lost_on_the_part(share), PART, LIMITS) is may


def test_a_part_of_which_most_may_be_among_the_darkest_is_looked_at() -> None:
    """900 of 50,000 pixels, of which 30 are lost: the darkest fiftieth may hold the others."""
    part = np.repeat([0, 1], [49_100, 900])
    gone = np.where(np.arange(len(part)) >= len(part) - 30, 1.0, 0.0)
    assert may_lose(gone, part, LIMITS)


def test_loss_that_one_view_alone_shows_is_not_the_parts() -> None:
    """As where a ghost image cancels the light of a part in one view."""
    light = rng(5).uniform(90, 110, len(PART))
    gone = np.where(VIEW == 1, lost_on_the_part(0.4), 0.0)
    assert worst_part(gone, PART, VIEW, light, FLAT, np.inf, LIMITS) == 0.0
    many = np.arange(len(PART)) % 4
    assert worst_part(np.where(many > 1, lost_on_the_part(0.4), 0.0), PART, many, light, FLAT, np.inf, LIMITS) == pytest.approx(
        0.13, abs=0.03
    )


@pytest.mark.parametrize(("span", "counts"), [(0.8, True), (1.2, False)])
def test_what_slope_and_noise_span_beyond_a_filter_is_the_filters(span: float, *, counts: bool) -> None:
    light = rng(5).uniform(90, 110, len(PART))
    spans = np.where(PART == 1, span, 0.2)
    assert (worst_part(lost_on_the_part(0.2), PART, VIEW, light, spans, np.inf, LIMITS) > 0.1) is counts


def test_pixels_lost_by_their_light_are_no_filters() -> None:
    """The darker fifth of a noisy part is lost: a threshold."""
    light = rng().uniform(90, 110, len(PART))
    gone = ((PART == 1) & (light < 94)).astype(float)
    spans = np.where(PART == 1, 3.0, 0.2)
    assert worst_part(gone, PART, VIEW, light, spans, np.inf, LIMITS) == pytest.approx(0.2, abs=0.03)


def test_a_part_that_is_darker_than_the_cad_says_is_among_the_weakest_light() -> None:
    """300 pixels with a fifth of the CAD's light, those lost without an amplitude: the weakest fiftieth is not judged."""
    part = np.repeat([0, 1], [20_000, 300])
    cad = rng(5).uniform(90, 110, len(part))
    gone = np.where(part == 1, rng().uniform(size=len(part)) < 0.5, 0.0).astype(float)
    seen = np.where(gone > 0, np.nan, np.where(part == 1, 0.2, 1.0) * cad)
    judged = replace(LIMITS, part_pixels=100)
    light = own_light(seen, cad, part, judged)
    np.testing.assert_allclose(light[part == 1], 0.2 * cad[part == 1], rtol=1e-12)
    assert worst_part(gone, part, np.arange(len(part)) % 2, light, np.zeros(len(part)), np.inf, judged) == 0.0
    assert worst_part(gone, part, np.arange(len(part)) % 2, cad, np.zeros(len(part)), np.inf, judged) == pytest.approx(0.5, abs=0.1)


def test_few_amplitudes_state_no_albedo_and_the_measured_one_goes_first() -> None:
    seen = np.full(len(PART), np.nan)
    seen[PART == 1] = np.where(np.arange(2000) < 40, 20.0, np.nan)
    light = own_light(seen, CAD_LIGHT, PART, LIMITS)
    assert light[PART == 1].tolist() == [20.0] * 40 + [100.0] * 1960
    np.testing.assert_array_equal(light[PART == 0], 100.0)


def test_light_that_saturates_elsewhere_is_no_loss_of_the_part() -> None:
    light = rng().uniform(90, 110, len(PART))
    gone = ((PART == 1) & (light > 106)).astype(float)
    assert worst_part(gone, PART, VIEW, light, FLAT, 105.0, LIMITS) == 0.0
    assert worst_part(gone, PART, VIEW, light, FLAT, 120.0, LIMITS) == pytest.approx(0.2, abs=0.03)


def test_a_neighbourhood_spans_its_slope_and_three_deviations_of_one_captures_noise() -> None:
    (view, *_) = views(rng())
    still = replace(view, sigma=np.zeros_like(view.sigma))
    tan60 = np.tan(np.radians(60.0))
    np.testing.assert_allclose(neighbours_span(still, LIMITS), np.tan(view.rendering.incidence) / tan60, rtol=1e-5)
    passed = 2.0 * view.frame.depth * view.view.camera.pixel_angle * tan60
    rough = replace(view, view=replace(view.view, captures=4))
    expected = np.hypot(np.tan(view.rendering.incidence) / tan60, 3.0 * 2.0 * view.sigma / passed)
    np.testing.assert_allclose(neighbours_span(rough, LIMITS), expected, rtol=1e-5)
