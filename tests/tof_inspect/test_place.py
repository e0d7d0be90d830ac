# SPDX-License-Identifier: Apache-2.0
"""Whether a part's tolerance can be judged, and which capture would make it so."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from tests.tof_inspect.made import plate
from tof_inspect.config import InspectConfig
from tof_inspect.displaced import UNKNOWN, Fit, known_axes
from tof_inspect.place import FREE_M, Place, _direction, place_of

if TYPE_CHECKING:
    from tof_core.arrays import Float

CONFIG = InspectConfig()
PART = replace(plate().part("block"), tolerance_mm=2.0)
"""30 x 40 x 30 mm about (0.03, 0.05, 0.78)."""
CAPTURES: Any = [SimpleNamespace(view=SimpleNamespace(captures=c)) for c in (3, 10)]


def fit(noise: float = 0.1, outline: float = 0.1, shared: float = 0.1, axis: int = 1) -> Fit:
    """Standard deviations in millimetres along one axis; 0.01 mm along the others."""

    def cov(mm: float) -> Float:
        std = np.full(3, 1e-5)
        std[axis] = 1e-3 * mm
        return np.diag(std**2)

    return Fit(np.zeros(3), cov(noise), cov(outline), cov(shared), np.eye(3), 0.0)


class Walls:
    """Stands for a scene: rays into these directions meet something, and none begins within the part or too far from it."""

    def __init__(self, *blocked: str) -> None:
        self.blocked = blocked

    def cast(self, origin: Float, direction: Float) -> Any:
        reach = np.linalg.norm([0.03, 0.04, 0.03]) / 2
        assert np.linalg.norm(origin - PART.vertices.mean(axis=0)) == pytest.approx(reach + 1e-3)
        assert direction.shape == (1, 3)
        return SimpleNamespace(t=np.array([0.5 if _direction(direction[0]) in self.blocked else np.inf]))


def place(of: Fit, *blocked: str) -> Place:
    walls: Any = Walls(*blocked)
    return place_of(PART, of, CAPTURES, walls, CONFIG)


@pytest.mark.parametrize(("noise", "judged"), [(0.99, True), (1.01, False)])
def test_a_tolerance_of_two_standard_deviations_is_judged(noise: float, *, judged: bool) -> None:
    found = place(fit(noise, 0.0, 0.0))
    assert found.judged is judged
    assert found.std_mm == pytest.approx(noise)
    if judged:
        assert (found.words, found.todo) == ("", "")
    else:
        assert found.words == "place known to 1.0 mm only, along y: tolerance 2 mm cannot be judged"


def test_all_causes_count_together() -> None:
    assert place(fit(3.0, 4.0, 12.0)).std_mm == pytest.approx(np.inf), "13 mm are more than half of the search"
    assert place(fit(2.0, 3.0, 4.0)).std_mm == pytest.approx(np.sqrt(29.0))


@pytest.mark.parametrize(("share", "known"), [(0.999, True), (1.001, False)])
def test_an_axis_less_certain_than_half_of_the_search_is_unknown(share: float, *, known: bool) -> None:
    mm = share * UNKNOWN * CONFIG.search_mm
    found = place(fit(mm, 0.0, 0.0, axis=2))
    assert np.isfinite(found.std_mm) is np.bool_(known)
    assert known_axes(fit(mm, 0.0, 0.0, axis=2).cov, CONFIG).shape == (3, 3 if known else 2)
    if not known:
        assert not found.judged
        assert found.words == "place along z unknown: tolerance 2 mm cannot be judged"
        assert found.todo.startswith("add a view from")


@pytest.mark.parametrize(
    ("of", "todo"),
    [
        (fit(1.0, 1.0, 3.0), "capture a session of the complete cell"),
        (fit(1.0, 2.0, 2.0), "capture a session of the complete cell"),
        (fit(1.0, 3.0, 2.0), "add a view from"),
        (fit(2.0, 2.0, 1.0), "add a view from"),
        (fit(3.0, 1.0, 1.0), "take 184 captures of each view instead of 10"),
    ],
)
def test_the_largest_cause_is_reduced(of: Fit, todo: str) -> None:
    """Of noise: (2 x 3 / (0.7 x 2))^2 = 18.4 times as many captures would be needed; sixteen times are asked for at most."""
    if "184" in todo:
        assert place(of).todo.startswith("add a view from")
        assert place(fit(2.7, 1.0, 1.0)).todo == "take 149 captures of each view instead of 10"
    else:
        assert place(of).todo.startswith(todo)


def test_without_views_one_capture_is_assumed() -> None:
    found = place_of(PART, fit(2.7, 1.0, 1.0), (), Walls(), CONFIG)  # type: ignore[arg-type]
    assert found.todo == "take 15 captures of each view instead of 1"


@pytest.mark.parametrize(
    ("blocked", "todo"),
    [
        ((), "add a view from (0.03, {:.2f}, 0.78) m in the cell, looking along {}y"),
        (("y", "-y"), "add views from half the distance"),
    ],
)
def test_a_proposed_view_is_from_a_free_side(blocked: tuple[str, ...], todo: str) -> None:
    found = place(fit(1.0, 3.0, 1.0), *blocked).todo
    away = np.linalg.norm([0.03, 0.04, 0.03]) / 2 + FREE_M
    sides = {todo.format(0.05 + away, "-"), todo.format(0.05 - away, "")}
    assert found in sides
    if not blocked:
        first = "y" if "looking along -y" in found else "-y"
        other = place(fit(1.0, 3.0, 1.0), first).todo
        assert {found, other} == sides


@pytest.mark.parametrize(
    ("degrees", "words"), [(0.0, "x"), (24.0, "x"), (26.0, "(0.9, 0.4, 0.0)"), (156.5, "-x"), (154.0, "(-0.9, 0.4, 0.0)"), (270.0, "-y")]
)
def test_a_direction_is_an_axis_within_25_degrees(degrees: float, words: str) -> None:
    turned = np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees)), 0.0])
    assert _direction(turned) == words
