# SPDX-License-Identifier: Apache-2.0
"""A ghost image: the light of the pixel on the other side of the optical axis bends range as phasors add, and no named effect stands in for it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.tof_gap.quiet_views import CAMERA, SHAPE, VIEWS, chain, views
from tests.tof_gap.solve.hypotheses.test_free import ASKED, HAND_SD, NAMED, radial
from tof_align.folds import deal
from tof_core.camera import Camera
from tof_gap.limits.solve import SelectLimits
from tof_gap.solve.choose.select import select
from tof_gap.solve.hypotheses.candidate import Candidate
from tof_gap.solve.hypotheses.columns import ColumnStore, build
from tof_gap.solve.hypotheses.crosstalk import USUAL_MHZ, crosstalk
from tof_gap.solve.hypotheses.free import curves
from tof_gap.solve.hypotheses.ghost import GHOST, Ghost, counterparts, ghosts
from tof_sensor.effects.fixed_pattern import FixedPattern
from tof_sensor.effects.lens_scatter import LensScatter
from tof_sensor.frame import LIGHT_M_PER_S

if TYPE_CHECKING:
    from tof_core.arrays import Float

MHZ, SHARE = 60.0, 0.05


def bent_by_the_ghost(mhz: float, share: float) -> Float:
    """(V, H, W) metres along the ray by the exact sum of each pixel's phasor and that of its counterpart."""
    r = radial()
    own = np.stack([v.frame.amplitude for v in views(np.random.default_rng(5))])
    turn = 4e6 * np.pi * mhz / LIGHT_M_PER_S
    phasor = own * np.exp(1j * turn * r)
    both = phasor + share * phasor[:, ::-1, ::-1]
    return np.asarray(np.angle(both * np.exp(-1j * turn * r)) / turn)


def test_counterparts_lie_on_the_other_side_of_the_optical_axis() -> None:
    camera = Camera(width=5, height=4, fx=4.0, fy=4.0, cx=2.0, cy=1.0)
    there, inside = counterparts(camera, np.array([0, 5 + 2, 4, 3 * 5 + 2]))
    np.testing.assert_array_equal(inside, [True, True, True, False])
    np.testing.assert_array_equal(there[inside], [2 * 5 + 4, 5 + 2, 2 * 5 + 0])


def test_the_column_is_the_error_of_the_sum_of_two_phasors_to_first_order() -> None:
    small, every = 1e-4, np.arange(SHAPE[0] * SHAPE[1])
    view = views(np.random.default_rng(5))[3]
    made = small * Ghost(MHZ).along_ray(view, every)[:, 0]
    np.testing.assert_allclose(made, bent_by_the_ghost(MHZ, small)[3].ravel(), rtol=2e-3, atol=1e-9)


def test_a_counterpart_outside_of_the_image_is_unknown() -> None:
    view = views(np.random.default_rng(5))[0]
    shifted = Camera(CAMERA.width, CAMERA.height, CAMERA.fx, CAMERA.fy, CAMERA.cx + 8.0, CAMERA.cy)
    _, inside = counterparts(shifted, np.arange(SHAPE[0] * SHAPE[1]))
    assert (~inside).reshape(SHAPE)[:, :16].all()
    assert np.isfinite(Ghost(MHZ).columns(view)).all()


def test_stated_frequencies_and_their_mean_replace_the_usual_ones() -> None:
    seen = views(np.random.default_rng(0))
    for stated, tried in (((), USUAL_MHZ), ((80.0, 60.0), (80.0, 60.0, 70.0))):
        assert tuple(c.free.modulation_mhz for c in ghosts(seen, stated) if isinstance(c.free, Ghost)) == tried


@pytest.mark.parametrize("mhz", [60.0, 70.0])
def test_a_ghost_image_has_no_name_and_is_no_scattering_and_no_stray_light(mhz: float) -> None:
    seen = views(np.random.default_rng(5), bent_by_the_ghost(mhz, SHARE))
    named = [*(e for e in NAMED if not isinstance(e, FixedPattern)), LensScatter(modulation_mhz=60.0)]
    tested = [Candidate(e.NAME, e) for e in named] + curves(seen, ASKED) + crosstalk(seen, ()) + ghosts(seen, ())
    store = ColumnStore(seen, deal([0] * VIEWS, SelectLimits().folds))
    found = select(build(store, tested, chain(), HAND_SD), SelectLimits())
    assert found.unknown == (GHOST,)
    assert {tested[m].name for m in found.chosen.members} == {"unknown"}
