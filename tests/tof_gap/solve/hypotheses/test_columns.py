# SPDX-License-Identifier: Apache-2.0
"""Columns as one system: what no pixel shows is held, and stays within what a part can do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from tests.tof_gap.quiet_views import VIEWS, chain, views
from tests.tof_sensor.plane import NORMAL
from tof_align.folds import deal
from tof_gap.limits.noise import NoiseLimits
from tof_gap.seen.session import session_of
from tof_gap.solve.hypotheses.candidate import Candidate
from tof_gap.solve.hypotheses.columns import ColumnStore, build
from tof_sensor.effects.cad_deviation import COEFFICIENT_SD, CadDeviation
from tof_sensor.effects.intrinsics import Intrinsics
from tof_sensor.effects.range_offset import RangeOffset


def test_a_part_does_not_slide_along_its_own_plane() -> None:
    facing = np.eye(4)
    facing[:3, :3] = Rotation.align_vectors([[1.0, 0.0, 0.0]], [NORMAL])[0].as_matrix()  # y and z of the cell lie in the plane
    seen = [
        replace(v, frame=replace(v.frame, rendering=replace(v.rendering, T_cell_camera=facing)))
        for v in views(np.random.default_rng(4), np.full((VIEWS, 1, 1), 0.002))
    ]
    effect = CadDeviation.of(session_of(seen, NoiseLimits()), 0)
    design = build(ColumnStore(seen, deal([0] * VIEWS, 6)), [Candidate(effect.NAME, effect)], chain(), np.full(6, 1e-5))
    values = design.system.fit(design.groups[0]).theta / design.scale
    assert (np.abs(values) < 2 * COEFFICIENT_SD).all()


def test_the_lens_within_its_calibration_has_the_form_of_the_wrong_lens_beside_it() -> None:
    seen = views(np.random.default_rng(4), np.full((VIEWS, 1, 1), 0.002))
    lenses = [Candidate("intrinsics", Intrinsics(z_from=lens)) for lens in ("stated_lens", "true_lens")]
    offset = Candidate("range_offset", RangeOffset())
    store = ColumnStore(seen, deal([0] * VIEWS, 6))
    design = build(store, [offset, *lenses], chain(), np.full(6, 1e-5), np.array([1e-3, 1e-3, 0.1, 0.1]))
    k = design.groups[-1][-1] + 1
    stated, true = np.arange(k, k + 4), np.arange(k + 4, k + 8)
    np.testing.assert_array_equal(design.active([0]), [*stated, *design.groups[0]])
    np.testing.assert_array_equal(design.active([0, 1]), [*stated, *design.groups[0], *design.groups[1]])
    np.testing.assert_array_equal(design.active([2]), [*true, *design.groups[2]])
    np.testing.assert_array_equal(design.scale[stated], design.scale[design.groups[1][:4]])
    np.testing.assert_array_equal(design.scale[true], design.scale[design.groups[2][:4]])
    exact = build(store, lenses, chain(), np.full(6, 1e-5))
    np.testing.assert_array_equal(exact.active([1]), exact.groups[1])
