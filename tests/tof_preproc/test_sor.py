# SPDX-License-Identifier: Apache-2.0
"""`paper` equals Open3D's filter; `scaled` removes isolated points, and no far or grazing surface."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from benchmarks.tof_frames import captures, edge_rich, noise_of, plane
from tof_core.reasons import Reason
from tof_preproc import sor
from tof_preproc.config import PreprocConfig, SorConfig
from tof_preproc.frame import Frame
from tof_preproc.sor import remove_sor

if TYPE_CHECKING:
    from tof_core.arrays import Mask
    from tof_core.capture import Capture

PAPER = PreprocConfig(sor=SorConfig(method="paper"))


def removed(capture: Capture, config: PreprocConfig) -> Mask:
    frame = Frame(capture.camera, capture.depth.copy(), capture.reason.copy(), np.ones_like(capture.depth))
    assert remove_sor(frame, config) == np.count_nonzero(frame.reason == Reason.SOR)
    return np.asarray(frame.reason == Reason.SOR)


def removed_by_open3d(capture: Capture, neighbours: int, ratio: float) -> Mask:
    o3d = pytest.importorskip("open3d", reason="open3d, the peer that the filter is measured against, is not installed")
    points = capture.camera.points(capture.depth).reshape(-1, 3)
    known = np.flatnonzero(np.isfinite(points).all(axis=1))
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points[known]))
    _, kept = cloud.remove_statistical_outlier(neighbours, ratio)
    gone = np.ones(known.size, bool)
    gone[np.asarray(kept)] = False
    out = np.zeros(capture.depth.size, bool)
    out[known] = gone
    return out.reshape(capture.depth.shape)


@pytest.mark.parametrize(("spikes", "dropouts", "noise"), [(0, 0, 0), (0, 0, 1), (0.01, 0.1, 1)])
def test_the_papers_filter_removes_what_open3d_removes(spikes: float, dropouts: float, noise: float) -> None:
    capture = captures(edge_rich(), spikes=spikes, dropouts=dropouts, noise=noise)[0]
    ours, theirs = removed(capture, PAPER), removed_by_open3d(capture, 20, 2.0)
    both = np.count_nonzero(ours & theirs)
    assert 2 * both / (np.count_nonzero(ours) + np.count_nonzero(theirs)) > 0.98


def test_neighbours_and_ratio_mean_what_they_mean_there() -> None:
    capture = captures(edge_rich(), spikes=0.01)[0]
    ours = removed(capture, PreprocConfig(sor=SorConfig(method="paper", neighbours=8, ratio=1.0)))
    theirs = removed_by_open3d(capture, 8, 1.0)
    assert np.count_nonzero(ours ^ theirs) < 0.02 * np.count_nonzero(theirs)


def test_scaled_spares_the_far_half_of_a_clean_slanted_plane_that_the_papers_filter_cuts() -> None:
    capture = captures(plane(incidence_deg=55.0), noise=0.2)[0]
    far = capture.depth > np.quantile(capture.depth, 0.95)
    assert removed(capture, PAPER)[far].mean() > 0.4
    assert removed(capture, PreprocConfig()).sum() == 0


def test_scaled_removes_lone_spikes_and_spares_surfaces() -> None:
    truth = edge_rich()
    capture = captures(truth, spikes=0.01)[0]
    spike = np.abs(capture.depth - truth.depth) > 0.1 + 6 * noise_of(truth)
    gone = removed(capture, PreprocConfig())
    assert gone[spike].mean() > 0.95
    assert gone[~spike & ~truth.mixed].mean() < 0.003


@pytest.mark.parametrize(("incidence", "noise"), [(30.0, 1.0), (55.0, 0.2)])
@pytest.mark.parametrize("config", [PAPER, PreprocConfig()], ids=["paper", "scaled"])
def test_a_limit_from_a_sample_removes_what_the_limit_from_all_points_removes(
    config: PreprocConfig, incidence: float, noise: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    frames = [captures(edge_rich(), spikes=0.01, dropouts=0.05, noise=noise)[0], captures(plane(incidence_deg=incidence), noise=noise)[0]]
    sampled = [removed(capture, config) for capture in frames]
    monkeypatch.setattr(sor, "SAMPLES", frames[0].depth.size)
    for capture, some in zip(frames, sampled, strict=True):
        assert np.count_nonzero(some ^ removed(capture, config)) <= 5e-4 * capture.depth.size + 0.01 * np.count_nonzero(some)


def test_two_points_or_none_are_no_cloud_to_judge() -> None:
    capture = captures(plane())[0]
    for left in (0, 1):
        depth = np.full_like(capture.depth, np.nan)
        depth[:1, :left] = 1.0
        frame = Frame(capture.camera, depth, capture.reason.copy(), np.ones_like(depth))
        assert remove_sor(frame, PreprocConfig()) == 0


def test_reference_pixels_without_a_ray_the_others_are_judged() -> None:
    """A lens model that folds over in the corners gives no ray there, and no spacing of the points beside."""
    pinhole = captures(plane(incidence_deg=30.0), noise=0.2)[0]
    capture = replace(pinhole, camera=replace(pinhole.camera, distortion_model="plumb_bob", distortion=(-0.6, 0.0, 0.0, 0.0, 0.0)))
    rays = np.isfinite(capture.camera.rays()).all(axis=-1)
    assert 0.0 < (~rays).mean() < 0.5
    capture.depth[~rays] = np.nan
    assert removed(capture, PreprocConfig())[rays].mean() < 0.05
