# SPDX-License-Identifier: Apache-2.0
"""A session labelled as it runs and once it is over: a box room whose depth is known by formula."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from benchmarks.radial import z_to_radial
from tof_core import se3
from tof_core.camera import Camera
from tof_core.capture import RobotPose, View
from tof_core.errors import RefusedError, TransformError
from tof_scene.raycast import Raycaster
from tof_scene.scene import Part, Scene
from tof_sim_label.labeller import label_session
from tof_sim_label.stream import LabelStream

if TYPE_CHECKING:
    from tof_core.arrays import Float

CAMERA = Camera(width=120, height=90, fx=110.0, fy=110.0, cx=59.5, cy=44.5)
BASE = se3.exp([0.03, -0.02, 0.005, 0.002, -0.003, 0.02])
"""The base stands 36 mm and 1.2 degrees from where TF says."""
LOOKS = [se3.exp([0.1 * i - 0.15, 0.05 * (-1) ** i, 0.02 * i, 0.1 * (-1) ** i, 0.12 * i - 0.2, 0.1 * i]) for i in range(4)]


def corner() -> Scene:
    """Three faces that meet at (-0.4, 0.3, 1.2): they fix all six directions."""
    a = np.array([[-0.4, 0.3, 1.2], [2.0, 0.3, 1.2], [2.0, -2.0, 1.2], [-0.4, -2.0, 1.2]])
    b = np.array([[-0.4, 0.3, 1.2], [-0.4, 0.3, -0.5], [2.0, 0.3, -0.5], [2.0, 0.3, 1.2]])
    c = np.array([[-0.4, 0.3, 1.2], [-0.4, -2.0, 1.2], [-0.4, -2.0, -0.5], [-0.4, 0.3, -0.5]])
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    return Scene("cell", tuple(Part(name, mesh, faces) for name, mesh in (("back", a), ("floor", b), ("side", c))))


def depth_of(T: Float) -> Float:
    """z-depth (H, W) of the corner seen from T, by formula."""
    rays, o = CAMERA.rays() @ T[:3, :3].T, T[:3, 3]
    ways = [(wall - o[axis]) / rays[..., axis] for axis, wall in ((0, -0.4), (1, 0.3), (2, 1.2))]
    return np.asarray(np.min([np.where(way > 0, way, np.inf) for way in ways], axis=0))


def session(noise: float = 1e-3) -> tuple[list[View], list[Float]]:
    """Four views of one station and their true depths."""
    rng = np.random.default_rng(5)
    views, true = [], []
    for i, look in enumerate(LOOKS):
        depth = depth_of(BASE @ look)
        true.append(depth)
        views.append(View(
            stamp_ns=i, dwell_ns=i, camera=CAMERA, depth=(depth + rng.normal(scale=noise, size=depth.shape)).astype(np.float32),
            sigma=np.full(depth.shape, noise, np.float32), count=np.ones(depth.shape, np.uint16), reason=np.zeros(depth.shape, np.uint8),
            robot=RobotPose(np.eye(4), look),
        ))  # fmt: skip
    return views, true


@pytest.fixture(scope="module")
def caster() -> Raycaster:
    return Raycaster(corner())


def test_final_labels_are_the_true_depth_though_the_robot_is_off(caster: Raycaster) -> None:
    views, true = session()
    solution, labels = label_session(views, caster)
    for (view, label), depth in zip(labels, true, strict=True):
        assert label.posed.accepted
        used = label.mask == 1
        assert used.mean() > 0.95
        assert np.abs(label.depth - depth)[used].mean() < 0.3e-3
        assert np.abs(view.depth - depth).mean() > 0.7e-3, "the label is better than what it labels"
        assert (np.abs(label.depth - depth) <= 2 * label.sigma)[used].mean() > 0.9
    assert se3.distance(solution.B[0], BASE)[0] < 2e-3


def test_causal_labels_come_with_each_view(caster: Raycaster) -> None:
    views, true = session()
    stream = LabelStream(caster)
    for view, depth in zip(views, true, strict=True):
        stream.push(view)
        labelled = stream.flush()
        assert labelled is not None
        assert labelled.label is not None
        assert np.abs(labelled.label.depth - depth)[labelled.label.mask == 1].mean() < 1e-3


def test_radial_depth_is_refused_by_its_cause_before_anything_is_labelled(caster: Raycaster) -> None:
    views, _ = session()
    radial = [replace(v, depth=z_to_radial(CAMERA, v.depth)) for v in views]
    with pytest.raises(RefusedError, match=r"a plane bends.*pass --depth radial"):
        label_session(radial, caster)
    stream = LabelStream(caster)
    stream.push(radial[0])
    labelled = stream.flush()
    assert labelled is not None
    assert labelled.label is None
    assert "a plane bends" in labelled.why


def test_without_views_or_without_a_robot_there_are_no_labels(caster: Raycaster) -> None:
    with pytest.raises(RefusedError):
        label_session([], caster)
    views, _ = session()
    with pytest.raises(TransformError):
        label_session([replace(views[0], robot=None)], caster)
