# SPDX-License-Identifier: Apache-2.0
"""Transforms: interpolated between samples, refused where there is a gap, never guessed."""

from __future__ import annotations

from types import SimpleNamespace as Message

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tof_core import se3, tf
from tof_core.bounds import MOST_FRAMES
from tof_core.edge import BLOCK
from tof_core.errors import TransformError
from tof_core.tf import TransformBuffer
from tof_core.tf_message import StampedTransform

MS = 1_000_000
A = se3.exp([1.0, 2.0, 3.0, 0.3, -0.2, 0.1])
B = se3.exp([0.5, -1.0, 0.2, -0.4, 0.9, 0.7])
C = se3.exp([0.0, 0.3, 0.0, 0.0, 0.0, 1.5])


def tree() -> TransformBuffer:
    """`odom -> body -> hand` moving, `hand -> camera` static; samples each 100 ms from 0 to 1 s."""
    buffer = TransformBuffer(max_gap_s=0.2)
    for t in range(0, 1001, 100):
        buffer.add("odom", "body", t * MS, se3.interpolate(A, B, t / 1000))
        buffer.add("body", "hand", t * MS, se3.interpolate(B, C, t / 1000))
    buffer.add("hand", "camera", 0, C, static=True)
    return buffer


@pytest.mark.parametrize("ms", [0, 100, 150, 333, 999, 1000])
def test_a_lookup_interpolates_each_edge_at_the_stamp(ms: int) -> None:
    expected = se3.interpolate(A, B, ms / 1000) @ se3.interpolate(B, C, ms / 1000) @ C
    np.testing.assert_allclose(tree().lookup("odom", "camera", ms * MS), expected, atol=1e-12)


def test_a_lookup_goes_up_down_and_across() -> None:
    buffer = tree()
    buffer.add("body", "head", 0, A, static=True)
    head_camera = se3.inverse(A) @ se3.interpolate(B, C, 0.5) @ C
    np.testing.assert_allclose(buffer.lookup("head", "camera", 500 * MS), head_camera, atol=1e-12)
    np.testing.assert_allclose(buffer.lookup("camera", "head", 500 * MS), se3.inverse(head_camera), atol=1e-12)
    np.testing.assert_allclose(buffer.lookup("hand", "hand", 500 * MS), np.eye(4), atol=0)
    assert buffer.chain("head", "camera") == ("head", "body", "hand", "camera")
    assert buffer.chain("camera", "body") == ("camera", "hand", "body")
    assert buffer.chain("body", "camera") == ("body", "hand", "camera")
    assert buffer.chain("/hand", "hand") == ("hand",)
    assert buffer.root("camera") == "odom"


@given(st.permutations(range(6)), st.integers(0, 500))
def test_the_order_of_arrival_does_not_count(order: list[int], ms: int) -> None:
    poses = [se3.exp([0.1 * i, 0, 0, 0, 0, 0.1 * i]) for i in range(6)]
    ordered, shuffled = TransformBuffer(), TransformBuffer()
    for i in range(6):
        ordered.add("a", "b", i * 100 * MS, poses[i])
        shuffled.add("a", "b", order[i] * 100 * MS, poses[order[i]])
    np.testing.assert_array_equal(shuffled.lookup("a", "b", ms * MS), ordered.lookup("a", "b", ms * MS))


def test_the_same_stamp_again_replaces() -> None:
    buffer = TransformBuffer()
    buffer.add("a", "b", 5, A)
    buffer.add("a", "b", 5, B)
    np.testing.assert_allclose(buffer.lookup("a", "b", 5), B, atol=1e-12)


@pytest.mark.parametrize(
    ("ms", "message"),
    [
        (-1, "transform odom -> body: starts 1 ms after the stamp"),
        (1001, "transform odom -> body: ends 1 ms before the stamp"),
    ],
)
def test_nothing_is_extrapolated(ms: int, message: str) -> None:
    with pytest.raises(TransformError, match=message):
        tree().lookup("odom", "body", ms * MS)


def test_a_gap_is_refused_but_its_ends_are_not() -> None:
    buffer = TransformBuffer(max_gap_s=0.2)
    for ms in (0, 100, 301, 400):
        buffer.add("a", "b", ms * MS, A)
    for ms in (0, 50, 100, 301, 350):
        buffer.lookup("a", "b", ms * MS)
    with pytest.raises(TransformError, match=r"has a gap of 201 ms at the stamp 200000000 \(allowed: 200 ms\)"):
        buffer.lookup("a", "b", 200 * MS)


