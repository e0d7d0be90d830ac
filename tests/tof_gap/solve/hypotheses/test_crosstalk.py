# SPDX-License-Identifier: Apache-2.0
"""Light of one phase beside the pixel's own: off a cover glass it bends range as phasors add, and no wave over range stands in for it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.tof_gap.quiet_views import CAMERA, SHAPE, VIEWS, chain, views
from tests.tof_gap.solve.hypotheses.test_free import ASKED, HAND_SD, NAMED, radial
from tof_align.folds import deal
from tof_gap.limits.solve import SelectLimits
from tof_gap.solve.choose.select import select
from tof_gap.solve.hypotheses.candidate import Candidate
from tof_gap.solve.hypotheses.columns import ColumnStore, build
from tof_gap.solve.hypotheses.crosstalk import USUAL_MHZ, Crosstalk, crosstalk
from tof_gap.solve.hypotheses.free import STRAY_LIGHT, curves
from tof_sensor.effects.amplitude_bias import AmplitudeBias
from tof_sensor.effects.wiggling import Wiggling
from tof_sensor.frame import LIGHT_M_PER_S

if TYPE_CHECKING:
    from tof_core.arrays import Float

SHARE, PSI = 0.015, 1.0
"""Amount of the light off the glass over the median pixel's, and its phase."""


def bent_by_glass(mhz: float) -> Float:
    """(V, H, W) metres along the ray by the exact sum of two phasors."""
    r = radial()
    own = np.stack([v.frame.amplitude for v in views(np.random.default_rng(5))])
    own = own / np.median(own)
    turn = 4e6 * np.pi * mhz / LIGHT_M_PER_S
    both = own * np.exp(1j * turn * r) + SHARE * np.exp(1j * PSI)
    return np.asarray(np.angle(both * np.exp(-1j * turn * r)) / turn)


def test_two_columns_are_the_error_of_the_sum_of_two_phasors_to_first_order() -> None:
    view = views(np.random.default_rng(0))[3]
    at = np.arange(SHAPE[0] * SHAPE[1])
    bare, unit = Crosstalk(60.0), float(np.median(view.frame.amplitude))
    turn = 4e6 * np.pi * 60.0 / LIGHT_M_PER_S
    own = view.frame.amplitude / unit
    r = view.frame.radial
    small = 1e-3
    exact = np.angle(own + small * np.exp(1j * (PSI - turn * r)))
    made = bare.along_ray(view, at) @ (unit * small * np.array([-np.cos(PSI), np.sin(PSI)]))
    np.testing.assert_allclose(made, exact.ravel(), atol=1e-5)


def test_columns_are_along_z_and_their_mean_over_the_session_is_zero() -> None:
    seen = views(np.random.default_rng(0))
    one = crosstalk(seen, (60.0,))[0].free
    assert isinstance(one, Crosstalk)
    length = CAMERA.ray_length().ravel()
    every = np.concatenate([one.columns(v) * length[v.pixels, None] for v in seen])
    np.testing.assert_allclose(every.mean(axis=0), 0.0, atol=1e-12)
    np.testing.assert_allclose(one.share(np.array([1.0, 2.0]), seen[0]).ravel()[seen[0].pixels], one.columns(seen[0]) @ [1.0, 2.0])


def test_stated_frequencies_and_their_mean_replace_the_usual_ones() -> None:
    seen = views(np.random.default_rng(0))
    for stated, tried in (((), USUAL_MHZ), ((80.0, 60.0), (80.0, 60.0, 70.0)), ((20.0,), (20.0,))):
        assert tuple(c.free.modulation_mhz for c in crosstalk(seen, stated) if isinstance(c.free, Crosstalk)) == tried


@pytest.mark.parametrize("mhz", [60.0, 70.0])
def test_light_off_a_cover_glass_has_no_name_and_is_no_wave_over_range(mhz: float) -> None:
    extra = bent_by_glass(mhz)
    seen = views(np.random.default_rng(5), extra)
    tested = [Candidate(e.NAME, e) for e in NAMED] + curves(seen, ASKED) + crosstalk(seen, ())
    store = ColumnStore(seen, deal([0] * VIEWS, SelectLimits().folds))
    found = select(build(store, tested, chain(), HAND_SD), SelectLimits())
    assert found.unknown == (STRAY_LIGHT,)
    assert {tested[m].name for m in found.chosen.members} == {"unknown"}


def test_a_hypothesis_contains_stray_light_once() -> None:
    seen = views(np.random.default_rng(0))
    one, other = crosstalk(seen, (60.0, 80.0))[:2]
    (curve,) = [c for c in curves(seen, ASKED) if c.note == STRAY_LIGHT]
    assert one.excludes(other)
    assert one.excludes(curve)
    assert not one.excludes(next(c for c in curves(seen, ASKED) if c.note == "row"))


def test_crosstalk_explains_no_rest_of_an_error_by_amplitude() -> None:
    (one, *_) = crosstalk(views(np.random.default_rng(0)), (60.0,))
    dark = Candidate("amplitude_bias", AmplitudeBias())
    assert one.excludes(dark)
    assert dark.excludes(one)
    assert not one.excludes(Candidate("wiggling", Wiggling()))
