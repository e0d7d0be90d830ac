# SPDX-License-Identifier: Apache-2.0
"""The end of a session's solution, with its pieces given: which views have a say in a station's base, and where it is held."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from tests.tof_align.made import CONFIG, ROBOT
from tof_align import session as room
from tof_align import verdict as verdicts
from tof_align.observability import observe
from tof_align.parts import PART
from tof_align.session import _disputed, _keep
from tof_align.system import FREE_PART_M, SessionSystem
from tof_align.verdict import Fit, Information
from tof_core import se3

if TYPE_CHECKING:
    from tof_core.arrays import Float

EYE = np.eye(4)
OPEN = observe(np.diag([1e8, 1e-8, 1e8, 1e8, 1e8, 1e8]), np.diag(ROBOT), EYE, np.zeros(3), lever=0.3, ratio=0.5)
KNOWN = observe(1e8 * np.eye(6), np.diag(ROBOT), EYE, np.zeros(3), lever=0.3, ratio=0.5)


def information(agreeing: float) -> Information:
    """A view that knows all six directions equally; of x only a share agrees."""
    return Information(1e8 * np.diag([agreeing, 1, 1, 1, 1, 1]), 1e8 * np.eye(6))


def disputed(monkeypatch: pytest.MonkeyPatch, supports: tuple[float, ...], shares: tuple[float, ...], mode: str = "session") -> Any:
    """Two stations, the views dealt to them in turn; a camera is where its base is."""
    fits, infos = (iter(each) for each in (supports, shares))
    monkeypatch.setattr(verdicts, "fit_of", lambda *_: Fit(1000, next(fits), 1e-3, 1e-3))
    monkeypatch.setattr(verdicts, "information_of", lambda *_: information(next(infos)))
    station = np.arange(len(supports)) % 2
    rig = SimpleNamespace(station=station, links=lambda _: (np.eye(6, 12), np.eye(6)), frame=lambda _: EYE)
    system: Any = SimpleNamespace(rig=rig, views=[None] * len(supports), weights=[None] * len(supports))
    config: Any = replace(CONFIG, mode=mode)
    return _disputed(system, [np.zeros(0)] * len(supports), [KNOWN, KNOWN], config)


def test_a_station_s_views_dispute_a_direction_together(monkeypatch: pytest.MonkeyPatch) -> None:
    first, second = disputed(monkeypatch, (0.9, 0.9, 0.9, 0.9), (0.2, 1.0, 0.6, 1.0))
    assert first == (pytest.approx(0.4, abs=1e-3), "slides along cell x")
    assert second[0] == pytest.approx(1.0)


@pytest.mark.parametrize(("support", "share"), [(0.5, 0.6), (0.499, 1.0)])
def test_a_view_that_fits_nowhere_has_no_say(monkeypatch: pytest.MonkeyPatch, support: float, share: float) -> None:
    shares = (0.2, 1.0, 1.0, 1.0) if support >= 0.5 else (1.0, 1.0, 1.0)
    assert disputed(monkeypatch, (support, 0.9, 0.9, 0.9), shares)[0][0] == pytest.approx(share, abs=1e-3)


def test_the_robot_s_own_information_agrees(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where no view has a say, the prior alone is left, which disputes nothing."""
    assert [d[0] for d in disputed(monkeypatch, (0.1, 0.1), ())] == pytest.approx([1.0, 1.0])


def test_without_a_session_nothing_is_disputed(monkeypatch: pytest.MonkeyPatch) -> None:
    assert disputed(monkeypatch, (0.9, 0.9), (0.1, 0.1), mode="per_view") == [(1.0, ""), (1.0, "")]


def kept(seen: list[Any], moved: Float) -> Any:
    """Two stations with unit information about twelve unknowns that want to move by one each; the second base has moved."""
    asked: dict[str, Any] = {}
    system: Any = SimpleNamespace(
        normal=lambda _: SimpleNamespace(info=np.zeros(13)),
        rig=SimpleNamespace(frame=lambda _: EYE, B=[EYE, moved]),
    )
    answer: Any = SimpleNamespace(sizes="sizes")

    def solve(_normal: Any, sizes: Any, pull: Any) -> str:
        asked.update(sizes=sizes, H=pull[0], b=pull[1])
        return "again"

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(room, "solve", solve)
        return _keep(system, None, answer, seen), asked, answer