def test_unknown_and_unconnected_frames_name_what_there_is() -> None:
    buffer = tree()
    buffer.add("cell", "fixture", 0, A, static=True)
    with pytest.raises(
        TransformError, match=r"no transform connects 'camera' to 'cell'; TF has the frames: body, camera, cell, fixture, hand, odom$"
    ):
        buffer.lookup("cell", "camera", 0)
    with pytest.raises(TransformError, match="no transform connects 'ghost' to 'odom'"):
        buffer.lookup("odom", "ghost", 0)
    assert buffer.connected("odom", "camera")
    assert not buffer.connected("cell", "camera")


def test_a_frame_with_two_parents_is_refused_where_it_matters() -> None:
    buffer = tree()
    buffer.add("vision", "body", 0, A)
    with pytest.raises(TransformError, match="frame 'body' has two parents, 'odom' and 'vision'"):
        buffer.lookup("odom", "camera", 0)
    np.testing.assert_allclose(buffer.lookup("hand", "camera", 0), C, atol=1e-12)


def test_frames_in_a_circle_are_refused() -> None:
    buffer = TransformBuffer()
    buffer.add("a", "b", 0, A, static=True)
    buffer.add("b", "a", 0, B, static=True)
    with pytest.raises(TransformError, match="circle"):
        buffer.lookup("a", "b", 0)


def test_a_live_buffer_keeps_history_for_the_stated_time() -> None:
    buffer = TransformBuffer(keep_s=1.0)
    for i in range(10_000):
        buffer.add("a", "b", i * 10 * MS, A)
    assert 100 <= len(buffer._edges["b"]) <= 100 + BLOCK
    buffer.lookup("a", "b", 9_999 * 10 * MS - 900 * MS)
    with pytest.raises(TransformError, match="starts"):
        buffer.lookup("a", "b", 0)


def test_a_full_tree_names_its_limit_and_some_frames() -> None:
    buffer = TransformBuffer()
    for i in range(MOST_FRAMES):
        buffer.add("cell", f"frame{i}", 0, A, static=True)
    with pytest.raises(TransformError, match=f"has more than {MOST_FRAMES} frames"):
        buffer.add("cell", "one", 0, A)
    with pytest.raises(TransformError, match=r"no edge of a tree") as error:
        buffer.add("cell", "x" * 300, 0, A)
    assert len(str(error.value)) < 200
    with pytest.raises(TransformError, match="and 9971 more") as error:
        buffer.lookup("cell", "elsewhere", 0)
    assert len(str(error.value)) < 600


def test_a_clock_set_back_forgets_what_moved() -> None:
    buffer = tree()
    assert buffer.settled("odom", "camera", 500 * MS)
    buffer.clear_dynamic()
    assert buffer.frames() == ("camera", "hand")
    buffer.add("odom", "hand", 0, A)
    assert not buffer.settled("odom", "camera", 500 * MS)


def test_a_stray_stamp_or_another_robots_clock_does_not_advance_time() -> None:
    hour = 3_600_000 * MS
    buffer = TransformBuffer(keep_s=1.0)
    for i in range(300):
        buffer.add("a", "b", i * 10 * MS, A)
        buffer.add("a", "other", hour + i * 10 * MS, A)
    buffer.add("a", "b", hour, A)
    for i in range(300, 600):
        buffer.add("a", "b", i * 10 * MS, A)
        assert not buffer.settled("a", "b", i * 10 * MS + MS)
        buffer.lookup("a", "b", i * 10 * MS - 500 * MS)
    assert buffer.settled("a", "b", 5_000 * MS)


def message(q: tuple[float, float, float, float], x: float = 1.0) -> Message:
    stamp = Message(sec=1, nanosec=5)
    transform = Message(translation=Message(x=x, y=2.0, z=3.0), rotation=Message(**dict(zip("xyzw", q, strict=True))))
    return Message(
        transforms=[Message(header=Message(frame_id="/spot/odom", stamp=stamp), child_frame_id="spot/body", transform=transform)]
    )


def test_messages_are_read_with_leading_slashes_dropped_and_quaternions_normalised() -> None:
    buffer = TransformBuffer()
    buffer.add_message(message((0.0, 0.0, 0.0, 0.995)))
    T = np.eye(4)
    T[:3, 3] = 1, 2, 3
    np.testing.assert_allclose(buffer.lookup("spot/odom", "/spot/body", 1_000_000_005), T, atol=1e-15)


@pytest.mark.parametrize("msg", [message((0.0, 0.0, 0.0, 0.0)), message((0.0, 0.0, 0.0, 1.0), float("nan"))])
def test_a_message_that_is_no_rigid_motion_is_refused_by_name(msg: Message) -> None:
    with pytest.raises(TransformError, match="/spot/odom -> spot/body"):
        TransformBuffer().add_message(msg)


