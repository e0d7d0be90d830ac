# SPDX-License-Identifier: Apache-2.0
"""Dwells begin and end where they should; running and offline give the same numbers; every removed pixel has a reason."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.tof_frames import captures, edge_rich, noise_of, plane
from tof_core import se3
from tof_core.capture import Capture, Colour, RobotPose, View
from tof_core.config import from_mapping
from tof_core.reasons import Reason
from tof_preproc.config import PreprocConfig
from tof_preproc.preprocessor import Preprocessor, accumulate_views, warm_up


def at(capture: Capture, millimetres: float, degrees: float = 0.0, base: float = 0.0) -> Capture:
    pose = se3.exp([millimetres * 1e-3, 0, 0, 0, 0, np.deg2rad(degrees)])
    return replace(capture, robot=RobotPose(se3.exp([base, 0, 0, 0, 0, 0]), pose))


def same(one: View, other: View) -> None:
    for name in ("depth", "sigma", "noise", "count", "reason", "amplitude"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)
    assert (one.stamp_ns, one.dwell_ns, one.captures, one.station) == (other.stamp_ns, other.dwell_ns, other.captures, other.station)


@pytest.mark.parametrize("preset", ["default", "paper"])
def test_running_and_offline_give_the_same_numbers(preset: str) -> None:
    config = from_mapping(PreprocConfig, {"preset": preset, "accumulate.max_captures": 4})
    frames = captures(edge_rich(), 10, spikes=0.005, dropouts=0.02)
    running = Preprocessor(config)
    views = [running.push(f) for f in frames]
    assert [v.captures for v in views] == [1, 2, 3, 4, 1, 2, 3, 4, 1, 2]
    assert [v.dwell_ns for v in views] == [frames[i - i % 4].stamp_ns for i in range(10)]
    assert [v.stamp_ns for v in views] == [f.stamp_ns for f in frames], "a view is of its last capture"
    final = list(accumulate_views(frames, config))
    assert len(final) == 3
    for one, other in zip(final, (views[3], views[7], views[9]), strict=True):
        same(one, other)


def test_a_view_has_pose_and_temperature_of_its_last_capture() -> None:
    warm = [replace(at(f, 0.01 * i), temperature=30.0 + i) for i, f in enumerate(captures(plane(), 3))]
    (view,) = accumulate_views(warm)
    assert (view.captures, view.temperature, view.stamp_ns, view.dwell_ns) == (3, 32.0, warm[2].stamp_ns, warm[0].stamp_ns)
    assert view.robot is warm[2].robot


def test_a_view_of_one_capture_has_depth_sigma_and_noise_from_the_first_frame() -> None:
    truth = plane()
    view = Preprocessor().push(captures(truth)[0])
    assert view.noise is not None
    np.testing.assert_array_equal(view.valid, np.isfinite(view.sigma))
    np.testing.assert_array_equal(view.valid, np.isfinite(view.noise))
    assert np.nanmedian(view.sigma) == pytest.approx(noise_of(truth)[0, 0], rel=0.05)
    assert view.valid.mean() > 0.999


def test_every_removed_pixel_has_a_reason_and_no_pixel_appears() -> None:
    frames = captures(edge_rich(), 6, spikes=0.01, dropouts=0.1)
    preprocessor = Preprocessor()
    view = next(v for v in [preprocessor.push(f) for f in frames] if v.captures == 6)
    np.testing.assert_array_equal(view.valid, view.reason == Reason.VALID)
    np.testing.assert_array_equal(view.valid, view.count > 0)
    seen = np.any([np.isfinite(f.depth) for f in frames], axis=0)
    assert not (view.valid & ~seen).any()
    for stage, reason in (("flying", Reason.FLYING), ("grazing", Reason.GRAZING), ("sor", Reason.SOR)):
        assert preprocessor.counts[stage] == np.count_nonzero(view.reason == reason)
    assert preprocessor.counts["iqr"] > 0.005 * 6 * view.depth.size  # the spikes, over time


def test_a_capture_in_motion_is_a_view_of_one_and_ends_the_dwell() -> None:
    frames = captures(plane(), 5)
    preprocessor = Preprocessor()
    still = [True, True, False, True, True]
    views = [preprocessor.push(f, still=s) for f, s in zip(frames, still, strict=True)]
    assert [v.captures for v in views] == [1, 2, 1, 1, 2]
    assert views[2].valid.mean() > 0.999
    assert preprocessor.events == {"dwells": 3, "moved": 1}
    gated = list(accumulate_views(frames, still=lambda c: still[frames.index(c)]))
    assert [v.captures for v in gated] == [2, 1, 2]
    free = from_mapping(PreprocConfig, {"motion.enable": False})
    assert [v.captures for v in accumulate_views(frames, free, still=lambda _: False)] == [5]


def test_the_captures_own_poses_end_a_dwell() -> None:
    frames = captures(plane(), 6)
    placed = [at(f, mm, deg) for f, mm, deg in zip(frames, (0, 0.5, 40, 40.5, 40, 40), (0, 0, 0, 0, 0, 5), strict=True)]
    assert [v.captures for v in accumulate_views(placed)] == [2, 3, 1]


def test_slow_travel_ends_a_dwell() -> None:
    frames = [at(f, 0.4 * i) for i, f in enumerate(captures(plane(), 6))]
    assert [v.captures for v in accumulate_views(frames)] == [3, 3]


def test_the_base_begins_a_station() -> None:
    frames = captures(plane(), 4)
    placed = [at(f, 0, base=b) for f, b in zip(frames, (0, 0, 0.5, 0.5), strict=True)]
    assert [(v.station, v.captures) for v in accumulate_views(placed)] == [(0, 2), (1, 2)]
    preprocessor = Preprocessor()
    assert [preprocessor.push(f, station=s).captures for f, s in zip(frames, (0, 0, 1, 1), strict=True)] == [1, 2, 1, 2]


def test_a_pause_or_a_jump_back_in_time_begins_a_dwell() -> None:
    frames = captures(plane(), 4)
    later = [replace(f, stamp_ns=f.stamp_ns + (10**10 if i > 1 else 0)) for i, f in enumerate(frames)]
    assert [v.captures for v in accumulate_views(later)] == [2, 2]
    looped = [*frames[2:], *frames[:2]]
    assert [v.captures for v in accumulate_views(looped)] == [2, 2]


def test_frozen_frames_are_one_frame() -> None:
    a, b, c = captures(plane(), 3)
    preprocessor = Preprocessor()
    preprocessor.push(a)
    first = preprocessor.push(b)
    assert preprocessor.push(replace(c, stamp_ns=b.stamp_ns)) is first  # same stamp
    assert preprocessor.push(replace(b, stamp_ns=c.stamp_ns)) is first  # same content
    assert preprocessor.events["frozen"] == 2
    assert preprocessor.push(c).captures == 3
    assert [v.captures for v in accumulate_views([a, a, b, c, replace(c, stamp_ns=c.stamp_ns + 1)])] == [3]


def test_reset_forgets() -> None:
    a, b = captures(plane(), 2)
    preprocessor = Preprocessor()
    preprocessor.push(a)
    preprocessor.reset()
    assert preprocessor.push(a).captures == 1
    preprocessor.reset()
    assert (preprocessor.push(b).captures, preprocessor.events) == (1, {"dwells": 1, "moved": 0})


def test_a_skipped_stage_is_reported_with_its_reason() -> None:
    capture = replace(captures(plane())[0], amplitude=None)
    preprocessor = Preprocessor()
    view = preprocessor.push(capture)
    assert view.amplitude is None
    assert preprocessor.report.passed == {
        "amplitude": "the captures have no amplitude",
        "iqr": "1 of the 5 captures it needs",
        "sigma3": "1 of the 3 captures it needs",
    }


def test_the_dwell_s_last_colour_image_is_the_view_s() -> None:
    """A robot takes one colour picture a stop; the depth images after it have none within reach."""
    frames = captures(plane(), 3)
    picture = Colour(np.zeros((4, 4, 3), np.uint8))
    (view,) = accumulate_views([frames[0], replace(frames[1], colour=picture), frames[2]], PreprocConfig())
    assert view.colour is picture


def test_captures_are_left_as_they_were() -> None:
    capture = captures(edge_rich(), spikes=0.01)[0]
    before = capture.depth.copy(), capture.reason.copy()
    Preprocessor().push(capture)
    np.testing.assert_array_equal(capture.depth, before[0])
    np.testing.assert_array_equal(capture.reason, before[1])


def test_stages_may_work_on_each_capture_instead() -> None:
    order = "flying,sor,iqr,sigma3,accumulate"
    frames = captures(edge_rich(), 5, spikes=0.01)
    preprocessor = Preprocessor(PreprocConfig(order=order))
    view = [preprocessor.push(f) for f in frames][-1]
    assert preprocessor.counts["flying"] > 5 * 1000  # over five captures
    assert np.count_nonzero(view.reason == Reason.FLYING) > 1000


def test_an_empty_frame_makes_an_empty_view() -> None:
    capture = captures(plane())[0]
    dark = replace(capture, depth=np.full_like(capture.depth, np.nan), reason=np.full_like(capture.reason, Reason.NO_RETURN))
    for preset in ("default", "paper"):
        view = Preprocessor(PreprocConfig(preset=preset)).push(dark)
        assert not view.valid.any()
        assert (view.reason == Reason.NO_RETURN).all()


def test_warm_up_leaves_nothing_to_compile() -> None:
    truth = plane()
    warm_up(truth.camera)
    from tof_preproc import accumulate, neighbours, tiles, windows

    kernels = [accumulate._accumulate, windows.inside, windows.judge, neighbours._dense_there, tiles.outwards]
    known = [len(k.signatures) for k in kernels]
    for f in captures(truth, 6):
        Preprocessor().push(f)
    assert [len(k.signatures) for k in kernels] == known
    assert min(known) > 0
