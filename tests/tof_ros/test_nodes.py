# SPDX-License-Identifier: Apache-2.0
"""The node `preproc` live, over DDS: what it publishes, how it is changed, what it says about itself."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from tests.tof_ros.preproc_bench import CAMERA, RATE_NS, Bench, wait_for
from tof_core.decode import pixels, stamp_ns
from tof_core.reasons import Reason

pytest.importorskip("rclpy", reason="no ROS 2 here")
if TYPE_CHECKING:
    from collections.abc import Iterator

pytestmark = pytest.mark.dds


@pytest.fixture(scope="module")
def bench(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    import rclpy

    from tof_preproc.node import make_node
    from tof_ros.environment import parameter_overrides, ros_context
    from tof_ros.spin import spinning

    values = {"live.need_tf": False, "live.reliable": True, "live.record": str(tmp_path_factory.mktemp("record"))}
    with ros_context(domain=ros_domain) as context:
        node = make_node(context=context, namespace="spot", parameter_overrides=parameter_overrides(values))
        peer = rclpy.create_node("peer", context=context)
        with spinning([node, peer]):
            yield Bench(node, peer)


def test_each_output_has_the_frames_stamp_and_frame_and_a_camera_info(bench: Bench) -> None:
    stamp = bench.send(0, 0.8)
    out = bench.outputs(stamp)
    assert {m.header.frame_id for name, m in out.items() if name not in ("done", "dwell")} == {"hand_depth_sensor"}
    depth, reason = pixels(out["depth"]), pixels(out["reason"])
    assert (out["depth"].encoding, out["count"].encoding, out["reason"].encoding) == ("32FC1", "16UC1", "8UC1")
    assert depth[12, 16] == np.float32(0.8)
    assert (reason[0, 0], reason[0, 1], reason[12, 16]) == (Reason.NO_RETURN, Reason.SATURATED, Reason.VALID)
    assert np.isnan(depth[0, :2]).all()
    assert (list(out["camera_info"].k), out["camera_info"].width) == (list(CAMERA.K.ravel()), 32)
    assert out["done"].source == "kept"
    assert "captures=1" in out["dwell"].source


def test_a_second_capture_joins_the_dwell_and_reset_ends_it(bench: Bench) -> None:
    first, second = bench.send(1), bench.send(2)
    out = bench.outputs(second)
    assert int(pixels(out["count"])[12, 16]) >= 2
    assert stamp_of(out["dwell"].time_ref) <= first
    assert bench.call("reset").success
    third = bench.send(3)
    assert stamp_of(bench.outputs(third)["dwell"].time_ref) == third


def test_a_frame_that_waits_at_a_reset_has_its_end(bench: Bench) -> None:
    """An image that overtakes the camera_info of its size waits for it."""
    from std_srvs.srv import Trigger

    from tof_ros import messages

    reset = bench.peer.create_client(Trigger, "spot/preproc/reset")
    assert reset.wait_for_service(5.0)
    stamp = 1_000_000_000 + 50 * RATE_NS
    bench._depth.publish(messages.image(np.full((8, 8), 700, np.uint16), "16UC1", messages.header(stamp, CAMERA.frame_id)))
    wait_for(lambda: stamp in bench.node._arrivals)
    assert reset.call(Trigger.Request(), timeout_sec=5.0).success
    wait_for(lambda: [m.source for m in bench.heard["done"] if stamp_ns(m) == stamp] == ["reset"])


def test_parameters_change_live_and_as_a_whole(bench: Bench) -> None:
    from rclpy.parameter import Parameter

    refused = bench.node.set_parameters_atomically([Parameter("preproc.range.low", value=5.0), Parameter("preproc.range.high", value=1.0)])
    assert not refused.successful
    assert bench.node.set_parameters([Parameter("preproc.range.high", value=0.6)])[0].successful
    reason = pixels(bench.outputs(bench.send(4, 0.9))["reason"])
    assert reason[12, 16] == Reason.OUT_OF_RANGE
    assert bench.node.set_parameters([Parameter("preproc.range.high", value=15.0)])[0].successful
    assert pixels(bench.outputs(bench.send(5, 0.9))["reason"])[12, 16] == Reason.VALID
    assert not bench.node.set_parameters([Parameter("live.need_tf", value=True)])[0].successful


def test_a_frozen_frame_is_answered_and_not_accumulated(bench: Bench) -> None:
    stamp = bench.send(6)
    bench.outputs(stamp)
    bench.send(6)
    wait_for(lambda: [m.source for m in bench.heard["done"] if stamp_ns(m) == stamp] == ["kept", "frozen"])
    assert len([m for m in bench.heard["depth"] if stamp_ns(m) == stamp]) == 1


def test_an_uncalibrated_camera_info_is_refused_and_the_node_goes_on(bench: Bench) -> None:
    stamp = bench.send(7, fx=0.0)
    assert bench.outputs(stamp)["camera_info"].k[0] == 30.0


def test_stamps_that_jump_back_begin_afresh(bench: Bench) -> None:
    bench.outputs(bench.send(200))
    back = [bench.send(number) for number in range(20, 26)]
    assert stamp_of(bench.outputs(back[-1])["dwell"].time_ref) >= back[0]
    late = [m.source for m in bench.heard["done"] if stamp_ns(m) in back]
    assert late.count("late") == 3


def test_recordings_hold_what_came_in_byte_for_byte(bench: Bench) -> None:
    from tof_core.bag import open_bag

    answer = bench.call("start_recording")
    assert answer.success
    time.sleep(0.3)
    assert not bench.call("start_recording").success
    stamps = [bench.send(number, 0.7) for number in range(30, 34)]
    bench.outputs(stamps[-1])
    time.sleep(0.3)
    stopped = bench.call("stop_recording")
    assert stopped.success
    with open_bag(answer.message.removeprefix("recording to ")) as reader:
        captures = list(reader.captures(need_tf=False))
    assert [c.stamp_ns for c in captures] == stamps
    assert {float(c.depth[12, 16]) for c in captures} == {float(np.float32(0.7))}


def test_diagnostics_tell_rate_latency_and_fates(bench: Bench) -> None:
    wait_for(lambda: bench.heard["diagnostics"])
    bench.heard["diagnostics"].clear()
    wait_for(lambda: bench.heard["diagnostics"])
    status = bench.heard["diagnostics"][-1].status[0]
    values = {v.key: v.value for v in status.values}
    assert status.name == "spot/preproc"
    assert int(values["seen"]) == int(values["kept"]) + int(values["skipped"])
    assert (values["skipped.frozen"], values["skipped.late"]) == ("1", "3")
    assert 0 < float(values["latency_p50_ms"]) <= float(values["latency_p95_ms"])


def test_the_stages_say_their_order_and_what_they_removed(bench: Bench) -> None:
    from tof_preproc.config import ORDER

    wait_for(lambda: bench.heard["diagnostics"])
    values = {v.key: v.value for v in bench.heard["diagnostics"][-1].status[0].values}
    assert values["stages"] == " ".join(s.strip() for s in ORDER.split(","))
    removed = {key.removeprefix("removed."): int(value) for key, value in values.items() if key.startswith("removed.")}
    assert set(removed) <= set(values["stages"].split())
    assert removed["range"] >= 0


def stamp_of(time_: Any) -> int:
    return int(time_.sec) * 1_000_000_000 + int(time_.nanosec)
