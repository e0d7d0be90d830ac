# SPDX-License-Identifier: Apache-2.0
"""The fit of one part's place: its figures, its search, and its refinement on costs with a known minimum."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from tof_core import se3
from tof_inspect import displaced as room
from tof_inspect.config import InspectConfig
from tof_inspect.displaced import Fit, _offsets, _patterned, _smoothed, fit_part
from tof_inspect.patch import at

if TYPE_CHECKING:
    from collections.abc import Callable

    from tof_core.arrays import Float

CONFIG = InspectConfig()


def fit(shift_mm: tuple[float, float, float], known: Float) -> Fit:
    """Standard deviations along x, y, z by noise 1, 2, 3, by outlines 2, 2, 2, by what is shared 2, 1, 6 mm: 3, 3 and 7 together."""
    noise, outline, shared = (np.diag(np.array(mm) * 1e-3) ** 2 for mm in ((1.0, 2.0, 3.0), (2.0, 2.0, 2.0), (2.0, 1.0, 6.0)))
    return Fit(1e-3 * np.array(shift_mm), noise, outline, shared, known, 0.0)


def test_the_distance_has_the_deviation_along_itself() -> None:
    both = np.eye(3)
    assert fit((3.0, 4.0, 0.0), both).mm == pytest.approx(5.0)
    assert fit((3.0, 4.0, 0.0), both).std_mm == pytest.approx(3.0)
    assert fit((0.0, 0.0, -2.0), both).std_mm == pytest.approx(7.0)
    assert fit((1.0, 0.0, 1.0), both).std_mm == pytest.approx(np.sqrt((9 + 49) / 2))


def test_without_a_shift_it_is_the_largest_along_a_known_axis() -> None:
    assert fit((0.0, 0.0, 0.0), np.eye(3)).std_mm == pytest.approx(7.0)
    assert fit((0.0, 0.0, 0.0), np.eye(3)[:, :2]).std_mm == pytest.approx(3.0)
    assert fit((1e-7, 0.0, 0.0), np.eye(3)).std_mm == pytest.approx(7.0)
    assert fit((2e-6, 0.0, 0.0), np.eye(3)).std_mm == pytest.approx(3.0)
    assert np.isnan(fit((0.0, 0.0, 0.0), np.zeros((3, 0))).std_mm)


def test_the_search_begins_in_26_directions_at_two_distances() -> None:
    offsets = np.array(_offsets(0.01))
    assert offsets.shape == (52, 3)
    np.testing.assert_allclose(np.linalg.norm(offsets, axis=1), np.repeat([0.004, 0.009], 26))
    directions = {tuple(np.sign(np.round(o, 6))) for o in offsets}
    assert len(directions) == 26


def bowl(x: float, y: float, z: float) -> Callable[[Float], float]:
    """A cost with its minimum where the part has moved by these metres."""
    return lambda motion: float(np.abs(motion[:3, 3] - [x, y, z]).sum())


@pytest.mark.parametrize("where", [(0.005, -0.003, 0.0), (-0.007, 0.001, 0.002), (0.0, 0.0, -0.006), (0.0, 0.0, 0.0)])
def test_the_pattern_search_ends_within_its_last_step(where: tuple[float, float, float]) -> None:
    found = _patterned(np.eye(4), bowl(*where))
    assert np.abs(found[:3, 3] - where).max() <= 0.5e-3 + 1e-12
    np.testing.assert_array_equal(found[:3, :3], np.eye(3))
    finer = _patterned(found, bowl(*where), steps=(5e-4, 2.5e-4, 1e-4))
    assert np.abs(finer[:3, 3] - where).max() <= 1e-4


def test_the_pattern_search_steps_three_times_at_most_of_each_size() -> None:
    np.testing.assert_allclose(_patterned(np.eye(4), bowl(0.5, 0.0, 0.0))[:3, 3], [3 * 7e-3, 0.0, 0.0])


def test_the_search_stays_where_no_step_is_better() -> None:
    np.testing.assert_array_equal(_patterned(at(np.array([1e-3, 0, 0])), lambda _: 1.0), at(np.array([1e-3, 0, 0])))


WANTED = np.array([2e-3, -1e-3, 3e-3, 0.01, -0.02, 0.015])


def linear(count: int, weight: float = 1e12) -> Callable[[Float], tuple[Float, Float, Float]]:
    """Residuals that vanish at the motion exp(WANTED)."""
    J = np.tile(np.eye(6), (count // 6 + 1, 1))[:count]

    def at_motion(motion: Float) -> tuple[Float, Float, Float]:
        return J @ se3.log(se3.exp(WANTED) @ se3.inverse(motion)), J, np.full(count, weight)

    return at_motion


def away(motion: Float) -> float:
    return float(np.linalg.norm(se3.log(se3.inverse(se3.exp(WANTED)) @ motion)))


def test_the_refinement_finds_place_and_turn() -> None:
    np.testing.assert_allclose(_smoothed(np.eye(4), away, linear(24), CONFIG), se3.exp(WANTED), atol=1e-6)


def test_a_refinement_that_costs_more_is_not_kept() -> None:
    np.testing.assert_array_equal(_smoothed(np.eye(4), lambda m: -away(m), linear(24), CONFIG), np.eye(4))


@pytest.mark.parametrize(("count", "moves"), [(12, True), (11, False)])
def test_twelve_residuals_are_needed(count: int, *, moves: bool) -> None:
    found = _smoothed(np.eye(4), away, linear(count), CONFIG)
    assert (away(found) < 1e-5) is moves


def test_a_prior_of_the_search_and_of_six_degrees_holds_it() -> None:
    """Data as sure as the prior, on each axis by itself, move it half of the way."""
    prior = np.repeat([1e-3 * CONFIG.search_mm, np.radians(6.0)], 3) ** -2.0
    J = np.tile(np.eye(6), (4, 1))

    def at_motion(motion: Float) -> tuple[Float, Float, Float]:
        return J @ (WANTED - se3.log(motion)), J, np.tile(prior / 4, 4)

    np.testing.assert_allclose(se3.log(_smoothed(np.eye(4), away, at_motion, CONFIG)), WANTED / 2, atol=2e-5)


class Dents:
    """Stands for what a part's pixels cost: a dent of 1 at its place, one of `depth` at `where`; thinned pixels see only the deeper one."""

    def __init__(self, where: tuple[float, float, float], depth: float = 3.0) -> None:
        self.where, self.depth, self.farthest = np.array(where), depth, 0.0

    def cost(self, motion: Float, patches: list[str], *_: object) -> float:
        t = motion[:3, 3]
        self.farthest = max(self.farthest, float(np.linalg.norm(t)))
        near = [1.0 - 500 * np.linalg.norm(t), self.depth - 500 * np.linalg.norm(t - self.where)]
        assert patches in (["thin", "thin"], ["soft", "soft"], ["whole", "whole"])
        return 10.0 - float(near[1] if patches == ["thin", "thin"] else max(near))


