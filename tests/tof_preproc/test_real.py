# SPDX-License-Identifier: Apache-2.0
"""Preprocessing of all real captures: surfaces are kept, visible outliers removed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from tof_core.bag import open_bag
from tof_core.options import BagOptions
from tof_core.reasons import Reason
from tof_preproc.config import PreprocConfig
from tof_preproc.preprocessor import accumulate_views

if TYPE_CHECKING:
    from pathlib import Path

    from tof_core.capture import Capture

REAL = {
    "azure_kinect_nfov/bag": (1, "z", 0.001),
    "azure_kinect_static/bag": (2, "z", 0.001),
    "ifm_o3r/bag_radial": (1, "radial", 0.0),
}
CASES = ("example_null", "example_wiggling")

pytestmark = pytest.mark.shared


def captures_of(bag: Path, depth: str = "z") -> list[Capture]:
    with open_bag(bag, BagOptions(depth=depth)) as reader:
        return list(reader.captures(need_tf=False))


@pytest.mark.parametrize("preset", ["default", "paper"])
@pytest.mark.parametrize("name", sorted(REAL))
def test_real_captures(shared_data: Path, name: str, preset: str) -> None:
    count, kind, quantum = REAL[name]
    frames = captures_of(shared_data / "real" / name, kind)
    assert len(frames) == count
    for frame in frames:
        (view,) = accumulate_views([frame], PreprocConfig(preset=preset))
        before = np.isfinite(frame.depth)
        assert not (view.valid & ~before).any()
        assert view.valid[before].mean() > 0.94
        np.testing.assert_array_equal(view.depth[view.valid], frame.depth[view.valid])
        np.testing.assert_array_equal(view.valid, view.reason == Reason.VALID)
        assert view.noise is not None
        assert quantum / np.sqrt(12) * 0.99 < np.median(view.noise[view.valid]) < 5e-3


def test_the_noise_of_a_static_scene_is_estimated_from_two_frames(shared_data: Path) -> None:
    first, second = captures_of(shared_data / "real" / "azure_kinect_static/bag")
    views = list(accumulate_views([first, second]))
    between = np.abs(second.depth - first.depth)
    expected = np.nanmedian(between) / 0.6745 / np.sqrt(2)
    assert len(views) == 1
    assert views[0].noise is not None
    assert np.nanmedian(views[0].noise) == pytest.approx(expected, rel=0.35)


@pytest.mark.parametrize("name", CASES)
def test_foreign_cases(shared_data: Path, name: str) -> None:
    frames = captures_of(shared_data / "cases" / name / "bag")
    views = list(accumulate_views(frames))
    assert len(views) == len(frames) == 12
    for view, frame in zip(views, frames, strict=True):
        assert view.valid[np.isfinite(frame.depth)].mean() > 0.93
        assert np.isfinite(view.sigma[view.valid]).all()
