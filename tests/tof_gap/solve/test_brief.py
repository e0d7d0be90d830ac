# SPDX-License-Identifier: Apache-2.0
"""Motion of brief frames: a moving session without `motion` is solved again with pixels nearer to edges."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

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
    made: Any = SimpleNamespace(views=(), design=SimpleNamespace(candidates=candidates), selection=SimpleNamespace(chosen=chosen))
    return made  # type: ignore[no-any-return]


@pytest.fixture
def again(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """The settings of every second solution; what it finds is put in front of them."""
    asked: list[Any] = [joint("motion")]

    def solve(begun: Start, caster: object, config: GapConfig, left_out: frozenset[str]) -> Joint:
        del begun, caster, left_out
        asked.append(config)
        return asked[0]  # type: ignore[no-any-return]

    monkeypatch.setattr(brief, "moving", lambda _: True)
    monkeypatch.setattr(brief, "solve", solve)
    monkeypatch.setattr(brief, "observe", lambda *_, **__: ())
    return asked


def found(first: Joint, left_out: frozenset[str] = frozenset()) -> tuple[Joint, GapConfig]:
    return brief.in_motion(first, BEGUN, None, CONFIG, left_out)  # type: ignore[arg-type]


def test_motion_that_shows_in_brief_frames_alone_is_of_that_solution_and_its_pixels(again: list[Any]) -> None:
    solution, config = found(joint("time_sync"))
    assert solution is again[0]
    assert config is again[1]
    assert config.evidence.blur.exposure_s == CONFIG.evidence.blur.brief_s < CONFIG.evidence.blur.exposure_s
    assert not config.evidence.blur.creases


def test_a_second_solution_without_motion_does_not_count(again: list[Any]) -> None:
    again[0] = joint("wiggling")
    first = joint("time_sync")
    assert found(first) == (first, CONFIG)
    assert len(again) == 2


def test_nothing_is_solved_again_where_motion_is_known_or_not_asked(again: list[Any], monkeypatch: pytest.MonkeyPatch) -> None:
    shown, plain = joint("motion"), joint()
    assert found(shown) == (shown, CONFIG)
    assert found(plain, frozenset({"motion"})) == (plain, CONFIG)
    monkeypatch.setattr(brief, "moving", lambda _: False)
    assert found(plain) == (plain, CONFIG)
    assert len(again) == 1
