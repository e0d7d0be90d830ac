# SPDX-License-Identifier: Apache-2.0
"""Views that contradict the robot are left out, unless many do."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from tests.tof_gap.quiet_views import VIEWS
from tests.tof_gap.quiet_views import views as quiet_views
from tof_core.reasons import Reason
from tof_gap.config import GapConfig
from tof_gap.solve import stray
from tof_gap.solve.start import Start
from tof_gap.solve.stray import solve_agreeing, stray_views, without_pixels

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_core.capture import View

LIMITS = GapConfig().solve.stray


def arms(*off: float, views: int = 20) -> Float:
    """Arm errors of one standard deviation in each component, and of `off` in the first views."""
    out = np.ones((views, 6))
    out[: len(off)] *= np.reshape(off, (-1, 1))
    return out


def recorded() -> list[View]:
    """A session of `VIEWS` views of a plane."""
    return [v.view for v in quiet_views(np.random.default_rng(1))]


def test_a_view_beyond_four_deviations_of_the_robot_is_stray() -> None:
    assert np.flatnonzero(stray_views(arms(4.1, 3.9), LIMITS)).tolist() == [0]


def test_the_error_is_that_of_all_six_components() -> None:
    one = arms(1.0)
    one[3, 2] = 9.0  # RMS (9² + 5) / 6: 3.8
    assert not stray_views(one, LIMITS).any()
    one[3, 2] = 10.0  # 4.2
    assert np.flatnonzero(stray_views(one, LIMITS)).tolist() == [3]


def test_many_stray_views_have_a_cause_in_common_and_all_stay() -> None:
    assert stray_views(arms(9.0, 9.0), LIMITS).sum() == 2
    assert not stray_views(arms(9.0, 9.0, 9.0), LIMITS).any()


def test_a_stray_view_stays_in_its_place_without_depth() -> None:
    views = recorded()[:3]
    kept, emptied, last = without_pixels(views, np.array([False, True, False]))
    assert kept is views[0]
    assert last is views[2]
    assert views[1].valid.any()
    assert not emptied.valid.any()
    assert (emptied.reason[views[1].valid] == Reason.NOT_CAD).all()


@pytest.mark.parametrize(("off", "left_out"), [(1.0, ()), (9.0, (1,))])
def test_the_session_is_solved_again_without_the_stray_view(monkeypatch: pytest.MonkeyPatch, off: float, left_out: tuple[int, ...]) -> None:
    errors = arms(1.0, off, views=VIEWS)
    asked: list[list[View]] = []

    def solve(begun: Start, *_: object) -> tuple[Any, GapConfig]:
        asked.append(list(begun.views))
        chain = SimpleNamespace(root=None)
        return SimpleNamespace(chain=chain, design=None, selection=SimpleNamespace(chosen=None)), GapConfig()

    monkeypatch.setattr(stray, "solve_moving", solve)
    monkeypatch.setattr(stray, "Selector", lambda *_: SimpleNamespace(arms=lambda _: errors, arms_sd=np.ones(6)))
    monkeypatch.setattr(stray, "observe", lambda *_, **__: ())
    views = recorded()
    *_, solved, found = solve_agreeing(Start(views, None, ()), None, GapConfig())  # type: ignore[arg-type]
    assert found == left_out
    assert len(asked) == 1 + len(left_out)
    assert [not v.valid.any() for v in solved] == [i in left_out for i in range(VIEWS)]
