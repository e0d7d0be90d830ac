# SPDX-License-Identifier: Apache-2.0
"""The gap watched live: growth is reported at the stated false-alarm rate, and pose error is no gap."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.tof_gap.quiet_views import views as plane_views
from tof_core import se3
from tof_core.camera import Camera
from tof_core.capture import Capture, View
from tof_core.errors import RefusedError
from tof_gap.watch import GapWatch, GrowthTest, WatchConfig, gap_beyond_pose
from tof_scene.builtin import make_builtin
from tof_scene.raycast import Raycaster
from tof_scene.render import render

if TYPE_CHECKING:
    from tof_core.arrays import Float

CAMERA = Camera(112, 86, 105.0, 105.0, 55.5, 42.5)
POSE_COV = np.diag(np.repeat([0.001, np.radians(0.1)], 3) ** 2)


def run_length(limit: int, rng: np.random.Generator) -> int:
    """Views until a false alarm, at most 600."""
    test = GrowthTest(WatchConfig(baseline=20, views_per_alarm=limit))
    for n, value in enumerate(rng.exponential(size=600)):
        test.add(float(value))
        if test.grown:
            return n
    return 600


def test_false_alarms_are_no_more_than_stated() -> None:
    rng = np.random.default_rng(4)
    lengths = [run_length(100, rng) for _ in range(100)]
    assert np.mean(lengths) > 100.0
    assert min(lengths) < 600  # The test is not deaf.


@pytest.mark.parametrize(("baseline", "most"), [(20, 12), (60, 7)])
def test_growth_is_reported_within_a_few_views_and_ends_with_it(baseline: int, most: int) -> None:
    rng = np.random.default_rng(5)
    test = GrowthTest(WatchConfig(baseline=20, views_per_alarm=1000))
    for value in rng.normal(size=baseline):
        test.add(float(value))
    for _ in range(most):
        test.add(float(rng.normal()) + 5.0)
    assert test.grown
    for value in rng.normal(size=40):
        test.add(float(value))
    assert not test.grown


@pytest.fixture(scope="module")
def caster() -> Raycaster:
    return Raycaster(make_builtin("body_section"))


def poses(n: int, rng: np.random.Generator) -> list[Float]:
    """Cameras 0.9 m before the section, looking at it."""
    R = np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, [0.9, 0.0, 0.8]
    return [np.asarray(T @ se3.exp(rng.normal(0, [0.05, 0.05, 0.02, 0.05, 0.05, 0.05]))) for _ in range(n)]


def seen(caster: Raycaster, T: Float, rng: np.random.Generator, wave_m: float = 0.0) -> View:
    """A capture with 2 mm of noise, and a gap that waves over the image."""
    depth = render(caster, CAMERA, T).depth
    row, column = np.mgrid[: CAMERA.height, : CAMERA.width]
    gap = wave_m * np.sqrt(2) * np.sin(2 * np.pi * column / 56) * np.sin(2 * np.pi * row / 43) * np.sqrt(2)
    measured = (depth + gap + rng.normal(0, 0.002, depth.shape)).astype(np.float32)
    return View.of_capture(Capture(0, CAMERA, measured, np.zeros(depth.shape, np.uint8)))


def test_a_wave_is_a_gap_and_a_pose_error_is_none(caster: Raycaster) -> None:
    rng = np.random.default_rng(6)
    (T,) = poses(1, rng)
    watch = GapWatch(caster, WatchConfig())
    assert watch.add(seen(caster, T, rng), T, POSE_COV).gap_mm < 0.25
    off = T @ se3.exp([0.001, -0.001, 0.001, 0.001, 0.001, 0])
    assert watch.add(seen(caster, T, rng), off, POSE_COV).gap_mm < 0.5
    wavy = watch.add(seen(caster, T, rng, 0.005), T, POSE_COV)
    # What the means of 16-pixel blocks keep of that wave.
    assert wavy.gap_mm == pytest.approx(5.0 * np.sinc(16 / 56) * np.sinc(16 / 43), rel=0.15)
    assert wavy.state == "learning"
    assert wavy.residual.shape == CAMERA.shape


def test_the_gap_of_a_part_is_what_is_beyond_the_noise_on_it(caster: Raycaster) -> None:
    rng = np.random.default_rng(11)
    (T,) = poses(1, rng)
    view, part = seen(caster, T, rng), render(caster, CAMERA, T).part
    names = caster.scene.names
    off = names[int(np.bincount(part[part >= 0]).argmax())]
    moved = replace(view, depth=view.depth + np.where(part == names.index(off), np.float32(0.004), np.float32(0.0)))
    found = GapWatch(caster, WatchConfig()).add(moved, T, POSE_COV).parts_mm
    assert found[off] == pytest.approx(4.0, abs=0.3)
    assert max(mm for name, mm in found.items() if name != off) < 1.0
    assert all(np.isfinite(mm) for mm in found.values())


def test_a_gap_that_grows_is_reported(caster: Raycaster) -> None:
    rng = np.random.default_rng(7)
    watch = GapWatch(caster, WatchConfig(baseline=12, views_per_alarm=30))
    states = [watch.add(seen(caster, T, rng), T, POSE_COV).state for T in poses(13, rng)]
    assert states[-1] == "steady"
    after = [watch.add(seen(caster, T, rng, 0.002), T, POSE_COV) for T in poses(6, rng)]
    assert after[-1].state == "grown"
    assert "the gap grows" in after[-1].message


def test_another_camera_is_refused_until_restarted(caster: Raycaster) -> None:
    rng = np.random.default_rng(8)
    (T,) = poses(1, rng)
    watch = GapWatch(caster)
    view = seen(caster, T, rng)
    watch.add(view, T)
    other = replace(view, camera=replace(CAMERA, fx=110.0))
    with pytest.raises(RefusedError, match="calibration changed; its baseline is of another camera: call ~/reset"):
        watch.add(other, T)
    watch.restart()
    assert watch.add(other, T).views == 1


def test_a_view_beside_the_scene_is_refused(caster: Raycaster) -> None:
    rng = np.random.default_rng(9)
    (T,) = poses(1, rng)
    with pytest.raises(RefusedError, match="see the CAD"):
        GapWatch(caster).add(seen(caster, T, rng), T @ np.diag([-1.0, 1.0, -1.0, 1.0]))


@pytest.mark.dds
def test_figures_of_a_node_are_reset_with_its_baseline(caster: Raycaster, ros_domain: int) -> None:
    from tof_gap.node import make_node
    from tof_ros import messages
    from tof_ros.environment import parameter_overrides, ros_context

    rng = np.random.default_rng(8)
    (T,) = poses(1, rng)
    view, pose = seen(caster, T, rng), messages.pose(T, POSE_COV, messages.header(0, "cell"))
    other = replace(view, camera=replace(CAMERA, fx=110.0))
    with ros_context(domain=ros_domain) as context:
        node = make_node(context=context, parameter_overrides=parameter_overrides({"live.scene": "body_section"}))
        node.trigger_configure()

        def restart() -> None:
            node.trigger_deactivate()
            node.trigger_activate()

        node.trigger_activate()
        for forget in (node.reset, restart):
            node._judge(view, pose)
            node._judge(other, pose)
            assert (node.figures()["views"], "calibration changed" in node.warnings()[0]) == ("1", True)
            forget()
            assert ("views" in node.figures(), node.warnings()) == (False, [])
        node.destroy_node()


@pytest.mark.parametrize(("pose_sd_m", "kept"), [(1e-6, 1.0), (1.0, 0.0)])
def test_a_shift_along_the_axis_is_a_gap_only_where_the_pose_is_known(pose_sd_m: float, kept: float) -> None:
    (view, *_) = plane_views(np.random.default_rng(3))
    off = replace(view, residual=np.where(np.isfinite(view.residual), 0.003, np.nan))
    gap2, floor2 = gap_beyond_pose(off, np.diag(np.repeat([pose_sd_m, 1e-9], 3) ** 2), WatchConfig())
    white2 = float(np.mean(view.sigma[view.smooth] ** 2)) / 256
    assert gap2 == pytest.approx(kept * 0.003**2, abs=3 * white2)
    assert floor2 == pytest.approx(white2, rel=0.6)


def test_blocks_with_few_pixels_do_not_count() -> None:
    (view, *_) = plane_views(np.random.default_rng(3))
    with pytest.raises(RefusedError, match="only 0 blocks of pixels see the CAD"):
        gap_beyond_pose(view, POSE_COV, WatchConfig(block_pixels=257))
