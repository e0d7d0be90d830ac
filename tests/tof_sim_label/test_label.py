# SPDX-License-Identifier: Apache-2.0
"""A label is the CAD rendered at the camera's pose; its mask excludes everything that is not the CAD."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import cv2
import numpy as np
import pytest

from tof_core import se3
from tof_core.camera import Camera
from tof_core.capture import Posed, View
from tof_core.lens import with_lens
from tof_core.reasons import Reason
from tof_scene.raycast import Raycaster
from tof_scene.render import render
from tof_scene.scene import Part, Scene
from tof_scene.world.surprises import ABSENT, NONE
from tof_sim_label.config import LabelConfig
from tof_sim_label.label import Label, label_view
from tof_sim_label.reasons import LabelReason

if TYPE_CHECKING:
    from tof_core.arrays import Float

CAMERA = Camera(width=80, height=60, fx=90.0, fy=90.0, cx=39.5, cy=29.5)
T_CELL_CAMERA = se3.exp([0.02, -0.01, 0.0, 0.05, -0.1, 0.2])
POSED = Posed(T_CELL_CAMERA, np.diag([1e-4] * 3 + [1e-4] * 3) ** 2)


def quad(x: float, y: float, z: float) -> tuple[Float, Float]:
    """A rectangle of half sizes x, y at height z over the camera's plane."""
    return np.array([[-x, -y, z], [x, -y, z], [x, y, z], [-x, y, z]]), np.array([[0, 1, 2], [0, 2, 3]])


@pytest.fixture(scope="module")
def caster() -> Raycaster:
    """A plate 1 m away that fills the view but for its left and right, and a small one 0.2 m before it."""
    parts = {"plate": quad(0.35, 1.0, 1.0), "clip": quad(0.05, 0.05, 0.8)}
    return Raycaster(Scene("cell", tuple(Part(name, *mesh) for name, mesh in parts.items())))  # type: ignore[arg-type]


def plane_depth(z: float) -> Float:
    """z-depth (H, W) of the plane at height z of the cell, by formula."""
    rays = CAMERA.rays() @ T_CELL_CAMERA[:3, :3].T
    return np.asarray((z - T_CELL_CAMERA[2, 3]) / rays[..., 2])


def seen(caster: Raycaster, **changes: object) -> tuple[View, Label]:
    """A view that measured its label exactly but for the changes, and that label."""
    shape = CAMERA.shape
    view = View(
        stamp_ns=1,
        dwell_ns=0,
        camera=CAMERA,
        depth=np.full(shape, np.nan, np.float32),
        sigma=np.full(shape, 1e-3, np.float32),
        count=np.ones(shape, np.uint16),
        reason=np.zeros(shape, np.uint8),
        robot=None,
    )
    first = label_view(view, POSED, caster)
    view = replace(view, depth=first.depth.copy(), **changes)  # type: ignore[arg-type]
    return view, first


def test_the_label_is_the_plane_the_ray_meets_first(caster: Raycaster) -> None:
    _, label = seen(caster)
    assert set(np.unique(label.part)) == {-1, 0, 1}
    for part, z in ((0, 1.0), (1, 0.8)):
        pure = cv2.erode(((label.part == part) & (label.mixed == 0)).astype(np.uint8), np.ones((5, 5), np.uint8)) == 1
        assert pure.sum() > 25
        np.testing.assert_allclose(label.depth[pure], plane_depth(z)[pure], atol=2e-5)
    assert np.isnan(label.depth[label.part == -1]).all()


def test_a_rendering_that_the_caller_has_is_the_label(caster: Raycaster) -> None:
    view, label = seen(caster)
    nearer = render(caster, CAMERA, T_CELL_CAMERA @ se3.exp([0.0, 0.0, 0.1, 0.0, 0.0, 0.0]))
    given = label_view(view, POSED, caster, rendering=nearer)
    np.testing.assert_array_equal(given.depth, nearer.depth)
    assert np.nanmedian(given.depth) == pytest.approx(np.nanmedian(label.depth) - 0.1, abs=0.01)


