# SPDX-License-Identifier: Apache-2.0
"""Content of a recorded session: topics, frames, stamps, and a camera without effects and without bias."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from tests.tof_virtual.made import bench, config
from tof_core import se3
from tof_virtual.pipeline import expose
from tof_virtual.record import record
from tof_virtual.session import Session
from tof_virtual.truth import load_truth

if TYPE_CHECKING:
    from pathlib import Path


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """A bag of four views with three captures each, with everything that can be published, and its truth."""
    bag = tmp_path_factory.mktemp("virtual") / "bag"
    record(
        bench(), bag, config(plan__captures=3, output__encoding="16UC1", output__namespace="spot", output__colour=True, output__points=True)
    )
    return bag, load_truth(bag.with_name("bag.truth"))[0]


def messages(bag: Path) -> dict[str, list[Any]]:
    from rosbags.highlevel import AnyReader

    out: dict[str, list[Any]] = {}
    with AnyReader([bag]) as reader:
        for connection, _, raw in reader.messages():
            out.setdefault(connection.topic, []).append(reader.deserialize(raw, connection.msgtype))
    return out


def test_topics_are_spot_ros2s_in_the_namespace(recorded: tuple[Path, dict[str, Any]]) -> None:
    found = messages(recorded[0])
    assert set(found) == {
        "/tf",
        "/tf_static",
        "/spot/depth/hand/image",
        "/spot/depth/hand/camera_info",
        "/spot/depth/hand/points",
        "/spot/ir/hand/image",
        "/spot/ir/hand/camera_info",
        "/spot/camera/hand/image",
        "/spot/camera/hand/camera_info",
        "/spot/hand/temperature",
    }
    depth = found["/spot/depth/hand/image"]
    assert len(depth) == 12
    assert {(m.encoding, m.header.frame_id, m.width, m.height) for m in depth} == {("16UC1", "spot/hand_depth_sensor", 80, 60)}
    assert found["/spot/ir/hand/image"][0].encoding == "mono16"
    assert found["/spot/camera/hand/image"][0].encoding == "rgb8"
    frames = {t.child_frame_id: t.header.frame_id for m in found["/tf"] + found["/tf_static"] for t in m.transforms}
    assert frames == {
        "spot/body": "cell",
        "spot/arm_link_sh1": "spot/body",
        "spot/arm_link_wr1": "spot/arm_link_sh1",
        "spot/hand": "spot/arm_link_wr1",
        "spot/hand_depth_sensor": "spot/hand",
        "spot/hand_color_image_sensor": "spot/hand",
    }


def test_tf_gives_the_pose_that_the_robot_believes(recorded: tuple[Path, dict[str, Any]]) -> None:
    from tof_core.tf import TransformBuffer

    bag, truth = recorded
    buffer = TransformBuffer()
    for name, sent in messages(bag).items():
        for m in sent if name in ("/tf", "/tf_static") else ():
            for t in m.transforms:
                x, q = t.transform.translation, t.transform.rotation
                stamp = t.header.stamp.sec * 10**9 + t.header.stamp.nanosec
                buffer.add(
                    t.header.frame_id,
                    t.child_frame_id,
                    stamp,
                    se3.from_quat([x.x, x.y, x.z], [q.x, q.y, q.z, q.w]),
                    static=name == "/tf_static",
                )
    for stamp, expected in zip(truth["stamp_ns"], truth["T_robot"], strict=True):
        metres, degrees = se3.distance(buffer.lookup("cell", "spot/hand_depth_sensor", int(stamp)), expected)
        assert metres < 1e-9
        assert degrees < 1e-6


def test_errors_have_the_sizes_stated() -> None:
    session = Session(bench(), config(plan__views=60, plan__stations=12), {})
    base = [se3.distance(stop.T_cell_body, e.B @ stop.T_cell_body) for stop, e in zip(session.stops, session.errors, strict=True)]
    moved = np.array([b[0] for b in base]) * 1e3
    assert 18 < moved.min() <= moved.max() < 55
    assert np.array([b[1] for b in base]).max() < 2.2
    arm = np.array([se3.log(e.A) for e in session.errors])
    assert np.sqrt((arm[:, :3] ** 2).sum(1).mean()) * 1e3 == pytest.approx(1.0, rel=0.35)
    assert np.degrees(np.sqrt((arm[:, 3:] ** 2).sum(1).mean())) == pytest.approx(0.1, rel=0.35)


def test_the_arm_repeats_but_for_its_random_share() -> None:
    from tof_virtual.robot import Robot

    robot = Robot(config().robot, np.random.default_rng(3))
    pose = np.eye(4)
    pose[:3, 3] = 0.6, 0.1, 0.4
    twists = []
    for _ in range(400):
        robot.goto(pose)
        twists.append(se3.log(robot.A))
    spread = np.std(twists, axis=0)
    assert np.linalg.norm(spread[:3]) * 1e3 == pytest.approx(0.25, rel=0.1)
    assert np.degrees(np.linalg.norm(spread[3:])) == pytest.approx(0.025, rel=0.1)


def test_chain_is_base_tf_arm_hand_eye(recorded: tuple[Path, dict[str, Any]]) -> None:
    truth = recorded[1]
    for k in range(4):
        chain = truth["B"][truth["station"][k]] @ truth["T_robot"][k] @ truth["A"][k] @ truth["X"]
        np.testing.assert_allclose(chain, truth["T_cell_camera"][k], atol=1e-12)


def test_a_camera_without_effects_has_no_bias_and_the_photons_noise() -> None:
    session = Session(bench(), config(camera__width=224, camera__height=171), {})
    photons = np.random.default_rng(5)
    shots = np.stack([expose(session.moment(0), (), photons).depth for _ in range(40)])
    true = session.moment(0).sight.z
    error = shots.mean(axis=0) - true
    sigma = shots.std(axis=0, ddof=1)
    valid = np.isfinite(error)
    z = error[valid] / (sigma[valid] / np.sqrt(len(shots)))
    assert abs(np.mean(error[valid])) < 2e-5
    assert np.sqrt(np.mean(z**2)) == pytest.approx(1.0, abs=0.05)
    # the photon law: sigma = c / (4 pi f) sqrt(charge of a tap / 2) / amplitude, read and converter noise added
    amplitude = expose(session.moment(0), ()).amplitude
    sight, c = session.moment(0).sight, session.config.camera
    ambient = 1e3 * c.ambient_ke * session.nominal.soup.albedo[sight.main.face] / 0.5
    step = 1e3 * c.full_well_ke / 2**c.adc_bits
    charge = amplitude / c.contrast + ambient + c.read_noise_e**2 + step**2 / 12
    law = 0.23856 * np.sqrt(charge / 2) / np.maximum(amplitude, 1) / sight.length
    assert np.sqrt(np.mean((sigma[valid] / law[valid]) ** 2)) == pytest.approx(1.0, abs=0.05)
    assert 4e-4 < np.percentile(sigma[valid], 5) < np.percentile(sigma[valid], 95) < 8e-3


def test_equal_seeds_give_equal_bags_and_others_do_not(tmp_path: Path) -> None:
    first = record(bench(), tmp_path / "a", config()).arrays()
    second = record(bench(), tmp_path / "b", config()).arrays()
    other = record(bench(), tmp_path / "c", config(seed=1)).arrays()
    for name in first:
        np.testing.assert_array_equal(first[name], second[name], err_msg=name)
    a, b = messages(tmp_path / "a"), messages(tmp_path / "b")
    for x, y in zip(a["/depth/hand/image"], b["/depth/hand/image"], strict=True):
        np.testing.assert_array_equal(x.data, y.data)
    assert not np.allclose(first["T_cell_camera"], other["T_cell_camera"])


def test_depth_in_the_bag_is_the_true_depth_in_millimetres(recorded: tuple[Path, dict[str, Any]]) -> None:
    bag, truth = recorded
    depth = [np.frombuffer(m.data, "<u2").reshape(60, 80) for m in messages(bag)["/spot/depth/hand/image"]]
    for k in range(4):
        error = depth[3 * k + 2].astype(float) - 1e3 * truth["depth"][k]
        seen = (depth[3 * k + 2] > 0) & np.isfinite(error)
        assert seen.mean() > 0.3
        assert abs(np.median(error[seen])) < 0.2
        assert np.percentile(np.abs(error[seen]), 90) < 9


def test_the_body_stands_still_within_a_station(recorded: tuple[Path, dict[str, Any]]) -> None:
    truth = recorded[1]
    assert list(truth["station"]) == [0, 0, 1, 1]
    poses = [t for m in messages(recorded[0])["/tf"] for t in m.transforms if t.child_frame_id == "spot/body"]
    times = np.array([t.header.stamp.sec * 10**9 + t.header.stamp.nanosec for t in poses])
    x = np.array([t.transform.translation.x for t in poses])
    for s in (0, 1):
        during = (times >= truth["dwell_ns"][truth["station"] == s].min()) & (times <= truth["stamp_ns"][truth["station"] == s].max())
        assert np.ptp(x[during]) == 0
    assert np.diff(times).max() < 30_000_000, "TF comes at 50 Hz"
