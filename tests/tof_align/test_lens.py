# SPDX-License-Identifier: Apache-2.0
"""A session taken through another lens than CameraInfo states: poses hold, and the lens is found."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.tof_align.made import CAMERA, CONFIG, Truth, pose_error, section, session, true_depth
from tof_align.lens import Lens
from tof_align.session import SessionSolution, solve_session
from tof_core.lens import apart_px, with_lens

if TYPE_CHECKING:
    from tof_core.camera import Camera
    from tof_core.capture import View

WRONG = with_lens(CAMERA, np.array([0.006, 0.005, 1.0, -0.8, -0.02, 0.0, 0.0, 0.0]))
"""Half a per cent of focal length and one pixel of principal point, as an uncalibrated lens has."""


def taken(lens: Camera, *, distance: bool) -> tuple[list[View], list[Truth]]:
    """Views through `lens` whose CameraInfo states `CAMERA`; distance: z was computed from distance by the stated lens."""
    views, truth = session(section(), views=10, camera=lens)
    ratio = lens.ray_length() / CAMERA.ray_length() if distance else np.ones(CAMERA.shape)
    return [replace(v, camera=CAMERA, depth=(v.depth * ratio).astype(np.float32)) for v in views], truth


def off_mm(solution: SessionSolution, truth: list[Truth]) -> float:
    return float(np.median([pose_error(p.T_cell_camera, t)[0] for p, t in zip(solution.posed, truth, strict=True)]))


def label_off_mm(solution: SessionSolution, truth: list[Truth]) -> float:
    """Median error of the depth rendered through the camera of each pose."""
    errors = [
        np.abs(true_depth(section(), p.T_cell_camera, p.seen_by(CAMERA))[0] - t.depth) for p, t in zip(solution.posed, truth, strict=True)
    ]
    return 1e3 * float(np.nanmedian(np.stack(errors)))


@pytest.mark.parametrize("distance", [True, False], ids=["z by the stated lens", "z by the true lens"])
def test_poses_hold_under_a_wrong_lens_and_labels_are_seen_through_the_true_one(*, distance: bool) -> None:
    views, truth = taken(WRONG, distance=distance)
    found = solve_session(views, section(), CONFIG)
    believed = solve_session(views, section(), replace(CONFIG, discrepancy=replace(CONFIG.discrepancy, lens=False)))
    assert off_mm(believed, truth) > 2.0, "a lens that is believed moves the cameras"
    assert off_mm(found, truth) < 0.3 * off_mm(believed, truth)
    assert label_off_mm(found, truth) < 0.3
    assert found.lens is not None
    assert apart_px(found.lens.camera, WRONG) < 0.35 * apart_px(CAMERA, WRONG)
    assert {p.camera for p in found.posed} == {found.lens.camera}


def test_a_lens_as_stated_stays_and_costs_no_accuracy_that_matters() -> None:
    views, truth = session(section(), views=10)
    found = solve_session(views, section(), CONFIG)
    assert off_mm(found, truth) < 0.3
    assert found.lens is not None
    assert apart_px(CAMERA, found.lens.camera) < 0.1
    assert label_off_mm(found, truth) < 0.05


def test_labels_belong_to_the_lens_beside_which_poses_were_solved_however_near_the_stated_one() -> None:
    near = with_lens(CAMERA, 0.05 * np.array([0.006, 0.005, 1.0, -0.8, -0.02, 0.0, 0.0, 0.0]))
    assert apart_px(CAMERA, near) < 0.1
    views, truth = taken(near, distance=True)
    found = solve_session(views, section(), CONFIG)
    through_stated = replace(found, posed=tuple(replace(p, camera=None) for p in found.posed))
    assert label_off_mm(found, truth) < 0.06
    assert label_off_mm(through_stated, truth) > 2.0 * label_off_mm(found, truth)


def test_a_view_seen_through_the_lens_has_its_rays_and_z_along_them() -> None:
    views, truth = taken(WRONG, distance=True)
    through = Lens(WRONG, np.array([0.006, 0.005, 1.0, -0.8, -0.02, 0.0, 0.0, 0.0])).over(views[0])
    assert through.camera == WRONG
    before, after = (np.nanmedian(np.abs(d - truth[0].depth)) for d in (views[0].depth, through.depth))
    bias = np.nanmean((through.depth - truth[0].depth)[:20, :20])
    assert after <= before
    assert abs(bias) < 0.15e-3
