# SPDX-License-Identifier: Apache-2.0
"""Bags from the project's writer are read back unchanged: frames in order of stamps, joined, with poses."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import pytest

from tests.tof_core import bags
from tests.tof_core.bags import CAMERA, FRAME, SECOND, START, T_BODY_CAMERA, Session, body_at, depth_of, stamp
from tof_core import se3
from tof_core.bag import BagOptions, Placement, open_bag
from tof_core.bag_writer import BagWriter
from tof_core.encode import depth_counts, image_fields
from tof_core.errors import CameraError, DecodeError, TopicError, TransformError
from tof_core.reasons import Reason

if TYPE_CHECKING:
    from pathlib import Path

    from tof_core.capture import Capture


def read(path: Path, options: BagOptions | None = None, **more: Any) -> list[Capture]:
    with open_bag(path, options, cell_frame="cell", **more) as reader:
        return list(reader.captures())


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
@pytest.mark.parametrize("distro", ["jazzy", "humble"])
@pytest.mark.parametrize("encoding", ["16UC1", "32FC1"])
def test_what_was_written_is_read(
    tmp_path: Path, storage: Literal["mcap", "sqlite3"], distro: Literal["jazzy", "humble"], encoding: str
) -> None:
    path = bags.write(tmp_path / "bag", Session(storage=storage, distro=distro, encoding=encoding))
    captures = read(path)
    assert [c.stamp_ns for c in captures] == [stamp(i) for i in range(6)]
    for i, c in enumerate(captures):
        assert c.camera == CAMERA
        np.testing.assert_allclose(c.depth, depth_of(i), atol=5.1e-4 if encoding == "16UC1" else 0)
        np.testing.assert_array_equal(c.reason, np.where(np.isnan(depth_of(i)), Reason.NO_RETURN, Reason.VALID))
        assert c.amplitude is not None
        np.testing.assert_array_equal(c.amplitude, 100 + i)
        assert c.temperature == 30.0 + i


def test_the_robot_s_pose_is_interpolated_at_the_stamp(tmp_path: Path) -> None:
    for c in read(bags.write(tmp_path / "bag")):
        assert c.robot is not None
        metres, degrees = se3.distance(c.robot.T_cell_body, body_at(c.stamp_ns))
        assert metres < 1e-5
        assert degrees < 1e-5
        np.testing.assert_allclose(c.robot.T_body_camera, T_BODY_CAMERA, atol=1e-12)


def test_a_cloud_gives_the_captures_of_the_image_it_was_made_of(tmp_path: Path) -> None:
    image = read(bags.write(tmp_path / "image", Session(encoding="32FC1")))
    cloud = read(bags.write(tmp_path / "cloud", Session(points=True)))
    assert len(image) == len(cloud) == 6
    for a, b in zip(image, cloud, strict=True):
        np.testing.assert_allclose(b.depth, a.depth, atol=1e-6)
        np.testing.assert_array_equal(b.reason, a.reason)
        assert b.camera == a.camera


def test_frames_recorded_out_of_order_come_by_their_stamps(tmp_path: Path) -> None:
    s = Session()
    with BagWriter(tmp_path / "bag") as bag:
        bags.write_tf(bag, s)
        log = [3, 0, 5, 1, 4, 2]
        for n, i in enumerate(log):
            bag.camera_info("/depth/hand/camera_info", CAMERA, stamp(i))
            message = bag._new(
                "sensor_msgs/msg/Image", header=bag._header(stamp(i), CAMERA.frame_id), **image_fields(depth_counts(depth_of(i)), "16UC1")
            )
            bag.raw(
                "/depth/hand/image", "sensor_msgs/msg/Image", bytes(bag._types.serialize_cdr(message, "sensor_msgs/msg/Image")), START + n
            )
    assert [c.stamp_ns for c in read(tmp_path / "bag")] == [stamp(i) for i in range(6)]


def test_a_static_transform_at_the_end_holds_from_the_start(tmp_path: Path) -> None:
    s = Session()
    with BagWriter(tmp_path / "bag") as bag:
        for i in range(3):
            bags.write_frame(bag, s, i)
        for t in np.arange(-0.2, 1.0, 0.02):
            bag.tf(START + round(t * SECOND), [("cell", "spot/body", body_at(START + round(t * SECOND)))])
        bag.tf(START + 5 * SECOND, [("spot/body", "spot/hand_depth_sensor", T_BODY_CAMERA)], static=True)
    assert len(read(tmp_path / "bag")) == 3


def test_frames_without_tf_are_skipped_counted_and_explained(tmp_path: Path) -> None:
    path = bags.write(tmp_path / "bag", Session(frames=12, tf_gap=(0.15, 0.45)))
    with open_bag(path, cell_frame="cell") as reader:
        seen = [c.stamp_ns for c in reader.captures()]
        inside = [stamp(i) for i in range(12) if 0.14 <= (stamp(i) - START) / SECOND < 0.46]
        assert seen == [stamp(i) for i in range(12) if stamp(i) not in inside]
        assert reader.skipped == {"no transform": len(inside)}
        assert "transform cell -> spot/body: has a gap of 320 ms" in reader.last_error
        assert len(list(reader.captures(need_tf=False))) == 12


def test_a_wider_gap_may_be_allowed(tmp_path: Path) -> None:
    path = bags.write(tmp_path / "bag", Session(frames=12, tf_gap=(0.15, 0.45)))
    assert len(read(path, BagOptions(max_gap_s=0.4))) == 12


def test_a_bag_without_the_cell_is_refused_at_once(tmp_path: Path) -> None:
    path = bags.write(tmp_path / "bag", Session(root="odom"))
    with pytest.raises(
        TransformError, match=r"TF does not have the cell frame 'cell'; pass --initial-pose .* or --cell-frame \(TF has odom, spot/body"
    ):
        read(path)


def test_a_placed_cell_is_used(tmp_path: Path) -> None:
    path = bags.write(tmp_path / "bag", Session(root="odom"))
    T_odom_cell = se3.exp([1.0, 2.0, 0.0, 0.0, 0.0, 0.7])
    for c in read(path, placed=Placement("odom", T_odom_cell)):
        assert c.robot is not None
        np.testing.assert_allclose(c.robot.T_cell_body, se3.inverse(T_odom_cell) @ body_at(c.stamp_ns), atol=1e-5)


def test_frozen_frames_are_one(tmp_path: Path) -> None:
    s = Session(amplitude=False)
    with BagWriter(tmp_path / "bag") as bag:
        bags.write_tf(bag, s)
        for i in range(4):
            bags.write_frame(bag, s, i)
            if i in (1, 2):
                bags.write_frame(bag, s, i)
        bag.image("/spot/depth/hand/image", depth_counts(depth_of(3)), "16UC1", CAMERA.frame_id, stamp(4))
    with open_bag(tmp_path / "bag", cell_frame="cell") as reader:
        assert [c.stamp_ns for c in reader.captures()] == [stamp(i) for i in range(4)]
        assert reader.skipped == {"frozen": 3}


def test_radial_depth_becomes_z(tmp_path: Path) -> None:
    path = bags.write(tmp_path / "bag", Session(encoding="32FC1"))
    for i, c in enumerate(read(path, BagOptions(depth="radial"))):
        np.testing.assert_allclose(c.depth, depth_of(i) / CAMERA.ray_length(), rtol=1e-6)


def test_another_scale_of_counts(tmp_path: Path) -> None:
    path = bags.write(tmp_path / "bag")
    np.testing.assert_allclose(read(path, BagOptions(depth_scale=1 / 999))[2].depth, np.rint(depth_of(2) * 1e3) / 999, rtol=1e-6)


def test_amplitude_a_little_off_in_time_is_joined_and_a_lot_is_not(tmp_path: Path) -> None:
    s = Session(amplitude=False)
    with BagWriter(tmp_path / "bag") as bag:
        bags.write_tf(bag, s)
        for i in range(4):
            bags.write_frame(bag, s, i)
            late = 10_000_000 if i < 2 else 25_000_000
            bag.image("/spot/ir/hand/image", np.full(CAMERA.shape, i, np.uint8), "mono8", CAMERA.frame_id, stamp(i) + late)
    amplitudes = [c.amplitude for c in read(tmp_path / "bag")]
    assert [a is not None and float(a[0, 0]) for a in amplitudes] == [0.0, 1.0, False, False]


def test_colour_comes_with_its_camera_and_its_place(tmp_path: Path) -> None:
    s, colour = Session(), replace(CAMERA, width=10, height=8, frame_id="spot/rgb")
    T = se3.exp([0.02, 0.0, 0.01, 0.0, 0.1, 0.0])
    with BagWriter(tmp_path / "bag") as bag:
        bags.write_tf(bag, s)
        bag.tf(START, [("spot/hand_depth_sensor", "spot/rgb", T)], static=True)
        for i in range(3):
            bags.write_frame(bag, s, i)
            bag.camera_info("/spot/camera/hand/camera_info", colour, stamp(i) + 5_000_000)
            bag.image("/spot/camera/hand/image", np.full((8, 10, 3), [1, 2, 30 + i], np.uint8), "bgr8", "spot/rgb", stamp(i) + 5_000_000)
    first = read(tmp_path / "bag")[0].colour
    assert first is not None
    np.testing.assert_array_equal(first.image, np.broadcast_to(np.array([30, 2, 1], np.uint8), (8, 10, 3)))
    assert first.camera == colour
    assert first.stamp_ns == stamp(0) + 5_000_000
    assert first.T_camera_colour is not None
    np.testing.assert_allclose(first.T_camera_colour, T, atol=1e-12)


def test_a_temperature_holds_until_the_next(tmp_path: Path) -> None:
    s = Session(temperature=False)
    with BagWriter(tmp_path / "bag") as bag:
        bags.write_tf(bag, s)
        for i in range(5):
            bags.write_frame(bag, s, i)
        bag.temperature("/spot/hand/temperature", 41.0, stamp(1) + 1)
        bag.temperature("/spot/hand/temperature", 42.0, stamp(3))
    np.testing.assert_array_equal([c.temperature for c in read(tmp_path / "bag")], [np.nan, np.nan, 41.0, 42.0, 42.0])


def test_messages_for_replay_come_by_stamp_with_latched_ones_first(tmp_path: Path) -> None:
    path = bags.write(tmp_path / "bag")
    with open_bag(path, cell_frame="cell") as reader:
        messages = list(reader.messages())
        assert [m.topic for m in messages].index("/tf_static") == 0
        assert len(messages) == 1 + 60 + 4 * 6
        stamps = [m.stamp_ns for m in messages if m.topic != "/tf_static"]
        assert stamps == sorted(stamps)
        depth = next(m for m in messages if m.topic == "/spot/depth/hand/image")
        assert depth.type == "sensor_msgs/msg/Image"
        assert reader.deserialize(depth).encoding == "16UC1"
        from rosbags.interfaces import QosDurability

        assert messages[0].qos[0].durability == QosDurability.TRANSIENT_LOCAL


def test_raw_messages_copied_to_another_bag_are_the_same_bag(tmp_path: Path) -> None:
    path = bags.write(tmp_path / "bag")
    with open_bag(path, cell_frame="cell") as reader, BagWriter(tmp_path / "copy", "sqlite3") as copy:
        for m in reader.messages():
            copy.raw(m.topic, m.type, m.cdr, m.log_ns)
    for a, b in zip(read(path), read(tmp_path / "copy"), strict=True):
        np.testing.assert_array_equal(a.depth, b.depth)
        assert a.robot is not None
        assert b.robot is not None
        np.testing.assert_array_equal(a.robot.T_cell_camera, b.robot.T_cell_camera)


def test_bytes_of_another_machine_are_decoded_right(tmp_path: Path) -> None:
    s = Session()
    with BagWriter(tmp_path / "bag") as bag:
        bags.write_tf(bag, s)
        bag.camera_info("/spot/depth/hand/camera_info", CAMERA, stamp(0))
        fields = image_fields(depth_counts(depth_of(0)), "16UC1", step=130, bigendian=True)
        bag._message("/spot/depth/hand/image", "sensor_msgs/msg/Image", stamp(0), header=bag._header(stamp(0), CAMERA.frame_id), **fields)
    np.testing.assert_allclose(read(tmp_path / "bag")[0].depth, depth_of(0), atol=5.1e-4)


def write_one(path: Path, array: np.ndarray[Any, Any], encoding: str, **info: Any) -> Path:
    s = Session()
    with BagWriter(path) as bag:
        bags.write_tf(bag, s)
        roi = bag._new("sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
        from tof_core.encode import camera_info_fields

        fields = {**camera_info_fields(CAMERA), **info}
        bag._message(
            "/depth/hand/camera_info",
            "sensor_msgs/msg/CameraInfo",
            stamp(0),
            header=bag._header(stamp(0), CAMERA.frame_id),
            roi=roi,
            **fields,
        )
        bag.image("/depth/hand/image", array, encoding, CAMERA.frame_id, stamp(0))
    return path


def test_an_image_of_another_size_than_its_camera_info_is_refused(tmp_path: Path) -> None:
    with pytest.raises(CameraError, match="/depth/hand/image: image is 20x10 but its camera_info says 48x36"):
        read(write_one(tmp_path / "bag", np.ones((10, 20), np.uint16), "16UC1"))


def test_an_uncalibrated_camera_is_refused(tmp_path: Path) -> None:
    with pytest.raises(CameraError, match=r"/depth/hand/camera_info: is uncalibrated \(K\[0\] = 0"):
        read(write_one(tmp_path / "bag", np.ones(CAMERA.shape, np.uint16), "16UC1", k=np.zeros(9)))


def test_a_depth_topic_that_holds_no_depth_is_refused(tmp_path: Path) -> None:
    path = write_one(tmp_path / "bag", np.ones((*CAMERA.shape, 3), np.uint8), "rgb8")
    with pytest.raises(DecodeError, match="/depth/hand/image: encoding 'rgb8' holds no depth"):
        read(path, BagOptions(depth_topic="/depth/hand/image"))


def test_a_bag_without_camera_info_is_refused(tmp_path: Path) -> None:
    with pytest.raises(TopicError, match="has no CameraInfo beside '/spot/depth/hand/image'"):
        read(bags.write(tmp_path / "bag", Session(info=False)))


def test_simulated_time_does_not_need_the_recorder_s_clock(tmp_path: Path) -> None:
    source = bags.write(tmp_path / "bag")
    wall = 1_800_000_000 * SECOND
    with open_bag(source) as reader, BagWriter(tmp_path / "sim") as sim:
        for n, m in enumerate(reader.messages()):
            sim.raw(m.topic, m.type, m.cdr, wall + n * FRAME)
    assert [c.stamp_ns for c in read(tmp_path / "sim")] == [stamp(i) for i in range(6)]
