# SPDX-License-Identifier: Apache-2.0
"""A cause that lasts is said once; one that comes back, or another one, is said again."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING

from tof_ros.news import News

if TYPE_CHECKING:
    import pytest


def test_a_cause_that_lasts_is_said_once_whatever_its_numbers() -> None:
    said = News()
    lines = ["refused: made for another camera", *(f"no transform: starts {ms} ms after the stamp" for ms in range(3))]
    assert [said.worth(line, kept=7) for line in lines] == [True, True, False, False]


def test_a_cause_that_comes_back_after_kept_frames_is_said_again_once_it_was_quiet(monkeypatch: pytest.MonkeyPatch) -> None:
    said, now = News(), [100.0]
    monkeypatch.setattr("tof_ros.news.time", SimpleNamespace(monotonic=lambda: now[0]))
    heard = []
    for after_s, kept in ((0.0, 0), (1.0, 3), (6.0, 4), (13.0, 4)):
        now[0] = 100.0 + after_s
        heard.append(said.worth("incomplete", kept))
    assert heard == [True, False, True, False]
