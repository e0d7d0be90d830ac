# SPDX-License-Identifier: Apache-2.0
"""The graph over DDS: the golden bag gives its golden outputs, the same as offline, and no frame is lost."""

from __future__ import annotations

import json
from collections import Counter
from functools import partialmethod
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from benchmarks.offline import graph_outputs
from tof_core.bag import open_bag
from tof_core.bag_writer import BagWriter
from tof_core.se3 import from_quat
from tof_eval.runs import parts, read_run
from tof_scene.raycast import Raycaster
from toftwin import cli
from toftwin.inputs import opened
from toftwin.pipeline import PipelineConfig

if TYPE_CHECKING:
    from collections.abc import Callable

    from tof_core.bag import RawMessage

GOLDEN = Path(__file__).parents[1] / "data" / "golden"
BAG = str(GOLDEN / "bag")

pytestmark = pytest.mark.dds


@pytest.mark.slow
def test_the_golden_bag_gives_its_golden_outputs(ros_domain: int, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["replay", BAG, "--scene", "body_section", "--against", str(GOLDEN / "outputs")]) == 0
    out = capsys.readouterr().out
    assert "12 frames sent, 12 kept, 0 lost" in out
    assert "the runs agree" in out


@pytest.mark.slow
def test_replay_over_dds_gives_the_numbers_of_the_offline_graph(ros_domain: int, tmp_path: Path) -> None:
    assert cli.main(["replay", BAG, "--scene", "body_section", "--record", str(tmp_path / "run")]) == 0
    recorded = read_run(tmp_path / "run")
    seen: dict[str, int] = {}
    with opened(BAG, Path("body_section"), PipelineConfig()) as (reader, scene):
        assert scene is not None
        for output in graph_outputs(reader, PipelineConfig(), Raycaster(scene)):
            found = parts(recorded.pop((output.stamp_ns, output.topic)))
            if output.topic == "/label/pose":
                pose = from_quat(found["pose"][:3], found["pose"][3:])
                np.testing.assert_allclose(np.concatenate([pose.ravel(), found["covariance"]]), output.values, atol=1e-9)
            elif output.topic.startswith("/preproc") or output.values.dtype.kind != "f":
                np.testing.assert_array_equal(found["pixels"], output.values)
            else:  # sums over arrays that lie elsewhere in memory: a float32's last bit
                np.testing.assert_allclose(found["pixels"], output.values, atol=2e-7)
            seen[output.topic] = seen.get(output.topic, 0) + 1
    assert seen == dict.fromkeys(
        ("/preproc/depth", "/preproc/sigma", "/preproc/count", "/preproc/reason", "/preproc/amplitude"), 12
    ) | dict.fromkeys(("/label/depth", "/label/sigma", "/label/mask", "/label/part", "/label/pose"), 4)
    assert {topic for _, topic in recorded} == {"/preproc/camera_info", "/preproc/dwell", "/label/camera_info"}


@pytest.mark.slow
def test_frames_in_a_gap_of_tf_are_skipped_and_reported(ros_domain: int, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    stamps = frame_stamps(Path(BAG))
    gap = (stamps[5] - 150_000_000, stamps[5] + 150_000_000)
    inside = [s for s in stamps if gap[0] < s < gap[1]]
    copy(Path(BAG), tmp_path / "gap", lambda m: m.topic != "/tf" or not gap[0] < m.stamp_ns < gap[1])
    assert cli.main(["replay", str(tmp_path / "gap"), "--scene", "body_section", "--json"]) == 0
    said = capfd.readouterr()
    facts = json.loads(said.out)
    assert facts["fates"] == {"kept": 12 - len(inside), "no transform": len(inside)}
    assert facts["lost"] == 0
    assert "has a gap of" in said.err


def frame_stamps(bag: Path) -> list[int]:
    with open_bag(bag) as reader:
        return [m.stamp_ns for m in reader.messages((reader.topics.depth,))]


def copy(source: Path, target: Path, keep: Callable[[RawMessage], bool]) -> None:
    """The messages of a bag for which `keep` says so."""
    with open_bag(source) as reader, BagWriter(target) as writer:
        for message in reader.messages():
            if keep(message):
                writer.raw(message.topic, message.type, message.cdr, message.log_ns)


def test_a_missing_output_of_a_running_graph_is_reported_after_a_limited_wait(
    ros_domain: int, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """It hears all and answers frames, and publishes nothing else."""
    import rclpy
    from sensor_msgs.msg import TimeReference

    from tof_ros import qos
    from tof_ros.environment import ros_context
    from tof_ros.interfaces import message_class
    from tof_ros.player import Player

    monkeypatch.setattr(Player, "wait_for_graph", partialmethod(Player.wait_for_graph, timeout_s=5.0))  # discovery on a busy host
    with ros_context(domain=ros_domain) as context, open_bag(Path(BAG)) as reader:
        node = rclpy.create_node("half", context=context)
        node.create_publisher(TimeReference, "preproc/done", qos.OUTPUT)
        for topic, kind in reader.types.items():
            node.create_subscription(message_class(kind), topic, lambda _: None, qos.sensor())
        assert cli.main(["replay", BAG, "--running", "--record", str(tmp_path / "run")]) == 1
        node.destroy_node()
    assert "nobody publishes /preproc/depth after 5 s; is the graph running in this ROS_DOMAIN_ID?" in capsys.readouterr().err


@pytest.mark.parametrize(("flags", "told"), [(["--running"], True), (["--running", "--realtime"], False), ([], False)])
def test_a_replay_faster_than_a_running_graph_gets_advice(
    flags: list[str], *, told: bool, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from tof_ros.player import PlayReport
    from toftwin.commands import replay as command
    from toftwin.replay import ReplayResult

    fates = Counter({"kept": 3, "no transform": 1})
    monkeypatch.setattr(command, "play", lambda *_: ReplayResult(PlayReport(sent=5, fates=fates, lost=1), 0, nodes=("preproc",)))
    assert cli.main(["replay", BAG, *flags]) == int("--realtime" not in flags)
    said = capsys.readouterr()
    assert "5 frames sent, 3 kept, 1 lost; skipped: no transform 1" in said.out
    assert ("--realtime" in said.err) == told
    assert ("MB" in said.out) == ("--running" not in flags)
