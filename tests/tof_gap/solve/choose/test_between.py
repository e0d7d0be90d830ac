# SPDX-License-Identifier: Apache-2.0
"""Before a board, an effect shows within views or only between them: on columns that are drawn, so that the right answer is known."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tof_align.chain import Chain
from tof_align.columns import ColumnSystem
from tof_align.columns import Priors as Known
from tof_align.config import Priors
from tof_gap.limits.solve import SelectLimits
from tof_gap.solve.choose.between import _unknowns, shown, with_suspect
from tof_gap.solve.choose.judge import Hypothesis, Selector
from tof_gap.solve.choose.select import narrowed, select
from tof_gap.solve.choose.worth import rescored
from tof_gap.solve.hypotheses.candidate import Candidate
from tof_gap.solve.hypotheses.columns import Design
from tof_sensor.effects.range_offset import RangeOffset
from tof_sensor.effects.wiggling import Wiggling

if TYPE_CHECKING:
    from tof_core.arrays import Float

PIXELS, NOISE_M, POSE_M, HELD = 300, 0.002, 3e-4, np.full(6, 1e-6)
LONG, SHORT = (Candidate(Wiggling.NAME, Wiggling(modulation_mhz=mhz)) for mhz in (37.5, 150.0))
OFFSET = Candidate(RangeOffset.NAME, RangeOffset())


def judge_of(wave_m: float, scatter_m: float, *, views: int = 12, spread_m: float = 1e-3, root: bool = True, seed: int = 1) -> Selector:
    """Views at ranges of 0.6 to 1.4 m, each `spread_m` deep, before a camera with an offset of 10 mm and a wave of 1 m.

    Views are off by `scatter_m` as a whole; their distance is known to 0.3 mm. Columns: an offset, the true wave, a shorter one.
    """
    rng, grams = np.random.default_rng(seed), []
    for at in rng.permutation(np.linspace(0.6, 1.4, views)):
        r = at + spread_m * rng.uniform(-0.5, 0.5, PIXELS)
        waves = [f(2 * np.pi * r / p) for p in (1.0, 0.25) for f in (np.sin, np.cos)]
        camera = np.stack([rng.normal(size=PIXELS), rng.normal(size=PIXELS), np.ones(PIXELS), *rng.normal(size=(3, PIXELS))], axis=1)
        e = 0.010 + wave_m * waves[0] + scatter_m * rng.normal() + NOISE_M * rng.normal(size=PIXELS)
        X = np.concatenate([camera, np.ones((PIXELS, 1)), np.stack(waves, axis=1), e[:, None]], axis=1)
        grams.append((X / NOISE_M).T @ (X / NOISE_M))
    one, many, each = np.eye(4)[None], np.tile(np.eye(4), (views, 1, 1)), np.full(views, float(PIXELS))
    roots = np.tile(POSE_M * np.eye(6), (views, 1, 1)) if root else None
    chain = Chain(np.zeros(views, int), (0,), one, many, one, many, np.eye(4), Priors(arm_mm=0.3, arm_deg=0.02), roots)
    system = ColumnSystem.of(grams, chain, np.full(5, 0.05), Known(HELD, HELD), each, each / NOISE_M**2, each)
    groups = tuple(np.arange(a, b) for a, b in ((0, 1), (1, 3), (3, 5)))
    return Selector(Design((OFFSET, LONG, SHORT), groups, np.ones(5), system), SelectLimits())


def with_wave(judge: Selector) -> Hypothesis:
    return rescored(judge, (0, 1))


@pytest.mark.parametrize(
    ("wave_m", "views", "determined"),
    [
        (0.004, 12, False),  # twice the scatter of 2 mm
        (0.004, 24, True),
        (0.020, 12, True),  # as a published look-up table
        (0.020, 24, True),
    ],
)
def test_between_views_a_wave_is_compared_with_their_scatter(wave_m: float, views: int, *, determined: bool) -> None:
    judge = judge_of(wave_m, 0.002, views=views)
    assert shown(judge, with_wave(judge), 1) is determined
    assert shown(judge, with_wave(judge), 0), "the offset is many times the scatter"


def test_chance_is_what_the_limit_says() -> None:
    """Views that differ by chance alone: with the limit at a half, a wave of three unknowns is believed now and then, at 1e-3 never."""
    by_chance = [judge_of(0.0, 0.002, seed=seed) for seed in range(20)]
    for judge in by_chance:
        assert not shown(judge, with_wave(judge), 1)
        judge.config = replace(judge.config, chance=0.5)
    assert 1 <= sum(shown(j, with_wave(j), 1) for j in by_chance) <= 10


def test_what_shows_within_views_needs_no_comparison_of_views() -> None:
    judge = judge_of(0.004, 0.002, spread_m=0.5)
    assert shown(judge, with_wave(judge), 1)


def test_where_poses_are_fitted_to_depth_nothing_is_asked() -> None:
    judge = judge_of(0.004, 0.002, root=False)
    assert judge.apart is None
    assert shown(judge, with_wave(judge), 1)
    assert with_suspect(judge, rescored(judge, (0,)))[1] == ()


def test_more_unknowns_than_views_determine_nothing() -> None:
    judge = judge_of(0.020, 0.0, views=4)
    assert not shown(judge, with_wave(judge), 1)


def test_a_wave_that_predicts_other_views_is_suspected_in_its_longest_form() -> None:
    judge = judge_of(0.004, 0.002)
    found, suspected = with_suspect(judge, rescored(judge, (0,)))
    assert (found.members, suspected) == ((0, 1), (1,))
    none = judge_of(0.0, 0.0005)
    assert with_suspect(none, rescored(none, (0,)))[1] == (), "it predicts nothing"
    kept = with_wave(judge)
    assert with_suspect(judge, kept) == (kept, ()), "a wave is a member already"


def test_a_selection_suspects_what_it_may_not_assert() -> None:
    few = judge_of(0.004, 0.002)
    found = select(few.design, few.config)
    assert set(found.chosen.members) == {0, 1}
    assert found.suspected == (1,)
    assert narrowed(few.design, few.config, found, [0]).suspected == ()
    table = judge_of(0.020, 0.002)
    found = select(table.design, table.config)
    assert (set(found.chosen.members), found.suspected) == ({0, 1}, ())


def distances(judge: Selector, system: ColumnSystem | None) -> Float:
    """(V,) metres by which each view moves along its optical axis if nothing else explains its error."""
    assert system is not None
    own = system.fit(np.zeros(0, np.int64)).arm
    assert system.chain.root is not None
    return np.asarray(np.einsum("vij,vj->vi", system.chain.root, own)[:, 2])


def test_a_free_distance_takes_all_of_a_view_s_error_and_a_known_one_by_its_deviation() -> None:
    judge = judge_of(0.0, 0.002)
    free, held = distances(judge, judge.apart), distances(judge, judge.design.system)
    np.testing.assert_allclose(np.abs(free), 0.010, atol=0.006)  # an offset of 10 mm, and three standard deviations of the scatter
    assert np.abs(free).mean() == pytest.approx(0.010, abs=0.001)
    np.testing.assert_allclose(held / free, POSE_M**2 / (POSE_M**2 + NOISE_M**2 / PIXELS), rtol=0.03)


def test_a_column_that_is_naught_everywhere_is_no_unknown() -> None:
    judge = judge_of(0.004, 0.002)
    assert [_unknowns(judge, m) for m in range(3)] == [1, 3, 3], "sine, cosine and period; an offset has one form"
    gram = judge.design.system.normal.gram
    first = judge.design.system.normal.shared - judge.design.system.columns
    gram[:, first + 2], gram[:, :, first + 2] = 0.0, 0.0
    assert _unknowns(judge, 1) == 2
