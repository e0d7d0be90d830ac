# SPDX-License-Identifier: Apache-2.0
"""Two runs of the graph compared number by number."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from tof_core.bag_writer import BagWriter
from tof_core.camera import Camera
from tof_core.errors import BagError
from tof_eval.runs import compare_runs

if TYPE_CHECKING:
    from pathlib import Path

CAMERA = Camera(8, 6, 10.0, 10.0, 3.5, 2.5, frame_id="camera")


def run(path: Path, *, depth: dict[int, Any] | None = None, x: float = 1.0, frames: int = 3) -> Path:
    """A recorded run: depth and pose of `frames` frames; `depth` overrides single ones."""
    with BagWriter(path) as bag:
        for stamp in range(1, frames + 1):
            image = np.full(CAMERA.shape, 0.5, np.float32)
            image[0, 0] = np.nan
            image = (depth or {}).get(stamp, image)
            bag.image("/preproc/depth", image, "32FC1", "camera", stamp)
            bag.camera_info("/preproc/camera_info", CAMERA, stamp)
            T = np.eye(4)
            T[0, 3] = x
            bag.pose("/label/pose", T, "cell", stamp, np.eye(6))
            bag.image("/diagnostics", image, "32FC1", "camera", stamp)
    return path


def test_equal_runs_are_the_same_nan_included(tmp_path: Path) -> None:
    result = compare_runs(run(tmp_path / "a"), run(tmp_path / "b"))
    assert result.same
    assert result.compared == {"/preproc/depth": 3, "/preproc/camera_info": 3, "/label/pose": 3}
    assert max(result.largest.values()) == 0.0


def test_the_first_frame_and_topic_that_differ_are_named(tmp_path: Path) -> None:
    changed = np.full(CAMERA.shape, 0.5, np.float32)
    changed[0, 0] = np.nan
    changed[4, 5] = 0.50001
    result = compare_runs(run(tmp_path / "a", depth={2: changed, 3: changed}), run(tmp_path / "b"))
    assert result.first is not None
    assert (result.first.stamp_ns, result.first.topic) == (2, "/preproc/depth")
    assert "differs in 1 of 48 values by more than 1e-06, first at (4, 5): 0.50001" in str(result.first)
    assert result.largest["/preproc/depth"] == pytest.approx(1e-5, rel=1e-2)


def test_differences_within_the_tolerance_pass_and_are_reported(tmp_path: Path) -> None:
    result = compare_runs(run(tmp_path / "a", x=1.00001), run(tmp_path / "b"))
    assert result.same
    assert result.largest["/label/pose"] == pytest.approx(1e-5, rel=1e-6)
    assert not compare_runs(run(tmp_path / "c", x=1.0001), tmp_path / "b").same


def test_a_pixel_valid_in_one_run_alone_differs_whatever_the_tolerance(tmp_path: Path) -> None:
    filled = np.full(CAMERA.shape, 0.5, np.float32)
    result = compare_runs(run(tmp_path / "a", depth={1: filled}), run(tmp_path / "b"))
    assert result.first is not None
    assert "0.5, recorded was nan" in result.first.what


def test_missing_and_surplus_frames_differ(tmp_path: Path) -> None:
    short, full = run(tmp_path / "a", frames=2), run(tmp_path / "b")
    assert "is missing in the new run" in str(compare_runs(short, full).first)
    assert "is not in the recorded run" in str(compare_runs(full, short).first)


def test_a_size_that_changed_differs(tmp_path: Path) -> None:
    small = np.full((3, 4), 0.5, np.float32)
    assert "shape (3, 4), recorded was (6, 8)" in str(compare_runs(run(tmp_path / "a", depth={1: small}), run(tmp_path / "b")).first)


def test_a_bag_without_outputs_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BagError, match="replay --record"):
        compare_runs(run(tmp_path / "a"), tmp_path / "nothing")
