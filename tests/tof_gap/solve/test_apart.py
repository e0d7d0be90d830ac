# SPDX-License-Identifier: Apache-2.0
"""Objects and missing parts are set apart at poses that no object has displaced."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.tof_gap.quiet_views import VIEWS
from tests.tof_gap.quiet_views import views as quiet_views
from tof_align.chain import Chain
from tof_align.config import AlignConfig
from tof_core import se3
from tof_core.errors import RefusedError
from tof_gap.config import GapConfig
from tof_gap.solve import apart
from tof_gap.solve.apart import misfits, off_the_robot, set_apart
from tof_gap.solve.start import Start
from tof_scene.world.surprises import OBJECT, Surprises

CONFIG, ALIGN = GapConfig(), AlignConfig()
ARM_SD = ALIGN.priors.arm
"""Standard deviations (6,) of an arm's error, metres and radians."""


def chain(*off: float) -> Chain:
    """Arms off by so many standard deviations in each component, one view after the other; the others as the robot says."""
    still = np.broadcast_to(np.eye(4), (VIEWS, 4, 4))
    arms = np.array([se3.exp(size * ARM_SD) for size in (*off, *[0.0] * (VIEWS - len(off)))])
    return Chain(np.zeros(VIEWS, int), (0,), still[:1], still, still[:1], arms, np.eye(4), ALIGN.priors)


def test_views_are_off_the_robot_beyond_four_deviations_of_its_arm() -> None:
    assert np.flatnonzero(off_the_robot(chain(3.9, 4.1), CONFIG.solve.stray)).tolist() == [1]


def test_poses_with_a_covariance_of_their_own_are_never_off() -> None:
    own = replace(chain(50.0), root=np.broadcast_to(np.eye(6), (VIEWS, 6, 6)))
    assert not off_the_robot(own, CONFIG.solve.stray).any()


@pytest.mark.parametrize(
    ("share", "off", "found"),
    [(0.25, 2.7, [0]), (0.09, 2.7, []), (0.25, 1.2, [])],
    ids=["many pixels off, far from the robot", "few pixels off", "near the robot"],
)
def test_a_view_is_misfit_where_many_pixels_are_off_at_a_pose_far_from_the_robot(share: float, off: float, found: list[int]) -> None:
    begun = Start([], chain(off), quiet_views(np.random.default_rng(1)))
    for k, v in enumerate(begun.evidence):
        flat = np.zeros(v.residual.size)
        flat[: round(share * flat.size)] = -0.012
        v.residual[:] = np.random.default_rng(k).permutation(flat).reshape(v.residual.shape)
        v.edge[:] = False
    assert np.flatnonzero(misfits(begun, CONFIG.solve.stray)).tolist() == found
    given = replace(begun.chain, root=np.broadcast_to(np.eye(6), (VIEWS, 6, 6)))
    assert not misfits(Start([], given, begun.evidence), CONFIG.solve.stray).any()


@pytest.mark.parametrize(
    ("object_seen", "off", "misfit", "refused", "asked", "left"),
    [
        (True, 50.0, False, False, 1, "session"),  # an object pulled a view: the session solution places it
        (True, 50.0, False, True, 1, "first"),
        (True, 1.0, False, False, 0, "first"),
        (False, 50.0, False, False, 0, "first"),  # a stray view, with no object: stray views are judged later
        (False, 1.0, True, False, 1, "session"),  # a view between the CAD and an object, which none sees from there
        (True, 1.0, True, False, 1, "session"),
    ],
)
def test_the_session_solution_is_asked_where_the_robot_or_the_view_itself_contradicts_a_first_pose(
    monkeypatch: pytest.MonkeyPatch, *, object_seen: bool, off: float, misfit: bool, refused: bool, asked: int, left: str
) -> None:
    monkeypatch.setattr(apart, "misfits", lambda begun, _: np.arange(len(begun.evidence)) < misfit)
    seen = quiet_views(np.random.default_rng(1))
    asks: list[int] = []
    of_session = chain()

    def solved(*_: object) -> Any:
        asks.append(1)
        if refused:
            raise RefusedError("fits nowhere", where="alignment", todo="")
        return SimpleNamespace(chain=of_session)

    codes = tuple(np.full(v.residual.shape, OBJECT if object_seen and k == 0 else 0, np.uint8) for k, v in enumerate(seen))
    world = Surprises(codes, (), (SimpleNamespace(views=(0, 1), moves=False),) if object_seen else ())  # type: ignore[arg-type]
    monkeypatch.setattr(apart, "check_fit", lambda *_: None)
    monkeypatch.setattr(apart, "world_of", lambda *_: world)
    monkeypatch.setattr(apart, "solve_session", solved)
    monkeypatch.setattr(apart, "observe", lambda *_, **__: seen)
    begun = Start([v.view for v in seen], chain(off), seen)
    first = begun.chain
    found, start = set_apart(begun, None, CONFIG, ALIGN)  # type: ignore[arg-type]
    assert found is world
    assert len(asks) == asked
    assert start.chain is (of_session if left == "session" else first)
    assert bool(start.views[0].valid.any()) is not object_seen
    assert start.views[1].valid.any()
