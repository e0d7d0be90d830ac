# SPDX-License-Identifier: Apache-2.0
"""Registration to the reference: accuracy near and far, undetermined directions, refusals."""

from __future__ import annotations

import numpy as np
import pytest

from arm_correction.match import make_matcher, reference_surface
from arm_correction.register import _slides, register
from tests.arm_correction.made import CONFIG, FIRST, post, reference, registered, seen, twist
from tests.tof_align.made import at, box, foreign, panel, scene_of, section
from tof_core import se3
from tof_core.errors import RefusedError
from tof_scene.raycast import Raycaster


@pytest.mark.parametrize("seed", range(3))
def test_near_starts_come_out_within_half_a_millimetre(seed: int) -> None:
    rng = np.random.default_rng(seed)
    motion = twist(tuple(rng.uniform(-28, 28, 3)), tuple(rng.uniform(-1.7, 1.7, 3)))
    found = registered(section(), motion, seed=seed)
    metres, degrees = se3.distance(found.T_reference_now, motion)
    assert found.accepted, found.reason
    assert 1e3 * metres < 0.5
    assert degrees < 0.05
    assert not found.far
    assert found.unknown.rank == 6


def test_the_covariance_holds_the_error() -> None:
    motion = twist((20, -10, 15), (1, -1, 0.5))
    sigmas = []
    for seed in range(4):
        found = registered(section(), motion, seed=seed)
        xi = se3.log(se3.inverse(found.T_reference_now) @ motion)
        sigmas.append(np.sqrt(xi @ np.linalg.solve(found.cov, xi) / 6))
    assert np.median(sigmas) < 4.0
    assert np.median(sigmas) > 0.2


@pytest.mark.parametrize("motion", [twist((90, -120, 120), (6, 8, -5)), twist((-120, 90, -200), (-7, -9, 8))])
def test_far_starts_are_found_by_many_starts(motion: np.ndarray) -> None:
    found = registered(foreign(), motion)
    metres, degrees = se3.distance(found.T_reference_now, motion)
    assert found.accepted, found.reason
    assert found.unknown.rank == 6
    assert 1e3 * metres < 1.5
    assert degrees < 0.15


def test_a_thin_panel_determines_distance_and_two_rotations_and_nothing_else_moves() -> None:
    motion = twist((30, -20, 25), (2.0, -1.5, 3.0))
    found = registered(panel(), motion)
    assert found.unknown.rank == 3
    assert found.accepted, found.reason
    step = se3.log(found.T_reference_now)
    along = found.unknown.null @ (np.repeat([1.0, 0.3], 3) * step)
    np.testing.assert_allclose(along, 0.0, atol=1e-4)
    # What is known is right: the panel's plane as the corrected camera sees it is the reference's.
    corrected = FIRST @ motion @ se3.inverse(found.T_reference_now)
    assert abs(corrected[0, 3] - FIRST[0, 3]) < 1e-3
    facing = corrected[:3, :3].T @ [1, 0, 0] - FIRST[:3, :3].T @ [1, 0, 0]
    assert np.degrees(np.linalg.norm(facing)) < 0.1


def test_a_round_post_leaves_rotation_about_it_and_translation_along_it_undetermined() -> None:
    found = registered(post(), twist((15, 0, 10), (0, 0, 1.0)))
    assert found.unknown.rank == 4
    moved = se3.log(found.T_reference_now)
    upright = found.unknown.null @ (np.repeat([1.0, 0.3], 3) * moved)
    np.testing.assert_allclose(upright, 0.0, atol=1e-4)


def test_weakly_determined_directions_are_searched() -> None:
    """Along a post only a collar determines the position, and no descent leads there."""
    fin = box("fin", (0.12, 0.03, 7.0), at(0.15, 0.0, 0.8, (0, 0, 0.6)))
    marked = Raycaster(scene_of(post().scene.parts[0], fin, box("collar", (0.16, 0.31, 0.05), at(0.08, 0.0, 0.80))))
    matcher = make_matcher(reference_surface(reference(marked), CONFIG), seen(marked, FIRST, believed=FIRST), CONFIG)
    up = FIRST[:3, :3].T @ [0.0, 0.0, 1.0]
    for metres in (-0.06, 0.032):
        aside = np.eye(4)
        aside[:3, 3] = metres * up
        there = _slides(matcher, aside)
        assert min(np.linalg.norm(T[:3, 3]) for T in there) < 3e-3
        best = there[np.argsort(matcher.misfits(there))[:3]]
        assert min(np.linalg.norm(T[:3, 3]) for T in best) < 5e-3


def test_another_scene_is_refused() -> None:
    matcher = make_matcher(reference_surface(reference(section()), CONFIG), seen(foreign(), FIRST), CONFIG)
    found = register(matcher, np.eye(4))
    assert not found.accepted
    assert "support" in found.reason or "ambiguous" in found.reason


def test_an_empty_view_is_refused() -> None:
    away = FIRST.copy()
    away[:3, :3] = away[:3, :3] @ se3.so3_exp([0, np.pi, 0])
    with pytest.raises(RefusedError, match="empty view"):
        make_matcher(reference_surface(reference(section()), CONFIG), seen(section(), away), CONFIG)