def test_where_all_is_known_the_answer_stands() -> None:
    found, asked, answer = kept([KNOWN, KNOWN], EYE)
    assert found is answer
    assert asked == {}


def test_a_base_is_held_along_what_the_data_leave_open() -> None:
    """The second station's y is open, and it has moved by 3 mm there: it is pulled back by as much, and nothing else is."""
    moved = se3.exp([0.001, 0.003, 0, 0, 0, 0])
    found, asked, _ = kept([KNOWN, OPEN], moved)
    assert (found, asked["sizes"]) == ("again", "sizes")
    strength = asked["H"][7, 7]
    assert strength > 1e9
    expected = np.zeros(13)
    expected[7] = -0.003 * strength
    np.testing.assert_allclose(asked["b"], expected, atol=1e-6 * strength)
    other = asked["H"].copy()
    other[7, 7] = 0.0
    np.testing.assert_allclose(other, 0.0, atol=1e-6 * strength)


def test_without_a_part_s_vote_the_cameras_stand_where_a_solution_without_its_prior_has_them() -> None:
    """Eighteen shared unknowns, of which the last twelve are two parts' motions, and two views with arms of their own."""
    rng = np.random.default_rng(5)
    root = rng.normal(size=(18, 18))
    sizes = {f"{PART}3": 2e-3, f"{PART}7": 5e-2}
    prior = np.repeat([2e-3, 5e-2], 6) ** -2.0
    info = root @ root.T * 1e3 + np.diag([*np.zeros(6), *prior])
    cov, x = np.linalg.inv(info), rng.normal(size=18)
    gain = rng.normal(size=(2, 9, 18))
    shared, arm = rng.normal(size=(2, 6, 6)), rng.normal(size=(2, 6, 4))
    where = np.stack([rng.permutation(18), rng.permutation(18)])
    system: Any = SimpleNamespace(
        _part_columns=np.arange(6, 18).reshape(2, 6),
        views=[None, None],
        basis=SimpleNamespace(parts=SimpleNamespace(index=np.array([3, 7]))),
        rig=SimpleNamespace(links=lambda v: (shared[v], arm[v])),
    )
    answer: Any = SimpleNamespace(sizes=sizes, cov=cov, x=x, where=where, gain=gain)
    found = SessionSystem.without_each_part(system, answer)
    for p, size in enumerate((2e-3, 5e-2)):
        own = slice(6 + 6 * p, 12 + 6 * p)
        free = info.copy()
        free[own, own] -= np.eye(6) * (size**-2 - FREE_PART_M**-2)
        step = np.linalg.solve(free, info @ x) - x
        for v in range(2):
            mine = step[where[v]]
            expected = shared[v] @ mine[:6] - arm[v] @ (gain[v] @ mine)[:4]
            np.testing.assert_allclose(found[p, v], expected, rtol=1e-6, atol=1e-9)


def test_a_view_counts_beside_what_the_robot_knows(monkeypatch: pytest.MonkeyPatch) -> None:
    """A view that knows x as well as the robot does, and agrees in nothing of it: half of what is known of x is disputed."""
    x = ROBOT[0] ** -2.0
    weak = Information(np.diag([0.0, *[1e8] * 5]), np.diag([x, *[1e8] * 5]))
    monkeypatch.setattr(verdicts, "fit_of", lambda *_: Fit(1000, 0.9, 1e-3, 1e-3))
    monkeypatch.setattr(verdicts, "information_of", lambda *_: weak)
    rig = SimpleNamespace(station=np.zeros(1, int), links=lambda _: (np.eye(6, 12), np.eye(6)), frame=lambda _: EYE)
    system: Any = SimpleNamespace(rig=rig, views=[None], weights=[None])
    config = replace(CONFIG, mode="session")
    np.testing.assert_allclose(config.priors.base, ROBOT)
    ((share, direction),) = _disputed(system, [np.zeros(0)], [KNOWN], config)
    assert share == pytest.approx(0.5)
    assert direction == "slides along cell x"