def test_a_label_is_seen_through_the_lens_of_its_pose(caster: Raycaster) -> None:
    view, label = seen(caster)
    other = with_lens(CAMERA, np.array([0.0, 0.0, 3.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
    through = label_view(view, replace(POSED, camera=other), caster)
    # A principal point three pixels to the right moves the picture by as much.
    np.testing.assert_array_equal(through.part[:, 3:], label.part[:, :-3])


def test_incidence_is_the_angle_to_the_normal(caster: Raycaster) -> None:
    _, label = seen(caster)
    cosine = (CAMERA.rays() @ T_CELL_CAMERA[:3, :3].T)[..., 2] / CAMERA.ray_length()
    plate = (label.part == 0) & (label.mixed == 0)
    np.testing.assert_allclose(np.cos(label.incidence[plate]), cosine[plate], atol=1e-5)


def test_the_mask_is_empty_where_the_cad_is_missed(caster: Raycaster) -> None:
    view, _ = seen(caster)
    label = label_view(view, POSED, caster)
    np.testing.assert_array_equal(label.mask == 1, label.sigma <= 0.01)
    assert (label.mask == 1).sum() > 0.98 * np.isfinite(label.depth).sum()
    assert label.mask.dtype == np.uint8
    assert label.part.dtype == np.int16


def test_a_pixel_without_return_keeps_its_label(caster: Raycaster) -> None:
    view, _ = seen(caster)
    view.depth[20:40, 30:50] = np.nan
    label = label_view(view, POSED, caster)
    np.testing.assert_array_equal(label.mask[20:40, 30:50] == 1, label.sigma[20:40, 30:50] <= 0.01)


def test_a_hand_before_the_part_is_masked_and_sensor_errors_are_not(caster: Raycaster) -> None:
    view, first = seen(caster)
    view.depth[5:20, 30:50] -= 0.25  # a hand
    view.depth[45:55, 30:50] += 0.005  # multipath
    view.depth[:, 60] += 0.3  # one column of mixed pixels
    label = label_view(view, POSED, caster)
    assert (label.mask[5:20, 30:50] == 0).all()
    unchanged = first.sigma <= 0.01
    unchanged[2:23, 27:53] = False
    assert (label.mask[unchanged] == 1).all()


def test_the_robots_own_gripper_and_a_refused_pose_are_masked(caster: Raycaster) -> None:
    view, _ = seen(caster)
    view.reason[50:, :] = Reason.SELF
    label = label_view(view, POSED, caster)
    assert (label.mask[50:] == 0).all()
    assert label.mask[:50].any()
    refused = label_view(view, replace(POSED, accepted=False, verdict="too little support"), caster)
    assert not refused.mask.any()
    np.testing.assert_array_equal(refused.depth, label.depth)


def test_grazing_labels_are_masked_by_configuration(caster: Raycaster) -> None:
    view, _ = seen(caster)
    label = label_view(view, POSED, caster, LabelConfig(max_incidence_deg=15.0))
    used = label.mask == 1
    assert used.any()
    assert label.incidence[used].max() <= np.radians(15.0)
    assert np.isfinite(label.depth[~used]).any()


def test_pixels_that_may_see_either_of_two_surfaces_are_masked_and_no_others(caster: Raycaster) -> None:
    view, _ = seen(caster)
    label = label_view(view, POSED, caster)
    unsure = np.isfinite(label.depth) & (label.mask == 0)
    assert unsure.any()
    assert (label.mixed[unsure] > 0.25).all(), "each sees plate and clip in nearly equal shares"
    everything = label_view(view, POSED, caster, LabelConfig(max_sigma_mm=1e6))
    np.testing.assert_array_equal(everything.mask == 1, np.isfinite(label.depth))


def test_a_less_certain_pose_makes_a_less_certain_label(caster: Raycaster) -> None:
    view, _ = seen(caster)
    sure = label_view(view, POSED, caster, LabelConfig(unseen_offset_mm=0.0, cad_sigma_mm=0.0))
    unsure = label_view(view, replace(POSED, cov=100 * POSED.cov), caster, LabelConfig(unseen_offset_mm=0.0, cad_sigma_mm=0.0))
    pure = (sure.part == 0) & (sure.mixed == 0)
    inner = cv2.erode(pure.astype(np.uint8), np.ones((9, 9), np.uint8)) == 1
    np.testing.assert_allclose(unsure.sigma[inner] / sure.sigma[inner], 10.0, rtol=1e-3)


def test_a_part_that_stands_elsewhere_does_not_excuse_itself(caster: Raycaster) -> None:
    """The solution finds the clip to stand 8 mm off, and it stands 18 mm off: its pixels are no labels for all that."""
    view, label = seen(caster)
    on = label.part == 1
    posed = replace(POSED, parts=np.array([0.0, 0.008]))
    moved = replace(view, depth=np.where(on, view.depth - np.float32(0.018), view.depth))
    inner = cv2.erode(on.astype(np.uint8), np.ones((3, 3), np.uint8)) == 1
    assert (label_view(view, posed, caster).reason[inner] == LabelReason.USABLE).all()
    assert (label_view(moved, posed, caster).reason[inner] == LabelReason.FOREIGN).all()


def test_a_part_that_is_not_there_is_absent_and_not_uncertain(caster: Raycaster) -> None:
    """The solution takes an absent clip to stand 30 mm off: its label is uncertain by that, and yet the reason is its absence."""
    view, _ = seen(caster)
    posed = Posed(POSED.T_cell_camera, POSED.cov_right, parts=np.array([0.0, 0.03]))
    world = np.where(seen(caster)[1].part == 1, np.uint8(ABSENT), np.uint8(NONE))
    reason = label_view(view, posed, caster, world=world).reason
    clip = label_view(view, posed, caster, world=np.zeros_like(world)).reason[world == ABSENT]
    assert (clip == LabelReason.UNCERTAIN).all()
    assert (reason[world == ABSENT] == LabelReason.ABSENT).all()
    assert not (reason[world == NONE] == LabelReason.ABSENT).any()
