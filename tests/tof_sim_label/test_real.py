# SPDX-License-Identifier: Apache-2.0
"""Real captures: a room fitted once and recognised again, radial depth refused, two foreign sessions labelled."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from benchmarks.primitive_scene import primitive_scene
from benchmarks.primitives import PrimitiveConfig, Sphere, fit_primitives
from tof_align.single import align_view
from tof_core import se3
from tof_core.bag import BagOptions, open_bag
from tof_core.capture import View
from tof_core.errors import RefusedError
from tof_core.motion import StationTracker
from tof_scene.raycast import Raycaster
from tof_scene.scene_file import load_scene, save_scene
from tof_sim_label.gate import RadialGate
from tof_sim_label.label import label_view
from tof_sim_label.labeller import label_session

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.shared
LOOSE = np.diag(np.repeat([0.03, np.radians(2.0)], 3)) ** 2


def captures_of(bag: Path, depth: str = "z") -> list[View]:
    """Every capture of a bag without TF as a view."""
    with open_bag(bag, BagOptions(depth=depth)) as reader:
        return [View.of_capture(c) for c in reader.captures(need_tf=False)]


@pytest.fixture(scope="module")
def pair(shared_data: Path) -> list[View]:
    return captures_of(shared_data / "real/azure_kinect_static/bag")


@pytest.fixture(scope="module")
def room(pair: list[View], tmp_path_factory: pytest.TempPathFactory) -> Raycaster:
    """Planes and spheres of the first frame, written as a scene.yaml and read again."""
    config = PrimitiveConfig(stride=4, candidates=150)
    found = fit_primitives(pair[0].depth, pair[0].camera, config)
    spheres = [f.surface.radius for f in found if isinstance(f.surface, Sphere)]
    assert len(spheres) >= 2, "the two large balls on the cabinet"
    file = save_scene(primitive_scene(found, pair[0].camera, config.stride), tmp_path_factory.mktemp("room"))
    return Raycaster(load_scene(file))


def test_the_other_frame_is_aligned_to_the_fitted_room_from_a_rough_guess(pair: list[View], room: Raycaster) -> None:
    rough = se3.exp([0.02, -0.015, 0.02, 0.015, -0.01, 0.01])
    found = align_view(pair[1], room, rough, LOOSE)
    assert found.posed.accepted
    # The camera stood still between the frames, so the pose is the identity; the room is known no better than its fit.
    metres, degrees = se3.distance(found.posed.T_cell_camera, np.eye(4))
    assert metres < 8e-3
    assert degrees < 0.3


def test_without_a_prior_the_sensors_own_errors_cancel_between_the_frames(pair: list[View], room: Raycaster) -> None:
    rough = se3.exp([0.02, -0.015, 0.02, 0.015, -0.01, 0.01])
    metres, degrees = se3.distance(align_view(pair[1], room, rough, None).posed.T_cell_camera, np.eye(4))
    assert metres < 2e-3
    assert degrees < 0.06


def test_labels_of_the_other_frame_agree_with_what_it_measured(pair: list[View], room: Raycaster) -> None:
    found = align_view(pair[1], room, np.eye(4), LOOSE)
    label = label_view(pair[1], found.posed, room)
    used = (label.mask == 1) & np.isfinite(pair[1].depth)
    error = np.abs(pair[1].depth - label.depth)[used]
    assert used.mean() > 0.6
    assert np.median(error) < 2.5e-3
    assert (error < 3 * np.hypot(label.sigma[used], 2e-3)).mean() > 0.9


def test_the_radial_bag_is_refused_as_z_and_passes_as_radial(shared_data: Path) -> None:
    bag = shared_data / "real/ifm_o3r/bag_radial"
    with pytest.raises(RefusedError, match=r"a plane bends.*pass --depth radial"):
        RadialGate().check(captures_of(bag)[0])
    view = captures_of(bag, "radial")[0]
    RadialGate().check(view)
    found = fit_primitives(view.depth, view.camera, PrimitiveConfig(stride=1, tolerance_mm=6.0, min_share=0.02))
    assert max(f.rms for f in found) < 4e-3


@pytest.mark.parametrize("kind", ["azure_kinect_static", "azure_kinect_nfov"])
def test_z_of_real_cameras_passes(shared_data: Path, kind: str) -> None:
    RadialGate().check(captures_of(shared_data / "real" / kind / "bag")[0])


@pytest.mark.parametrize(("case", "median_mm"), [("example_null", 4.0), ("example_wiggling", 12.0)])
def test_both_foreign_cases_are_labelled(shared_data: Path, case: str, median_mm: float) -> None:
    scene = load_scene(shared_data / "cases" / case / "scene")
    tracker, views = StationTracker(), list[View]()
    with open_bag(shared_data / "cases" / case / "bag", cell_frame=scene.frame) as reader:
        for capture in reader.captures():
            assert capture.robot is not None
            views.append(View.of_capture(capture, tracker.push(capture.robot.T_cell_body)))
    assert len(views) == 12
    solution, labels = label_session(views, Raycaster(scene))
    assert solution.stations == (0, 1)
    for view, label in labels:
        assert label.posed.accepted, label.posed.verdict
        used = (label.mask == 1) & np.isfinite(view.depth)
        assert used.mean() > 0.7
        assert 1e3 * np.median(np.abs(view.depth - label.depth)[used]) < median_mm
        assert set(np.unique(label.part)) <= set(range(-1, len(scene.parts)))
