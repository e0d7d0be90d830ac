# SPDX-License-Identifier: Apache-2.0
"""The data that the default model is made from: one camera in every session, other scenes and views each time."""

from __future__ import annotations

import numpy as np

from benchmarks.infer_data import EXACT_ROBOT, make_session
from benchmarks.infer_scenes import random_scene
from tof_virtual.twin import SIZES, SWEEP, TwinCamera

FEW = {"plan.views": 3, "plan.stations": 1, "camera.width": 32, "camera.height": 24, **EXACT_ROBOT}


def test_every_session_has_the_same_camera() -> None:
    camera = TwinCamera()
    one, other = (make_session(random_scene(k), camera, seed=k, settings=FEW) for k in (1, 2))
    assert [e.params() for e in one.effects] == [e.params() for e in other.effects]
    assert {e.name: e.size for e in one.effects} == SIZES
    assert not np.allclose(one.stops[0].T_body_hand, other.stops[0].T_body_hand)


def test_noise_is_drawn_anew_in_every_session() -> None:
    camera = TwinCamera()
    one, other = (next(e for e in make_session(random_scene(1), camera, seed=k, settings=FEW).effects if e.name == "noise") for k in (1, 2))
    assert one.rng(10).normal() != other.rng(10).normal()


def test_the_exact_robot_stands_where_it_says() -> None:
    session = make_session(random_scene(3), TwinCamera(), seed=3, settings=FEW)
    for shutter in session.shutters:
        np.testing.assert_allclose(session.true_pose(shutter), session.robot_pose(shutter), atol=1e-12)


def test_the_sweep_is_eleven_views_two_degrees_apart_around_one_point() -> None:
    session = make_session(random_scene(1), TwinCamera(), seed=1, settings={**FEW, **SWEEP})
    poses = np.stack([session.robot_pose(s) for s in session.shutters])
    assert len(poses) == 11
    axes = poses[:, :3, 2]
    flat = axes[:, :2] / np.linalg.norm(axes[:, :2], axis=1, keepdims=True)
    turns = np.degrees(np.arccos(np.clip((flat[1:] * flat[:-1]).sum(1), -1, 1)))
    np.testing.assert_allclose(turns, 2.0, atol=1e-6)
    points = poses[:, :3, 3] + 0.8 * axes
    np.testing.assert_allclose(points, points[:1].repeat(11, 0), atol=1e-9)


def test_random_scenes_are_the_same_each_time_and_different_from_each_other() -> None:
    assert random_scene(5).digest == random_scene(5).digest
    assert random_scene(5).digest != random_scene(6).digest
    albedo = [p.material.albedo for k in range(20) for p in random_scene(k).parts]
    assert min(albedo) < 0.06
    assert max(albedo) > 0.7
