# SPDX-License-Identifier: Apache-2.0
"""Blocks of pixels that err alike in every view: neither lines, nor single pixels, nor a smooth field."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tests.tof_gap.quiet_views import SHAPE, VIEWS, views
from tof_gap.seen.evidence.areas import area_map, area_maps_of_others
from tof_gap.seen.evidence.pattern import line_means_of_others, pattern_columns
from tof_sensor.effects.fixed_pattern import FixedPattern, packed

if TYPE_CHECKING:
    from tof_core.arrays import Float

SIDE = 16
OFFSETS = np.random.default_rng(4).normal(0, 0.003, (SHAPE[0] // SIDE + 1, SHAPE[1] // SIDE + 1))
BLOCKS: Float = np.asarray(np.kron(OFFSETS, np.ones((SIDE, SIDE))), np.float64)[: SHAPE[0], : SHAPE[1]]
"""Each block of pixels has a converter of its own."""


def test_offsets_of_blocks_are_seen_at_their_size() -> None:
    found = area_map(views(np.random.default_rng(1), np.stack([BLOCKS] * VIEWS)))
    inner = np.ix_(range(24, SHAPE[0] - 24), range(24, SHAPE[1] - 24))
    assert np.corrcoef(found[inner].ravel(), BLOCKS[inner].ravel())[0, 1] > 0.75
    assert 0.3 < found[inner].std() / BLOCKS[inner].std() < 1.0


def test_each_view_is_judged_by_what_views_of_other_folds_show() -> None:
    own = np.random.default_rng(2).normal(0, 0.003, (VIEWS, *OFFSETS.shape))
    error = np.stack([np.kron(o, np.ones((SIDE, SIDE)))[: SHAPE[0], : SHAPE[1]] for o in own])
    seen, folds = views(np.random.default_rng(1), error), np.arange(VIEWS) % 4
    maps = area_maps_of_others(seen, folds)
    for fold, of_others in zip(folds, maps, strict=True):
        expected = area_map([view for view, other in zip(seen, folds, strict=True) if other != fold])
        np.testing.assert_allclose(of_others, expected, rtol=1e-9, atol=1e-15)
    shared = np.mean([np.corrcoef(m[v.smooth], e[v.smooth])[0, 1] for m, e, v in zip(maps, error, seen, strict=True)])
    assert abs(shared) < 0.2, "what a view has of its own does not predict itself"


def test_blocks_need_the_column_of_areas() -> None:
    seen, folds = views(np.random.default_rng(1), np.stack([BLOCKS] * VIEWS)), np.arange(VIEWS) % 4
    lines, none = line_means_of_others(seen, folds), np.zeros(SHAPE)

    def left_mm(maps: list[Float]) -> float:
        columns = np.concatenate([pattern_columns(*of, FixedPattern(lines=16)) for of in zip(seen, lines, maps, strict=True)])
        depth = np.concatenate([BLOCKS.ravel()[v.pixels] / v.frame.length.ravel()[v.pixels] for v in seen])
        return float(1e3 * np.sqrt(np.mean((depth - columns @ np.linalg.lstsq(columns, depth, rcond=None)[0]) ** 2)))

    assert left_mm([none] * VIEWS) > 2.0
    assert left_mm(area_maps_of_others(seen, folds)) < 1.6


def test_the_pattern_holds_areas_beside_single_pixels() -> None:
    frame = views(np.random.default_rng(1))[0].frame
    pattern = FixedPattern(areas=packed(BLOCKS), pixels=packed(np.full(SHAPE, 1e-3)))
    np.testing.assert_allclose((pattern.bias(frame) * frame.length)[frame.valid], (BLOCKS + 1e-3)[frame.valid], atol=1.1e-5)
    np.testing.assert_allclose((pattern.smooth.bias(frame) * frame.length)[frame.valid], BLOCKS[frame.valid], atol=1e-5)
