# SPDX-License-Identifier: Apache-2.0
"""The pieces of the search from afar, each on numbers by hand: scores, steps, starts, slides, and which pose is kept."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from tests.tof_align.made import CONFIG
from tests.tof_align.pixel_rows import view_of
from tof_align import approach as room
from tof_align.approach import _along, _Cameras, _Looks, _mean_by_view, _spread_out, _step, approach
from tof_align.robust import tukey
from tof_core import se3

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike

    from tof_align.config import AlignConfig
    from tof_core.arrays import Float

LIMITS = CONFIG.approach
STD = np.repeat([0.05, np.radians(2.0)], 3)
EYE = np.eye(4)


class Wall:
    """Stands for a scene: a wall at z = `at` metres of the cell, from x = -1 to 1."""

    def __init__(self, at: float = 1.0) -> None:
        self.at = at

    def cast(self, origin: Float, direction: Float) -> Any:
        t = (self.at - origin[:, 2]) / direction[:, 2]
        x = origin[:, 0] + t * direction[:, 0]
        return SimpleNamespace(t=np.where(np.abs(x) < 1.0, t, np.inf))


def pixels(depth: ArrayLike) -> Any:
    """A row of pixels whose rays spread to either side by a tenth each."""
    z = np.asarray(depth, float)
    x = 0.1 * (np.arange(len(z)) - len(z) // 2)
    rays = np.stack([x, np.zeros(len(z)), np.ones(len(z))], axis=1)
    return SimpleNamespace(depth=z[None], rays=rays[None])


def cameras(row: Any, config: AlignConfig = CONFIG) -> _Cameras:
    """One camera at the origin of its frame, and of the cell, before a wall."""
    return _Cameras([row], EYE[None], EYE, STD, Wall(), config)  # type: ignore[arg-type]


def test_views_are_spread_over_the_station() -> None:
    assert _spread_out([Any] * 4, 6) == [0, 1, 2, 3]  # type: ignore[list-item]
    assert _spread_out([Any] * 11, 3) == [0, 5, 10]  # type: ignore[list-item]
    assert _spread_out([Any] * 30, 6) == [0, 5, 11, 17, 23, 29]  # type: ignore[list-item]
    assert _spread_out([Any] * 5, 1) == [0]  # type: ignore[list-item]


def test_looks_are_the_pixels_that_have_a_depth() -> None:
    looks = _Looks.of([pixels([1.0, np.nan, 2.0]), pixels([np.nan]), pixels([3.0, 4.0])])
    np.testing.assert_array_equal(looks.depth, [1, 2, 3, 4])
    np.testing.assert_array_equal(looks.ends, [0, 2, 2, 4])
    np.testing.assert_allclose(looks.rays[:, 0], [-0.1, 0.1, -0.1, 0.0])
    fewer = _Looks.of([pixels(np.arange(7.0) + 1)], stride=3)
    np.testing.assert_array_equal(fewer.depth, [1, 4, 7])


def test_an_error_is_the_distance_to_the_wall_and_a_metre_where_the_ray_misses() -> None:
    """The second camera stands 0.2 m nearer and turned by 180 degrees about its axis; the third looks past the wall."""
    looks = _Looks.of([pixels([1.0, 1.1, 0.9]), pixels([0.8, 0.7]), pixels([1.0])])
    turned, aside = se3.exp([0, 0, 0, 0, 0, np.pi]), np.eye(4)
    turned[2, 3], aside[0, 3] = 0.2, 5.0
    poses = np.stack([EYE, turned, aside])
    np.testing.assert_allclose(looks.errors(poses, Wall()), [0, 0.1, 0.1, 0, 0.1, 1.0], atol=1e-12)  # type: ignore[arg-type]


def test_a_score_is_the_mean_error_up_to_30_mm() -> None:
    camera, empty = cameras(pixels([1.0, 1.01, 0.98, 1.2])), cameras(pixels([np.nan]))
    assert camera.score(camera.every, EYE) == pytest.approx((0.01 + 0.02 + 0.03) / 4)
    assert empty.score(empty.every, EYE) == 0.0


def test_views_count_alike_however_many_pixels_they_have() -> None:
    looks = _Looks.of([pixels([1.0, 1.0, 1.0]), pixels([np.nan]), pixels([1.0])])
    assert _mean_by_view(looks, np.array([0.1, 0.2, 0.3, 0.05]), 0.15) == pytest.approx((0.2 + 0.15 + 0.05) / 3)


def test_a_step_is_weighted_least_squares_with_the_prior() -> None:
    """Each view counts as so many pixels with a deviation of a third of the kernel; the prior pulls to where the frame was."""
    rng = np.random.default_rng(2)
    views = [view_of(rng.normal(0, 0.01, n)) for n in (30, 0, 50)]
    local = np.array([se3.exp(rng.normal(0, 0.3, 6)) for _ in views])
    motion, kernel = se3.exp([0.01, -0.02, 0.0, 0.01, 0.0, 0.02]), 0.02
    rows, right = [np.diag(1 / STD)], [-se3.log(motion) / STD]
    for view, T in zip(views, local, strict=True):
        if len(view.residual):
            root = np.sqrt(tukey(view.residual, kernel) * 100.0 / len(view.residual)) * 3.0 / kernel
            rows.append(root[:, None] * view.jacobian @ se3.adjoint(se3.inverse(T)))
            right.append(root * view.residual)
    expected = np.linalg.lstsq(np.concatenate(rows), np.concatenate(right), rcond=None)[0]
    np.testing.assert_allclose(_step(views, local, motion, STD, kernel, 100.0), expected, rtol=1e-8)


@pytest.mark.parametrize("where", [0.0, 0.031, -0.05, 0.0799, -0.2])
def test_a_slide_ends_at_the_best_place_within_its_reach(where: float) -> None:
    """Looks each 8 mm out to 80 mm, then at 0.3 and 0.6 of that on either side of the best."""
    found = _along(np.array([0.05, 0, 0, 0, 0, 0]), EYE, lambda T: abs(T[0, 3] - where), LIMITS)[0, 3]
    assert abs(found - np.clip(where, -0.0848, 0.0848)) <= 0.0012 + 1e-9
    assert _along(np.array([0.05, 0, 0, 0, 0, 0]), EYE, lambda _: 1.0, LIMITS)[0, 3] <= 0.0


def test_the_directions_that_surfaces_determine_least_come_first(monkeypatch: pytest.MonkeyPatch) -> None:
    """z and the turns are known by all pixels, x by a tenth of them, y by pixels that disagree."""
    J = np.zeros((100, 6))
    J[:, 2], J[:10, 0] = 1.0, 1.0
    J[:, 3:] = 20.0 * np.random.default_rng(1).normal(size=(100, 3))
    residual = np.zeros(100)
    residual[10:40], J[10:40, 1] = 0.05, 5.0
    monkeypatch.setattr(room, "linearise", lambda *_: view_of(residual, jacobian=J))
    three = replace(CONFIG, approach=replace(LIMITS, slides=3))
    found = cameras(None, three).least_known(EYE)
    assert found.shape == (3, 6)
    assert abs(found[0, 1]) == pytest.approx(1.0, abs=1e-6)
    assert np.abs(found[1, 0]) > 0.9
    H = (J * STD * tukey(residual, 0.015)[:, None]).T @ (J * STD)
    np.testing.assert_allclose(np.abs(found), np.abs(np.linalg.eigh(H)[1][:, :3].T), atol=1e-9)


def test_starts_are_the_most_promising_inside_the_prior() -> None:
    """One view that measures the wall 0.08 m nearer than it is believed to be: good starts are moved towards it."""
    given = replace(LIMITS, kept=6)
    camera = cameras(pixels(np.full(9, 0.92)), replace(CONFIG, approach=given))
    starts = camera.starts()
    twists = np.array([se3.log(T) for T in starts])
    assert len(starts) == 6
    assert np.abs(twists / STD).max() <= given.reach + 1e-9
    few = _Looks.of([pixels(np.full(9, 0.92))], given.start_stride)
    scores = [np.minimum(few.errors(T[None], Wall()), 0.15).mean() for T in starts]  # type: ignore[arg-type]
    assert scores == sorted(scores)
    assert scores[-1] < 0.03
    np.testing.assert_array_equal(camera.starts(), starts)


def moved(x: float) -> Float:
    T = np.eye(4)
    T[0, 3] = x
    return T


def searched(
    monkeypatch: pytest.MonkeyPatch, scores: dict[float, float], *, std: Float = STD, starts: tuple[float, ...] = (0.1, 0.2)
) -> tuple[float, list[tuple[float, float]]]:
    """Where a search ends whose descent stays where it begins with the score of that place; and from where, with which kernel, it descended."""
    began: list[tuple[float, float]] = []

    def descend(_: _Cameras, motion: Float, kernel: float) -> tuple[Float, float]:
        began.append((float(motion[0, 3]), kernel))
        return motion, scores[float(motion[0, 3])]

    monkeypatch.setattr(_Cameras, "descend", descend)
    monkeypatch.setattr(_Cameras, "starts", lambda _: [moved(x) for x in starts])
    monkeypatch.setattr(_Cameras, "slid", lambda _cameras, motion, _score: motion)
    found = approach([pixels(np.ones(3))], EYE[None], EYE, std, Wall(), CONFIG)  # type: ignore[arg-type]
    return float(found[0, 3]), began


def test_a_descent_that_ends_well_is_the_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    assert searched(monkeypatch, {0.0: 0.0149}) == (0.0, [(0.0, 0.15)])


def test_one_that_ends_badly_is_followed_by_others_and_the_best_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    end, began = searched(monkeypatch, {0.0: 0.0151, 0.1: 0.010, 0.2: 0.0096})
    assert began == [(0.0, 0.15), (0.1, 0.06), (0.2, 0.06)]
    assert end == 0.1, "0.0096 is not 5 % better than 0.010"
    assert searched(monkeypatch, {0.0: 0.0151, 0.1: 0.010, 0.2: 0.0094})[0] == 0.2
    assert searched(monkeypatch, {0.0: 0.0151, 0.1: 0.0146, 0.2: 0.02})[0] == 0.0


@pytest.mark.parametrize(("mm", "deg", "tried"), [(59.0, 2.9, 1), (61.0, 2.0, 3), (50.0, 3.1, 3)])
def test_a_wide_prior_asks_for_other_starts_anyway(monkeypatch: pytest.MonkeyPatch, mm: float, deg: float, tried: int) -> None:
    std = np.repeat([1e-3 * mm, np.radians(deg)], 3)
    assert len(searched(monkeypatch, {0.0: 0.001, 0.1: 0.01, 0.2: 0.01}, std=std)[1]) == tried


def slides(monkeypatch: pytest.MonkeyPatch, scores: Callable[[float], float], *, rounds: int = 2) -> tuple[float, int]:
    """Where slides of 0.1 m each along x end, by the score of a place; how often a direction was asked for."""
    asked = [0]

    def least_known(*_: object) -> Float:
        asked[0] += 1
        return np.eye(6)[:1]

    monkeypatch.setattr(_Cameras, "least_known", least_known)
    monkeypatch.setattr(room, "_along", lambda _twist, motion, *_: moved(round(motion[0, 3] + 0.1, 6)))
    monkeypatch.setattr(_Cameras, "score", lambda _cameras, _looks, motion: scores(round(float(motion[0, 3]), 6)))
    row = SimpleNamespace(**vars(pixels(np.ones(3))), thinned=lambda _: pixels(np.ones(3)))
    config = replace(CONFIG, approach=replace(LIMITS, slide_rounds=rounds))

    def descend(_: _Cameras, motion: Float, kernel: float) -> tuple[Float, float]:
        assert kernel == 0.02
        place = round(float(motion[0, 3]) + 0.001, 6)
        return moved(place), scores(place)

    monkeypatch.setattr(_Cameras, "descend", descend)
    found = cameras(row, config).slid(moved(0.0), scores(0.0))
    return float(found[0, 3]), asked[0]


def test_a_slide_to_a_better_place_is_kept_and_tried_again(monkeypatch: pytest.MonkeyPatch) -> None:
    assert slides(monkeypatch, lambda x: 0.02 - 0.05 * round(x, 1)) == (0.2, 2)


def test_a_descent_after_a_slide_is_kept_where_it_is_better(monkeypatch: pytest.MonkeyPatch) -> None:
    assert slides(monkeypatch, lambda x: 0.02 - 0.05 * x, rounds=1) == (0.101, 1)


def test_a_slide_must_be_two_per_cent_better(monkeypatch: pytest.MonkeyPatch) -> None:
    assert slides(monkeypatch, lambda x: 0.02 - (0.0005 if x > 0.09 else 0.0)) == (0.1, 2)
    assert slides(monkeypatch, lambda x: 0.02 - (0.0003 if x > 0.09 else 0.0)) == (0.0, 1)


def descent(monkeypatch: pytest.MonkeyPatch, errors: Float, step_m: float, kernel: float = 0.15) -> tuple[list[float], float]:
    """Kernels of the steps of a descent whose residuals stay as they are and whose steps go along x, and where it ends."""
    kernels: list[float] = []

    def step(_views: object, _local: object, _motion: object, _std: object, kernel: float, independent: float) -> Float:
        assert independent == LIMITS.independent
        kernels.append(kernel)
        return np.array([step_m, 0, 0, 0, 0, 0])

    monkeypatch.setattr(room, "linearise", lambda *_: view_of(errors))
    monkeypatch.setattr(room, "_step", step)
    monkeypatch.setattr(_Cameras, "score", lambda _cameras, _looks, motion: float(motion[0, 3]))
    motion, score = cameras(pixels(np.ones(3))).descend(EYE, kernel)
    assert score == pytest.approx(motion[0, 3])
    return kernels, score


def test_a_kernel_narrows_to_what_the_residuals_show(monkeypatch: pytest.MonkeyPatch) -> None:
    """By 0.7 a step, no further than three robust deviations of what lies within it, and never below 4 mm."""
    even = np.tile([0.02, -0.02], 6)
    spread = 3 * 1.4826 * 0.02
    kernels, end = descent(monkeypatch, even, 1e-3)
    np.testing.assert_allclose(kernels, [0.15, 0.105, *[spread] * 22], rtol=1e-4)
    assert end == pytest.approx(0.024)
    outliers = np.concatenate([even, np.full(5, 0.5)])
    np.testing.assert_allclose(descent(monkeypatch, outliers, 1e-3)[0][2:], [spread] * 22, rtol=1e-4)
    none = descent(monkeypatch, np.zeros(12), 1e-3)[0]
    np.testing.assert_allclose(none, np.maximum(0.15 * 0.7 ** np.arange(24), 0.004))


@pytest.mark.parametrize(("step_mm", "steps"), [(0.19, 5), (0.21, 24)])
def test_a_descent_ends_where_it_stands_still_with_a_narrow_kernel(monkeypatch: pytest.MonkeyPatch, step_mm: float, steps: int) -> None:
    """0.15 m narrow to below 30 mm in five steps."""
    assert len(descent(monkeypatch, np.zeros(12), 1e-3 * step_mm)[0]) == steps


@pytest.mark.parametrize(("count", "steps"), [(6, 24), (5, 0)])
def test_six_residuals_are_needed_for_a_step(monkeypatch: pytest.MonkeyPatch, count: int, steps: int) -> None:
    assert len(descent(monkeypatch, np.zeros(count), 1e-3)[0]) == steps
