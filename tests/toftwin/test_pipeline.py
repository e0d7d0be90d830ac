# SPDX-License-Identifier: Apache-2.0
"""The pipeline without ROS: the running views of the stream end as the views of the session."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tof_core.bag import open_bag
from tof_core.errors import UsageError
from tof_preproc.stream import PreprocStream
from tof_preproc.stream_config import StreamConfig
from toftwin.graph import GraphSpec, parse_parameters
from toftwin.options import parse_placement
from toftwin.pipeline import PipelineConfig, ViewStream, with_first_temperature

GOLDEN = Path(__file__).parents[1] / "data" / "golden" / "bag"


def test_the_last_running_view_of_a_dwell_is_the_sessions_view() -> None:
    with open_bag(GOLDEN) as reader:
        offline = list(ViewStream(reader, PipelineConfig()))
        stream, builder = PreprocStream(StreamConfig(), reader.topics, reader.transforms), None
        builder = stream.builder
        takes = {reader.topics.depth: builder.depth, reader.topics.info: builder.info, reader.topics.amplitude: builder.amplitude}
        running = {}
        for message in reader.messages(tuple(takes)):
            takes[message.topic](reader.deserialize(message))
            running.update({p.view.dwell_ns: p.view for p in stream.ready() if p.view is not None})
        running.update({p.view.dwell_ns: p.view for p in stream.ready(final=True) if p.view is not None})
    assert [v.stamp_ns for v in offline] == [v.stamp_ns for v in running.values()]
    assert [v.station for v in offline] == [0, 0, 1, 1]
    for a, b in zip(offline, running.values(), strict=True):
        np.testing.assert_array_equal(a.depth, b.depth)
        np.testing.assert_array_equal(a.sigma, b.sigma)
        np.testing.assert_array_equal(a.reason, b.reason)
        assert (a.captures, a.station) == (b.captures, b.station) == (3, a.station)


def test_views_before_the_thermometers_first_message_take_its_reading_for_a_minute() -> None:
    with open_bag(GOLDEN) as reader:
        view = next(iter(ViewStream(reader, PipelineConfig())))
    read = [(0.0, np.nan), (50.0, np.nan), (100.0, 31.0), (150.0, 33.0), (200.0, np.nan)]
    views = [replace(view, stamp_ns=int(s * 1e9), temperature=t) for s, t in read]
    np.testing.assert_array_equal([v.temperature for v in with_first_temperature(views)], [np.nan, 31.0, 31.0, 33.0, np.nan])
    assert all(np.isnan(v.temperature) for v in with_first_temperature(views[:2]))


def test_each_view_knows_its_captures() -> None:
    with open_bag(GOLDEN) as reader:
        stream = ViewStream(reader, PipelineConfig())
        members = [[c.stamp_ns for c in stream.members] for _ in stream]
        assert [len(m) for m in members] == [3, 3, 3, 3]
        assert sorted(s for m in members for s in m) == [c.stamp_ns for c in reader.captures()]


def test_a_frame_without_tf_is_skipped_with_its_stamp_and_reason() -> None:
    with open_bag(GOLDEN) as reader:
        stream = PreprocStream(StreamConfig(), reader.topics, type(reader.transforms)())
        first = next(reader.messages((reader.topics.depth,)))
        stream.builder.info(reader.deserialize(next(reader.messages((reader.topics.info,)))))
        stream.builder.depth(reader.deserialize(first))
        assert list(stream.ready()) == []
        stream.give_up(first.stamp_ns)
        (lost,) = stream.ready()
    assert (lost.stamp_ns, lost.fate, lost.view) == (first.stamp_ns, "no transform", None)


@pytest.mark.parametrize(("text", "frame", "x"), [("1 2 3 0 0 0 1", "camera", 1.0), ("odom: 4,5,6", "odom", 4.0)])
def test_an_initial_pose_names_its_frame_or_means_the_camera(text: str, frame: str, x: float) -> None:
    placed = parse_placement(text, "camera")
    assert placed is not None
    assert (placed.frame, placed.T_frame_cell[0, 3]) == (frame, x)


@pytest.mark.parametrize("text", ["1 2", "a b c", "1 2 3 nan 0 0 1"])
def test_a_pose_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match="is not 'x y z qx qy qz qw'"):
        parse_placement(text, "camera")


def test_a_graph_is_started_by_a_command_line_that_says_the_same() -> None:
    spec = GraphSpec(
        ("preproc",), {"preproc": {"live.reliable": True, "preproc.range.high": 2.5, "input.depth_topic": "/d"}}, use_sim_time=True
    )
    flags = spec.command()
    assert flags[2:5] == ["toftwin.cli", "node", "preproc"]
    pairs = [flags[i + 1] for i, flag in enumerate(flags) if flag == "--param"]
    assert parse_parameters(pairs, spec.nodes) == spec.parameters


def test_an_unknown_node_is_a_wrong_call() -> None:
    with pytest.raises(UsageError, match="'lable' is no node"):
        GraphSpec(("lable",))


def test_a_frame_waits_for_a_latched_transform_however_far_tf_has_gone() -> None:
    with open_bag(GOLDEN) as reader:
        stream = PreprocStream(StreamConfig(), reader.topics, type(reader.transforms)())
        messages = {topic: [reader.deserialize(m) for m in reader.messages((topic,))] for topic in reader.types}
    stream.builder.info(messages[reader.topics.info][0])
    stream.builder.depth(messages[reader.topics.depth][0])
    stream.builder.amplitude(messages[reader.topics.amplitude][0])
    for moving in messages["/tf"]:
        stream.transforms.add_message(moving)
    assert list(stream.ready()) == []
    for latched in messages["/tf_static"]:
        stream.transforms.add_message(latched, static=True)
    assert [p.fate for p in stream.ready()] == ["kept"]
