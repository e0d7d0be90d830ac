# SPDX-License-Identifier: Apache-2.0
"""Patterns of lines: found at their size where neighbours err by opposite amounts, and not in noise alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.tof_gap.quiet_views import SHAPE, SIGMA_M, views
from tof_gap.seen.evidence.correlation import NoiseCorrelation
from tof_gap.tell.line_means import line_sizes_m
from tof_gap.tell.unexplained import lines_off

NOISE2 = [np.full(SHAPE, SIGMA_M**2)]


def noise(count: int) -> list[np.ndarray]:
    return list(np.random.default_rng(3).normal(0, SIGMA_M, (count, *SHAPE)))


@pytest.mark.parametrize("lines", ["column", "row"])
def test_lines_that_err_by_turns_have_their_size_and_the_others_none(lines: str) -> None:
    seen = views(np.random.default_rng(0))
    turns = 1e-3 * (-1.0) ** np.arange(SHAPE[1] if lines == "column" else SHAPE[0])
    pattern = turns[None, :] if lines == "column" else turns[:, None]
    sizes = line_sizes_m(seen, [e + pattern for e in noise(len(seen))], NOISE2 * len(seen))
    assert sizes.pop(lines) == pytest.approx(1e-3, rel=0.05)
    assert max(sizes.values()) < 1e-4


def test_noise_has_no_size_also_where_neighbours_share_it() -> None:
    seen = views(np.random.default_rng(0))
    assert max(line_sizes_m(seen, noise(len(seen)), NOISE2 * len(seen)).values()) < 0.1 * SIGMA_M
    alike = [np.repeat(np.repeat(e[::3, ::3], 3, axis=0), 3, axis=1)[: SHAPE[0], : SHAPE[1]] for e in noise(len(seen))]
    shared = [replace(v, correlation=replace(NoiseCorrelation(), area=9.0)) for v in seen]
    assert max(line_sizes_m(shared, alike, NOISE2 * len(seen)).values()) < 0.15 * SIGMA_M


def test_pixels_that_do_not_count_and_lines_without_any_are_left_out() -> None:
    seen = views(np.random.default_rng(0))
    left = [np.where(np.arange(SHAPE[1]) < 10, np.nan, e + 2e-3) for e in noise(len(seen))]
    assert line_sizes_m(seen, left, NOISE2 * len(seen))["column"] == pytest.approx(2e-3, rel=0.03)
    nothing = [np.full(SHAPE, np.nan)] * len(seen)
    assert line_sizes_m(seen, nothing, NOISE2 * len(seen)) == {"column": 0.0, "row": 0.0}


def test_lines_count_from_a_size_and_a_share_of_the_gap_on() -> None:
    sizes = {"column": 1.6e-3, "row": 0.3e-3}
    assert lines_off(sizes, 0.4, 0.5) == ("column",)
    assert lines_off(sizes, 0.2, 0.05) == ("column", "row")
    assert lines_off(sizes, 0.4, 3.0) == (), "beside a larger gap it is an error of a named map"
