# SPDX-License-Identifier: Apache-2.0
"""A pane of glass delays all light into one region of the cell: found from the residuals, it has no name, and no part stands in for it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.tof_gap.quiet_views import CAMERA, SHAPE, VIEWS, chain, views
from tests.tof_gap.solve.hypotheses.test_free import ASKED, HAND_SD, NAMED
from tests.tof_sensor.plane import NORMAL
from tof_align.folds import deal
from tof_core import se3
from tof_gap.limits.solve import SelectLimits
from tof_gap.solve.choose.select import select
from tof_gap.solve.hypotheses.candidate import Candidate
from tof_gap.solve.hypotheses.columns import ColumnStore, build
from tof_gap.solve.hypotheses.cubes import Cells
from tof_gap.solve.hypotheses.free import curves
from tof_gap.solve.hypotheses.region import REGION, Region, regions
from tof_sensor.effects.cad_deviation import CadDeviation
from tof_sensor.effects.fixed_pattern import FixedPattern
from tof_sensor.effects.subsurface import Subsurface
from tof_sensor.geometry import cell_points

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tof_core.arrays import Float
    from tof_gap.seen.evidence.view import ViewEvidence

FOLDS = deal([0] * VIEWS, SelectLimits().folds)
GLASS_M = 3e-3


def behind_glass() -> Float:
    """(H, W) whether a pixel looks through the pane: to a little right of the middle of the part, upper three quarters."""
    column, row = np.meshgrid(np.arange(SHAPE[1]), np.arange(SHAPE[0]))
    return ((column > 0.55 * SHAPE[1]) & (row < 0.75 * SHAPE[0])).astype(float)


def through_glass(delay_m: float, noise: int = 5) -> tuple[ViewEvidence, ...]:
    """Views of one plane from twelve distances; in all of them the pane covers the same place of the cell."""
    seen = views(np.random.default_rng(noise))
    placed = [replace(v, frame=replace(v.frame, rendering=replace(v.rendering, T_cell_camera=backwards(k)))) for k, v in enumerate(seen)]
    late = [inside(v, placed[0]) * delay_m / v.frame.length for v in placed]
    return tuple(replace(v, residual=(v.residual + z).astype(np.float32)) for v, z in zip(placed, late, strict=True))


def backwards(k: int) -> Float:
    """(4, 4) the camera of view `k`, so far from the plane that the plane is where the first camera sees it."""
    T = np.eye(4)
    T[:3, 3] = 0.05 * k * NORMAL
    return T


def inside(view: ViewEvidence, first: ViewEvidence) -> Float:
    """(H, W) whether the points of a view lie where the first camera looks through the pane."""
    points = cell_points(view.frame) @ se3.inverse(first.rendering.T_cell_camera)[:3, :3].T
    u = CAMERA.fx * points[..., 0] / points[..., 2] + CAMERA.cx
    v = CAMERA.fy * points[..., 1] / points[..., 2] + CAMERA.cy
    return ((u > 0.55 * SHAPE[1]) & (v < 0.75 * SHAPE[0])).astype(float)


def region_of(seen: Sequence[ViewEvidence]) -> Region:
    (one,) = regions(seen, FOLDS)
    assert isinstance(one.free, Region)
    return one.free


def test_a_region_is_a_set_of_cubes_and_contains_nothing_beyond_them() -> None:
    cells = Cells(0.1, np.array([-1.0, 0.0, 0.0]), (3, 2, 1), np.array([0, 3]))
    points = np.array([[-0.05, 0.05, 0.05], [0.05, 0.15, 0.01], [0.05, 0.05, 0.05], [-0.15, 0.05, 0.05], [0.05, 0.15, 0.11], [np.nan] * 3])
    np.testing.assert_array_equal(cells.contain(points), [True, True, False, False, False, False])


def test_the_region_behind_a_pane_is_found_by_the_views_of_other_folds() -> None:
    seen = through_glass(GLASS_M)
    region = region_of(seen)
    every = np.arange(SHAPE[0] * SHAPE[1])
    found = np.array([region.along_ray(v, every).reshape(SHAPE) for v in seen])
    there = np.array([inside(v, seen[0]) for v in seen])
    assert found[there > 0].mean() > 0.9
    assert found[there == 0].mean() < 0.1
    assert len({id(region.cells[v.view.stamp_ns]) for v in seen}) == SelectLimits().folds


def test_the_delay_is_zero_elsewhere_and_one_along_the_ray_within() -> None:
    seen = through_glass(GLASS_M)
    region, view = region_of(seen), seen[0]
    share = region.share(np.array([GLASS_M]), view) * view.frame.length
    assert set(np.unique(share.round(9))) == {0.0, GLASS_M}


def test_no_region_without_other_views_to_find_it_by() -> None:
    seen = through_glass(GLASS_M)
    assert regions(seen, np.zeros(VIEWS, int)) == []
    assert regions([replace(v, pixels=v.pixels[:0]) for v in seen], FOLDS) == []


def test_noise_alone_wins_nothing() -> None:
    seen = through_glass(0.0)
    tested = [Candidate(e.NAME, e) for e in NAMED] + regions(seen, FOLDS)
    found = select(build(ColumnStore(seen, FOLDS), tested, chain(), HAND_SD), SelectLimits())
    assert found.chosen.members == ()


@pytest.mark.parametrize("delay_m", [2e-3, 4e-3])
def test_a_pane_has_no_name_and_is_no_deviation_of_the_part_and_no_function_of_place(delay_m: float) -> None:
    seen = through_glass(delay_m)
    # All views look from one side: there, the pane is a pattern of the image as well.
    named = [*(e for e in NAMED if not isinstance(e, FixedPattern)), CadDeviation(part=0), Subsurface(part=0)]
    tested = [Candidate(e.NAME, e) for e in named] + curves(seen, ASKED) + regions(seen, FOLDS)
    found = select(build(ColumnStore(seen, FOLDS), tested, chain(), HAND_SD), SelectLimits())
    assert found.unknown == (REGION,)
    assert {tested[m].name for m in found.chosen.members} == {"unknown"}
