# SPDX-License-Identifier: Apache-2.0
"""Single pixels that err alike in every view: their image, their size, and the scatter without them."""

from __future__ import annotations

import numpy as np
import pytest

from tests.tof_gap.quiet_views import SHAPE, VIEWS, views
from tof_core.stats import trimmed_std
from tof_gap.seen.evidence.pattern import line_means, line_means_of_others, pattern_columns, single_pixels, without_pattern
from tof_sensor.effects.fixed_pattern import FixedPattern

RNG = np.random.default_rng(11)
PATTERN = RNG.normal(0, 0.003, SHAPE)


def test_pixels_that_err_alike_in_every_view_are_told_from_scatter() -> None:
    found = single_pixels(views(RNG, np.stack([PATTERN] * VIEWS)))
    assert found.size_m == pytest.approx(0.003, rel=0.1)
    wrong = found.image - PATTERN
    assert trimmed_std(wrong) < 0.5 * 0.003
    assert np.sqrt(found.unsure2.mean()) == pytest.approx(trimmed_std(wrong), rel=0.25)


def test_scatter_alone_has_no_pattern() -> None:
    found = single_pixels(views(RNG))
    assert found.size_m == 0.0
    assert not found.image.any()


@pytest.mark.parametrize("fit", [range(VIEWS), range(8)])
def test_scatter_is_that_of_the_photons_once_the_pattern_is_off(fit: range) -> None:
    plain = views(np.random.default_rng(3))
    patterned = views(np.random.default_rng(3), np.stack([PATTERN] * VIEWS))
    assert np.median(patterned[0].sigma / plain[0].sigma) > 1.15
    found = single_pixels([patterned[i] for i in fit])
    cleaned = without_pattern(patterned, [found.image / v.frame.length for v in patterned], found.unsure2, list(fit))
    ratio = [float(np.median(c.sigma / p.sigma)) for c, p in zip(cleaned, plain, strict=True)]
    assert np.mean([ratio[i] for i in fit]) == pytest.approx(1.0, abs=0.03)
    assert np.mean(ratio) == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize(("pattern", "left_mm"), [(FixedPattern(), 0.75), (FixedPattern(lines=16), 0.15)])
def test_steps_between_groups_of_columns_need_the_cosines_of_columns(pattern: FixedPattern, left_mm: float) -> None:
    """Clock buffers of 28 columns each, 2 mm up and down: too fine for the smooth field, too wide to stand out from neighbouring columns."""
    steps = 0.002 * np.sign(np.sin(2 * np.pi * np.arange(SHAPE[1]) / 56.0))
    seen = views(RNG, np.stack([np.broadcast_to(steps, SHAPE)] * VIEWS))
    folds = np.arange(VIEWS) % 4
    lines = line_means_of_others(seen, folds)
    none = np.zeros(SHAPE)
    columns = np.concatenate([pattern_columns(view, of_view, none, pattern) for view, of_view in zip(seen, lines, strict=True)])
    depth = np.concatenate([np.broadcast_to(steps, SHAPE).ravel()[v.pixels] / v.frame.length.ravel()[v.pixels] for v in seen])
    fitted = columns @ np.linalg.lstsq(columns, depth, rcond=None)[0]
    assert 1e3 * np.sqrt(np.mean((depth - fitted) ** 2)) == pytest.approx(left_mm, abs=0.15)


def test_lines_are_judged_by_what_views_of_other_folds_show() -> None:
    seen, folds = views(RNG, np.stack([PATTERN] * VIEWS)), np.arange(VIEWS) % 4
    for fold, (by_column, by_row) in zip(folds, line_means_of_others(seen, folds), strict=True):
        expected = line_means([view for view, other in zip(seen, folds, strict=True) if other != fold])
        np.testing.assert_allclose(by_column, expected[0], rtol=1e-9, atol=1e-15)
        np.testing.assert_allclose(by_row, expected[1], rtol=1e-9, atol=1e-15)
