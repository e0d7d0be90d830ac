# SPDX-License-Identifier: Apache-2.0
"""Real and foreign bags are read as they are: sizes, valid pixels, TF, temperatures."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from tof_core.bag import BagOptions, Placement, open_bag
from tof_core.errors import TransformError
from tof_core.motion import StationTracker

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.shared


@pytest.mark.parametrize(
    ("name", "shape", "frames", "model", "valid"),
    [
        ("real/azure_kinect_nfov/bag", (576, 640), 1, "rational_polynomial", 0.765),
        ("real/azure_kinect_static/bag", (1080, 1405), 2, "plumb_bob", 0.795),
        ("real/ifm_o3r/bag_radial", (172, 224), 1, "plumb_bob", 0.259),
    ],
)
def test_real_captures(shared_data: Path, name: str, shape: tuple[int, int], frames: int, model: str, valid: float) -> None:
    with open_bag(shared_data / name) as reader:
        captures = list(reader.captures(need_tf=False))
        assert reader.camera.distortion_model == model
        assert not reader.skipped
    assert [c.depth.shape for c in captures] == [shape] * frames
    assert all(c.robot is None and np.isnan(c.temperature) for c in captures)
    for c in captures:
        assert np.isfinite(c.depth).mean() == pytest.approx(valid, abs=0.002)
        np.testing.assert_array_equal(np.isfinite(c.depth), c.reason == 0)
        assert 0.1 < np.nanmedian(c.depth) < 5.0
        assert c.amplitude is not None
        assert c.amplitude.shape == shape


@pytest.mark.parametrize("name", ["example_null", "example_wiggling"])
def test_cases_of_a_foreign_camera(shared_data: Path, name: str) -> None:
    with open_bag(shared_data / "cases" / name / "bag", cell_frame="cell") as reader:
        captures = list(reader.captures())
        assert not reader.skipped
        assert reader.transforms.frames() == ("body", "cell", "hand_depth_sensor")
        assert reader.chain.resolve("hand_depth_sensor") == ("cell", "body")
    assert [c.depth.shape for c in captures] == [(171, 224)] * 12
    assert sorted(c.stamp_ns for c in captures) == [c.stamp_ns for c in captures]
    temperatures = [c.temperature for c in captures]
    assert temperatures == sorted(temperatures)
    assert 26 < temperatures[0] < 27
    assert 38 < temperatures[-1] < 39
    assert min(np.isfinite(c.depth).mean() for c in captures) > 0.74
    tracker = StationTracker()
    stations = [tracker.push(c.robot.T_cell_body) for c in captures if c.robot is not None]
    assert stations == [0] * 6 + [1] * 6


def test_a_real_bag_without_tf_is_refused_until_it_is_placed(shared_data: Path) -> None:
    path = shared_data / "real/azure_kinect_static/bag"
    with open_bag(path, cell_frame="cell") as reader, pytest.raises(TransformError, match="--initial-pose"):
        list(reader.captures())
    with open_bag(path, cell_frame="cell", placed=Placement("color_camera", np.eye(4))) as reader:
        assert [c.robot is not None for c in reader.captures()] == [True, True]


def test_radial_depth_is_longer_than_z_by_the_ray(shared_data: Path) -> None:
    path = shared_data / "real/ifm_o3r/bag_radial"
    with open_bag(path) as reader:
        stored = next(reader.captures(need_tf=False))
    with open_bag(path, BagOptions(depth="radial")) as reader:
        z = next(reader.captures(need_tf=False))
    np.testing.assert_allclose(z.depth * stored.camera.ray_length(), stored.depth, rtol=1e-6)
    assert np.nanmax(stored.depth - z.depth) > 0.05