def test_interpolation_takes_the_shorter_way_round() -> None:
    buffer = TransformBuffer()
    buffer.add("a", "b", 0, se3.exp([0, 0, 0, 0, 0, np.radians(170)]))
    buffer.add("a", "b", 100 * MS, se3.exp([0, 0, 0, 0, 0, np.radians(-170)]))
    for ms, degrees in ((25, 175), (50, 180), (75, -175)):
        np.testing.assert_allclose(buffer.lookup("a", "b", ms * MS), se3.exp([0, 0, 0, 0, 0, np.radians(degrees)]), atol=1e-12)


def test_cached_paths_follow_added_and_removed_frames() -> None:
    buffer = tree()
    assert buffer.chain("odom", "camera") == ("odom", "body", "hand", "camera")
    assert not buffer.connected("cell", "camera")
    assert "cell" not in buffer.frames()
    buffer.add("cell", "odom", 0, A, static=True)
    assert buffer.chain("cell", "camera") == ("cell", "odom", "body", "hand", "camera")
    assert "cell" in buffer.frames()
    buffer.add("elsewhere", "body", 500 * MS, A)
    with pytest.raises(TransformError, match="two parents"):
        buffer.lookup("cell", "camera", 500 * MS)
    buffer.clear_dynamic()
    assert buffer.frames() == ("camera", "cell", "hand", "odom")
    assert not buffer.connected("cell", "camera")


@pytest.mark.parametrize(("target", "stamp"), [("odom", 500), ("odom", 1500), ("odom", -1), ("nowhere", 500)])
def test_a_check_raises_what_a_lookup_raises(target: str, stamp: int) -> None:
    buffer = tree()
    said = []
    for ask in (buffer.lookup, buffer.check):
        try:
            ask(target, "camera", stamp * MS)
        except TransformError as error:
            said.append(str(error))
    assert len(set(said)) == (0 if (target, stamp) == ("odom", 500) else 1)
    assert len(said) in (0, 2)


def test_of_a_quaternion_the_direction_counts_and_not_the_length() -> None:
    """A quarter turn about z, one per cent too short or too long, moves what hangs below it by exactly its length."""
    for length in (0.991, 1.009):
        buffer = TransformBuffer()
        buffer.put(StampedTransform("a", "b", 0, (0.0, 0.0, 0.0, 0.0, 0.0, length * np.sqrt(0.5), length * np.sqrt(0.5))), static=True)
        buffer.put(StampedTransform("b", "c", 0, (1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0)), static=True)
        np.testing.assert_allclose(buffer.lookup("a", "c", 0)[:3, 3], [0, 1, 0], atol=1e-12)


@pytest.mark.parametrize("length", [0.98, 1.02])
def test_a_quaternion_two_per_cent_off_is_no_rotation(length: float) -> None:
    with pytest.raises(TransformError, match="no rigid motion"):
        TransformBuffer().put(StampedTransform("a", "b", 0, (0.0, 0.0, 0.0, 0.0, length, 0.0, 0.0)))


def test_a_buffer_without_a_limit_keeps_all_history() -> None:
    buffer = TransformBuffer()
    for i in range(3 * BLOCK):
        buffer.add("a", "b", i * MS, A)
    np.testing.assert_allclose(buffer.lookup("a", "b", 0), A, atol=1e-12)


def test_a_full_live_tree_forgets_the_moving_frame_heard_of_longest_ago(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tf, "MOST_FRAMES", 3)
    buffer = TransformBuffer(keep_s=1.0)
    buffer.add("cell", "fixture", 0, A, static=True)
    for child, ms in (("one", 0), ("two", 1), ("one", 2), ("three", 3)):
        buffer.add("cell", child, ms * MS, A)
    assert buffer.frames() == ("cell", "fixture", "one", "three")


def test_a_live_tree_full_of_static_frames_takes_no_more(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tf, "MOST_FRAMES", 2)
    buffer = TransformBuffer(keep_s=1.0)
    for child in ("one", "two"):
        buffer.add("cell", child, 0, A, static=True)
    with pytest.raises(TransformError, match="has more than 2 frames"):
        buffer.add("cell", "three", 0, A)


def test_what_does_not_move_has_no_newest_stamp() -> None:
    buffer = tree()
    assert buffer.latest("hand", "camera") == 0
    assert buffer.latest("odom", "camera") == 1000 * MS
    buffer.add("body", "hand", 1100 * MS, C)
    assert buffer.latest("odom", "camera") == 1000 * MS, "the edge that was heard of longest ago"


def test_changes_count_what_was_recorded() -> None:
    buffer = TransformBuffer()
    counts = [buffer.changes]
    for parent, ms in (("a", 0), ("a", 1), ("other", 2)):
        buffer.add(parent, "b", ms * MS, A)
        counts.append(buffer.changes)
    buffer.clear_dynamic()
    assert [*counts, buffer.changes] == [0, 1, 2, 3, 4]
