# SPDX-License-Identifier: Apache-2.0
"""Motion of brief frames: a moving session without `motion` is solved again with pixels nearer to edges."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from tof_gap.config import GapConfig
from tof_gap.solve import brief
from tof_gap.solve.start import Start

if TYPE_CHECKING:
    from tof_gap.solve.solution import Joint

CONFIG = GapConfig()
BEGUN = Start((), None, ())  # type: ignore[arg-type]


def joint(*names: str) -> Joint:
    """A solution that chose effects of these names."""
    candidates = [SimpleNamespace(name=n) for n in names]
    chosen = SimpleNamespace(members=tuple(range(len(names))))
    made: Any = SimpleNamespace(
        views=(),
        design=SimpleNamespace(candidates=candidates),
        selection=SimpleNamespace(chosen=chosen),
        members=lambda: [(c, None) for c in candidates],
    )
    return made  # type: ignore[no-any-return]


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[GapConfig]:
    """The settings of every solution that is asked for; the session moves."""
    monkeypatch.setattr(brief, "moving", lambda _: True)
    monkeypatch.setattr(brief, "observe", lambda *_, **__: ())
    monkeypatch.setattr(brief, "shows_motion", lambda *_: True)
    return []


def solved(monkeypatch: pytest.MonkeyPatch, asked: list[GapConfig], *solutions: Joint, left_out: str = "") -> tuple[Joint, GapConfig]:
    """What is returned where one solution after the other is found."""
    found = iter(solutions)

    def solve(begun: Start, caster: object, config: GapConfig, left_out: frozenset[str]) -> Joint:
        del begun, caster, left_out
        asked.append(config)
        return next(found)

    monkeypatch.setattr(brief, "solve", solve)
    return brief.solve_moving(BEGUN, None, CONFIG, frozenset({left_out}))  # type: ignore[arg-type]


def test_motion_that_shows_in_brief_frames_alone_is_of_that_solution_and_its_pixels(
    monkeypatch: pytest.MonkeyPatch, asked: list[GapConfig]
) -> None:
    again = joint("motion")
    solution, config = solved(monkeypatch, asked, joint("time_sync"), again)
    assert solution is again
    assert asked == [CONFIG, config]
    assert config.evidence.blur.exposure_s == CONFIG.evidence.blur.brief_s < CONFIG.evidence.blur.exposure_s
    assert not config.evidence.blur.creases


def test_a_second_solution_without_motion_does_not_count(monkeypatch: pytest.MonkeyPatch, asked: list[GapConfig]) -> None:
    first = joint("time_sync")
    assert solved(monkeypatch, asked, first, joint("wiggling")) == (first, CONFIG)
    assert len(asked) == 2


@pytest.mark.parametrize(("names", "left_out"), [(("motion",), ""), ((), "motion")])
def test_nothing_is_solved_again_where_motion_is_known_or_not_asked(
    monkeypatch: pytest.MonkeyPatch, asked: list[GapConfig], names: tuple[str, ...], left_out: str
) -> None:
    only = joint(*names)
    assert solved(monkeypatch, asked, only, left_out=left_out) == (only, CONFIG)


def test_a_session_at_rest_is_solved_once(monkeypatch: pytest.MonkeyPatch, asked: list[GapConfig]) -> None:
    only = joint("wiggling")
    monkeypatch.setattr(brief, "moving", lambda _: False)
    assert solved(monkeypatch, asked, only) == (only, CONFIG)


def test_nothing_is_solved_again_where_the_pixels_of_brief_frames_show_no_motion(
    monkeypatch: pytest.MonkeyPatch, asked: list[GapConfig]
) -> None:
    only = joint("wiggling")
    monkeypatch.setattr(brief, "shows_motion", lambda *_: False)
    assert solved(monkeypatch, asked, only) == (only, CONFIG)


GAIN = 20.0
NOW = 1000.0
"""Held-out chi-square of the effects found, and what a form of motion must win beside them."""


def shows(monkeypatch: pytest.MonkeyPatch, beside: float, instead: dict[int, float], forms: int = 2) -> bool:
    """Whether motion shows, by the score of its best form beside two effects found, and in the place of one of them."""

    def scores(rest: list[int], place: int, inflate: float) -> Any:
        assert (place, inflate) == (len(rest), 1.5)
        gone = {0, 1}.difference(rest)
        best = instead[gone.pop()] if gone else beside
        return lambda i: SimpleNamespace(score=best + 50.0 * (i - 2))  # candidates 2, 3, ... are the forms of motion

    judge = SimpleNamespace(beside=scores, gain=lambda i: {2: GAIN}[i])
    for name in ("solution", "lens_of", "as_recorded", "observe"):
        monkeypatch.setattr(brief, name, lambda *_, **__: (SimpleNamespace(station=np.zeros(2)), 0.0))
    monkeypatch.setattr(brief, "edges_wider_px", lambda *_: 0)
    monkeypatch.setattr(brief, "candidates", lambda *_, **__: [SimpleNamespace(name="motion")] * forms)
    monkeypatch.setattr(brief, "judge_of", lambda *_: judge)
    monkeypatch.setattr(brief, "rescored", lambda *_: SimpleNamespace(members=(0, 1), score=NOW, inflate=1.5))
    caster: Any = SimpleNamespace(scene=None)
    return brief.shows_motion(joint("time_sync", "wiggling"), (), caster, CONFIG)


WORSE = {0: NOW + 500.0, 1: NOW + 500.0}


def test_motion_shows_where_it_explains_more_beside_the_effects_found(monkeypatch: pytest.MonkeyPatch) -> None:
    assert shows(monkeypatch, NOW - GAIN - 1.0, WORSE)
    assert not shows(monkeypatch, NOW - GAIN + 1.0, WORSE)


def test_motion_shows_where_it_explains_as_much_as_one_of_the_effects_found(monkeypatch: pytest.MonkeyPatch) -> None:
    tied = CONFIG.select.tie_gain
    assert shows(monkeypatch, NOW, WORSE | {0: NOW + tied - 1.0})
    assert not shows(monkeypatch, NOW, WORSE | {0: NOW + tied + 1.0})


def test_motion_that_the_session_cannot_test_does_not_show(monkeypatch: pytest.MonkeyPatch) -> None:
    assert not shows(monkeypatch, 0.0, {0: 0.0, 1: 0.0}, forms=0)
