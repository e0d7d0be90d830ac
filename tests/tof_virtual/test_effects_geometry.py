# SPDX-License-Identifier: Apache-2.0
"""The signature of each geometric effect."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.tof_virtual.made import bench, biases, config, looking, session, wall
from tof_core import se3
from tof_core.camera import Camera
from tof_virtual.config import VirtualConfig
from tof_virtual.effect import Moment
from tof_virtual.effects import make_effects
from tof_virtual.effects.geometry import refine
from tof_virtual.pipeline import expose
from tof_virtual.sight import World, look


def test_cad_deviation_moves_and_bends_the_parts_it_names_and_no_other() -> None:
    made = session({"cad_deviation": 1.0}, seed=2)
    names = made.effects[0].params()["parts"]
    bent = {b.name: b for b in made.effects[0].deform(bench())}
    for body in bench():
        same = len(bent[body.name].vertices) == len(body.vertices) and np.allclose(bent[body.name].vertices, body.vertices)
        assert same == (body.name not in names)
    error = biases(made, "cad_deviation")
    parts = np.stack([made.nominal.soup.body[made.moment(i, ()).sight.main.face] for i in range(4)])
    still = ~np.isin(parts, [[b.name for b in bench()].index(n) for n in names])
    for k, shutter in enumerate(made.shutters):
        still[k, np.concatenate([made.sight(shutter, e).edge for e in ((), made.effects)])] = False
    untouched = error[still]
    assert np.nanmedian(np.abs(untouched)) == 0
    assert (np.abs(untouched[np.isfinite(untouched)]) < 1e-9).mean() > 0.98, "but for what a moved part uncovers"


def test_refined_plates_keep_their_surface() -> None:
    plate = wall(half=0.4)
    vertices, faces = refine(plate.vertices, plate.faces)
    corners = vertices[faces]
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    assert edges.max() <= 0.08 * 1.5
    area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum()
    assert area == pytest.approx(0.64)


def test_intrinsics_of_the_lens_differ_and_the_bag_states_the_nominal() -> None:
    made = session({"intrinsics": 1.0})
    lens = made.effects[0].true_camera(made.camera)
    stated = made.effects[0].params()
    assert lens.fx / made.camera.fx == pytest.approx(1 + stated["focal"])
    assert [lens.cx - made.camera.cx, lens.cy - made.camera.cy] == pytest.approx(stated["principal_px"])
    assert lens.distortion[0] == pytest.approx(stated["k1"])
    seen = made.sight(made.shutters[0], made.effects)
    again = look(made.nominal, lens.rays(), made.true_pose(made.shutters[0]))
    np.testing.assert_allclose(seen.z, again.z)


def test_hand_eye_is_one_constant_twist_behind_the_chain() -> None:
    made = session({"hand_eye": 1.0})
    X = se3.exp(made.effects[0].params()["twist"])
    np.testing.assert_allclose(made.hand_eye(), X)
    for shutter in made.shutters:
        without = made.true_pose(shutter, ())
        np.testing.assert_allclose(made.true_pose(shutter), without @ X, atol=1e-12)
    assert 1e-3 < np.linalg.norm(se3.log(X)[:3]) < 0.02


def test_time_sync_stamps_the_image_when_the_hand_was_elsewhere() -> None:
    made = session({"time_sync": 1.0})
    late = made.effects[0].params()["stamp_error_s"]
    for shutter in made.shutters:
        errors = made.errors[shutter.stop]
        believed = errors.B @ made.robot_pose(shutter) @ errors.A
        metres, degrees = se3.distance(believed, made.true_pose(shutter))
        # the camera sits 70 mm from the hand, so turning adds to its way
        assert metres == pytest.approx(0.15 * abs(late), rel=0.15)
        assert degrees == pytest.approx(8.0 * abs(late), rel=0.05)
    assert made.stamp_s(made.shutters[0]) - made.shutters[0].time_s == pytest.approx(late)


def test_taps_of_a_moving_camera_follow_the_four_tap_formula() -> None:
    world = World.of([wall(half=2.0)])
    camera = Camera(40, 30, 60.0, 60.0, 19.5, 14.5)
    step = 0.004  # metres between taps, straight at the wall
    sights = tuple(look(world, camera.rays(), looking(0.8 + s * step)) for s in (1.5, 0.5, -0.5, -1.5, 0.0))
    moving = Moment(0, 0, 0.0, 40.0, world, VirtualConfig(), camera, sights)
    error = expose(moving, ()).depth - sights[-1].z
    scale = 299_792_458.0 / (4e8 * np.pi)
    d = np.stack([s.main.distance for s in sights])
    strength = np.stack([0.8 * s.main.cosine / s.main.distance**2 for s in sights])
    steady = strength / 0.8 + 60 / 90 / 0.8**2
    n = [steady[k] + strength[k] * np.cos(d[k] / scale - k * np.pi / 2) for k in range(4)]
    phase = np.mod(np.arctan2(n[1] - n[3], n[0] - n[2]), 2 * np.pi) * scale
    np.testing.assert_allclose(error, (phase - d[4]) / sights[-1].length, atol=1e-6)
    assert np.abs(error).max() > 5e-4


def test_motion_vanishes_when_the_hand_stands() -> None:
    base = config()
    still = replace(base, plan=replace(base.plan, speed_m_s=0.0, turn_deg_s=0.0))
    made = session({"motion": 1.0}, plan__speed_m_s=0.0, plan__turn_deg_s=0.0)
    assert made.config.plan.capture_moving
    assert made.config.plan.speed_m_s == still.plan.speed_m_s
    assert np.nanmax(np.abs(biases(made, "motion"))) < 1e-9
    assert make_effects({"motion": 1.0}, still)[0].tap_interval_s() > 0