def fitted(monkeypatch: pytest.MonkeyPatch, dents: Dents, open_axis: bool = False) -> Fit:  # noqa: FBT001, FBT002
    """The fit of a part to two of three views, the third of which does not show it; the last step moves nothing."""

    class Whole(str):
        __slots__ = ()

        behind = "behind"

        def thinned(self) -> str:
            return "thin"

        def softened(self, _: object) -> Whole:
            return Whole("soft")

    settled: list[Float] = []

    def settle(motion: Float, *_: object) -> Any:
        settled.append(motion)
        noise = np.diag([1e-8, 1e-8, 1.0 if open_axis else 1e-8])
        return SimpleNamespace(motion=motion, noise=noise, outline=2 * np.eye(3) * 1e-8, shared=3 * np.eye(3) * 1e-8)

    monkeypatch.setattr(room, "patch_of", lambda s, *_: Whole("whole") if s else None)
    monkeypatch.setattr(room, "cost_of", dents.cost)
    monkeypatch.setattr(room, "moved_hits", lambda *_: ("hits",))
    monkeypatch.setattr(room, "misfit", lambda _patch, behind: {"behind": 20.0}[behind])
    monkeypatch.setattr(room, "_all_linearised", lambda *_: (np.zeros(0), np.zeros((0, 6)), np.zeros(0)))
    monkeypatch.setattr(room, "settle", settle)
    part, alone = SimpleNamespace(vertices=np.zeros((3, 3))), SimpleNamespace(vertices=None)
    return fit_part(part, [True, None, True], alone, None, CONFIG, None)  # type: ignore[arg-type, list-item]


@pytest.mark.parametrize("where", [(0.0103, 0.0, 0.0), (0.0, -0.0046, 0.001), (-0.006, 0.006, 0.006)])
def test_a_part_is_found_far_from_its_place_to_an_eighth_of_a_millimetre(
    monkeypatch: pytest.MonkeyPatch, where: tuple[float, float, float]
) -> None:
    found = fitted(monkeypatch, Dents(where))
    assert np.abs(found.shift - where).max() <= 0.13e-3
    # 40 without the part at all; 7 and what the last eighth of a millimetre costs with it.
    assert found.ratio == pytest.approx(40.0 - 7.0 - 500 * np.linalg.norm(found.shift - where))
    np.testing.assert_allclose(found.cov, 6e-8 * np.eye(3))


def test_no_farther_than_the_search_and_a_third(monkeypatch: pytest.MonkeyPatch) -> None:
    dents = Dents((0.03, 0.0, 0.0), depth=50.0)
    found = fitted(monkeypatch, dents)
    assert dents.farthest <= 1.3 * 0.012
    assert found.shift[0] == pytest.approx(1.3 * 0.012, abs=0.3e-3)


def test_along_an_undetermined_axis_no_shift_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    found = fitted(monkeypatch, Dents((-0.006, 0.006, 0.006)), open_axis=True)
    np.testing.assert_allclose(found.shift, [-0.006, 0.006, 0.0], atol=0.13e-3)
    assert found.shift[2] == 0.0
    assert found.known.shape == (3, 2)
