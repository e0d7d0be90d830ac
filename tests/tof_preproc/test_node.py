# SPDX-License-Identifier: Apache-2.0
"""The node `preproc` live with the last view of each dwell alone: what it publishes, and what becomes of the other frames."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from tests.tof_ros.preproc_bench import Bench, wait_for
from tof_core.decode import stamp_ns

pytest.importorskip("rclpy", reason="no ROS 2 here")
if TYPE_CHECKING:
    from collections.abc import Iterator

pytestmark = pytest.mark.dds


@pytest.fixture(scope="module")
def bench(ros_domain: int) -> Iterator[Bench]:
    import rclpy

    from tof_preproc.node import make_node
    from tof_ros.environment import parameter_overrides, ros_context
    from tof_ros.spin import spinning

    values = {
        "live.need_tf": False,
        "live.reliable": True,
        "live.view_every": 0,
        "preproc.accumulate.max_captures": 3,
        "preproc.motion.max_gap_s": 0.6,
    }
    with ros_context(domain=ros_domain) as context:
        node = make_node(context=context, namespace="spot", parameter_overrides=parameter_overrides(values))
        peer = rclpy.create_node("peer", context=context)
        with spinning([node, peer]):
            yield Bench(node, peer)


def fate(bench: Bench, stamp: int) -> str:
    wait_for(lambda: any(stamp_ns(m) == stamp for m in bench.heard["done"]))
    return next(str(m.source) for m in bench.heard["done"] if stamp_ns(m) == stamp)


def test_a_full_dwell_has_one_view_and_every_frame_a_fate(bench: Bench) -> None:
    stamps = [bench.send(number) for number in range(3)]
    assert "captures=3" in bench.outputs(stamps[2])["dwell"].source
    assert [fate(bench, stamp) for stamp in stamps] == ["accumulated", "accumulated", "kept"]
    assert [stamp_ns(m) for m in bench.heard["depth"]] == [stamps[2]]


def test_the_last_view_before_a_pause_comes_without_another_frame(bench: Bench) -> None:
    stamps = [bench.send(number) for number in (3, 4)]
    assert "captures=2" in bench.outputs(stamps[1])["dwell"].source
    assert [fate(bench, stamp) for stamp in stamps] == ["accumulated", "kept"]


def test_a_dwell_that_is_ended_by_service_gives_its_view(bench: Bench) -> None:
    stamp = bench.send(20)
    wait_for(lambda: bench.node._stream.held_ns == stamp)
    assert bench.call("capture").success
    assert "captures=1" in bench.outputs(stamp)["dwell"].source


def test_the_last_message_of_each_dwell_says_that_it_has_ended(bench: Bench) -> None:
    pytest.importorskip("toftwin_msgs", reason="the typed messages are not built")
    said = [(m.captures, m.ended) for m in bench.heard["dwell_info"]]
    # Full; before a pause, which may go on; the same once another dwell has begun; ended by service.
    assert said == [(3, True), (2, False), (2, True), (1, True)]
    pause = bench.heard["dwell_info"][1:3]
    assert stamp_ns(pause[0]) == stamp_ns(pause[1])


def test_a_held_frame_has_its_end_at_a_reset(bench: Bench) -> None:
    stamp = bench.send(40)
    wait_for(lambda: bench.node._stream.held_ns == stamp)
    assert bench.call("reset").success
    assert fate(bench, stamp) == "reset"


def test_diagnostics_count_the_frames_without_a_view_of_their_own(bench: Bench) -> None:
    bench.heard["diagnostics"].clear()
    wait_for(lambda: bench.heard["diagnostics"])
    values = {v.key: v.value for v in bench.heard["diagnostics"][-1].status[0].values}
    assert (values["seen"], values["kept"], values["accumulated"], values["skipped.reset"]) == ("7", "3", "3", "1")
