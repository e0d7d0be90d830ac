# SPDX-License-Identifier: Apache-2.0
"""The node `gap` over DDS: residual and figures of each labelled view, and a warning in /diagnostics once the gap grows."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from tests.tof_gap.test_watch import CAMERA, POSE_COV, poses, seen
from tests.tof_ros.peers import Observer, wait_for
from tests.tof_ros.view_source import ViewSource
from tof_core.capture import RobotPose
from tof_core.decode import pixels, stamp_ns
from tof_core.se3 import cov_fixed_axes
from tof_scene.builtin import make_builtin
from tof_scene.raycast import Raycaster

pytest.importorskip("rclpy", reason="no ROS 2 here")

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tof_core.arrays import Float

pytestmark = [pytest.mark.dds, pytest.mark.slow]
BASELINE = 12


class Bench:
    """A `gap` in one thread, the rest of the graph and an observer in another."""

    def __init__(self, node: Any, observer: Observer) -> None:
        from tof_gap.node import OUTPUTS
        from tof_ros import qos

        self.node, self.observer = node, observer
        self.source = ViewSource(observer.node)
        self.caster = Raycaster(make_builtin("body_section"))
        self.rng = np.random.default_rng(7)
        self.heard: dict[str, list[Any]] = {name: [] for name in OUTPUTS}
        for name, kind in OUTPUTS.items():
            observer.node.create_subscription(kind, f"/spot/gap/{name}", self.heard[name].append, qos.OUTPUT)

    def judged(self, wave_m: float = 0.0) -> dict[str, Any]:
        """A view with its label through the node; gives the report."""
        (T,) = poses(1, self.rng)
        view = replace(seen(self.caster, T, self.rng, wave_m), robot=RobotPose(np.eye(4), T), camera=replace(CAMERA, frame_id="hand_depth"))
        sent = self.source.send(replace(view, sigma=np.full(CAMERA.shape, 0.002, np.float32)))
        self.source.label(sent, T, cov_fixed_axes(T, POSE_COV))
        return self.report(sent.stamp_ns)

    def report(self, stamp: int) -> dict[str, Any]:
        """The report of a view, once it came."""

        def found() -> list[dict[str, Any]]:
            return [r for m in self.heard["report"] if (r := json.loads(m.data))["stamp_ns"] == stamp]

        wait_for(found, what=f"for the report; {self.node.tally.skipped} {self.node._refused}")
        return found()[0]


@pytest.fixture(scope="module")
def bench(ros_domain: int) -> Iterator[Bench]:
    from tof_gap.node import make_node
    from tof_ros.environment import parameter_overrides, ros_context
    from tof_ros.spin import spinning

    values = {"live.scene": "body_section", "watch.baseline": BASELINE, "watch.views_per_alarm": 30}
    with ros_context(domain=ros_domain) as context:
        node = make_node(context=context, namespace="spot", parameter_overrides=parameter_overrides(values))
        observer = Observer(context)
        with spinning([node, observer.node]):
            bench = Bench(node, observer)
            wait_for(lambda: node.active and bench.source.matched)
            wait_for(lambda: observer.node.count_subscribers("/spot/label/pose"))
            yield bench


def test_a_labelled_view_gives_its_residual(bench: Bench) -> None:
    told = bench.judged()
    assert (told["schema"], told["state_of_gap"], told["views"]) == ("toftwin.gap.watch/1", "learning", 1)
    (image,) = wait_for(lambda: [m for m in bench.heard["residual"] if stamp_ns(m) == told["stamp_ns"]])
    residual: Float = pixels(image)
    assert residual.shape == CAMERA.shape
    assert np.nanstd(residual) == pytest.approx(0.002, rel=0.2)
    assert abs(np.nanmedian(residual)) < 3e-4


def test_parts_are_coloured_by_their_gap_also_for_a_late_joiner(bench: Bench) -> None:
    from visualization_msgs.msg import MarkerArray

    from tof_ros import qos
    from tof_ros.markers import GREY, SHADES, shade

    bench.judged()
    heard: list[Any] = []
    bench.observer.node.create_subscription(MarkerArray, "/spot/gap/markers", heard.append, qos.LATCHED)
    markers = wait_for(lambda: heard)[-1].markers
    assert [m.text for m in markers] == list(bench.caster.scene.names)
    seen_ = {m.text: (m.color.r, m.color.g, m.color.b) for m in markers if m.color.a > 0.9}
    assert seen_
    usual = [shade(step / SHADES) for step in range(3)]  # up to 1.25 mm of 5
    assert all(any(colour == pytest.approx(shade_) for shade_ in usual) for colour in seen_.values())
    assert {m.color.a > 0.9 or (m.color.r, m.color.g, m.color.b) == pytest.approx(GREY) for m in markers} == {True}


def test_growth_is_a_warning_and_reset_forgets_what_is_usual(bench: Bench) -> None:
    from diagnostic_msgs.msg import DiagnosticStatus

    states = [bench.judged()["state_of_gap"] for _ in range(BASELINE)]
    assert states[-1] == "steady"
    grown = [bench.judged(0.002) for _ in range(6)]
    assert grown[-1]["state_of_gap"] == "grown"
    assert grown[-1]["gap_mm"] > 2 * grown[-1]["usual_mm"]
    warned = bench.observer.status("spot/gap", lambda s: "the gap grows" in s.message)
    assert warned.level == DiagnosticStatus.WARN
    assert bench.observer.trigger("/spot/gap/reset").success
    assert bench.judged()["state_of_gap"] == "learning"
