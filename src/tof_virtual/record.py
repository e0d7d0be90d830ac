# SPDX-License-Identifier: Apache-2.0
"""Record a session of the virtual robot to a bag, and its truth to files beside the bag."""

from __future__ import annotations

from heapq import merge
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np

from tof_core.bag_writer import BagWriter
from tof_core.encode import depth_counts
from tof_core.progress import progress
from tof_virtual.calibrate import calibrate
from tof_virtual.colour import colour_camera, photograph
from tof_virtual.pipeline import expose
from tof_virtual.robot import HAND_OF_CAMERA, HAND_OF_COLOUR, WRIST_OF_HAND, arm_links
from tof_virtual.session import Session, frame, topic
from tof_virtual.truth import Truth

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from tof_core.arrays import Bytes, Float, Image
    from tof_virtual.body import Body
    from tof_virtual.config import VirtualConfig
    from tof_virtual.effect import Frame, Moment

AMPLITUDE_STEP_E = 16.0
"""Electrons of one count of the amplitude image."""


Sensor: TypeAlias = "Callable[[Moment, Frame], Frame]"
"""Further processing of a frame, given from outside this room."""


class Event(NamedTuple):
    """A message to write: seconds from the start, rank at equal times, and the function that writes it."""

    time_s: float
    order: int
    write: Callable[[BagWriter], None]


def record(
    bodies: Sequence[Body],
    out_bag: Path | str,
    config: VirtualConfig,
    *,
    effects: Mapping[str, float] | None = None,
    truth_path: Path | str | None = None,
    sensor: Sensor | None = None,
) -> Truth:
    """Record a session.

    Args:
        bodies: the bodies in the cell.
        out_bag: folder of the bag; it must not exist.
        config: camera, robot, plan, output.
        effects: strengths by name; none is a camera with photon noise alone.
        truth_path: stem of the truth's `.npz` and `.json`; `<bag>.truth` beside the bag if None.
        sensor: a foreign sensor model, applied to each frame after the effects; it is not in the truth's maps.
    """
    session = Session(bodies, config, effects or {})
    calibrate(session)
    return record_session(session, out_bag, truth_path=truth_path, sensor=sensor)


def record_session(
    session: Session,
    out_bag: Path | str,
    *,
    truth_path: Path | str | None = None,
    sensor: Sensor | None = None,
) -> Truth:
    """Record a session whose effects have their sizes; arguments as of `record`."""
    truth = Truth(session)
    out = session.config.output
    with BagWriter(out_bag, storage=out.storage, distro="jazzy") as bag:  # type: ignore[arg-type]
        static_transforms(bag, session)
        events = merge(transforms(session), temperatures(session), _captures(session, truth, sensor), key=lambda e: (e.time_s, e.order))
        for event in events:
            event.write(bag)
    path = Path(truth_path) if truth_path else Path(out_bag).with_name(Path(out_bag).name + ".truth")
    truth.save(path)
    return truth


def stamp_ns(session: Session, time_s: float) -> int:
    """ROS time of a moment of the session."""
    return session.config.output.start_s * 1_000_000_000 + round(time_s * 1e9)


def encode_depth(depth: Float, saturated: NDArray[np.bool_], shape: tuple[int, int], encoding: str) -> NDArray[np.uint16] | Image:
    """Depth (P,) as it is published: 16UC1 millimetres (0 nothing, 65535 saturated) or 32FC1 metres (NaN, inf)."""
    metres = np.where(saturated, np.inf, depth).astype(np.float32).reshape(shape)
    return depth_counts(metres) if encoding == "16UC1" else metres


def encode_amplitude(amplitude: Float, shape: tuple[int, int]) -> NDArray[np.uint16]:
    """Amplitude (P,) in electrons as mono16 counts."""
    return np.clip(np.rint(amplitude / AMPLITUDE_STEP_E), 0, 65535).astype(np.uint16).reshape(shape)


def static_transforms(bag: BagWriter, session: Session) -> None:
    """Write where the camera is on the hand, and the hand on the wrist."""
    c = session.config
    hand = frame(c, "hand")
    edges = [(frame(c, "arm_link_wr1"), hand, WRIST_OF_HAND), (hand, frame(c, "hand_depth_sensor"), HAND_OF_CAMERA)]
    if c.output.colour:
        edges.append((hand, frame(c, "hand_color_image_sensor"), HAND_OF_COLOUR))
    bag.tf(stamp_ns(session, 0.0), edges, static=True)


def transforms(session: Session) -> Iterator[Event]:
    """Where the robot believes its links to be, over the whole session."""
    c = session.config
    cell, body = c.output.cell_frame, frame(c, "body")
    shoulder, wrist = frame(c, "arm_link_sh1"), frame(c, "arm_link_wr1")
    last = -1.0
    for segment in session.segments:
        for time_s in segment.ticks(c.plan.tf_rate_hz):
            if time_s <= last + 1e-9:
                continue
            last = time_s
            T_cell_body, T_body_hand = segment.poses(time_s)
            T_body_shoulder, T_shoulder_wrist = arm_links(T_body_hand)
            edges = [(cell, body, T_cell_body), (body, shoulder, T_body_shoulder), (shoulder, wrist, T_shoulder_wrist)]
            stamp = stamp_ns(session, time_s)
            yield Event(time_s, 0, lambda bag, stamp=stamp, edges=edges: bag.tf(stamp, edges))  # type: ignore[misc]


def temperatures(session: Session) -> Iterator[Event]:
    """The thermometer, once a second."""
    c = session.config
    if not c.output.temperature:
        return
    for second in range(int(session.segments[-1].end_s) + 1):
        celsius = round(session.temperature(second), 2)

        def write(bag: BagWriter, second: int = second, celsius: float = celsius) -> None:
            bag.temperature(topic(c, "hand/temperature"), celsius, stamp_ns(session, second), frame(c, "hand_depth_sensor"))

        yield Event(float(second), 1, write)


def _captures(session: Session, truth: Truth, sensor: Sensor | None) -> Iterator[Event]:
    """Expose each capture in order of time and add its truth to `truth`."""
    c = session.config
    photons = np.random.default_rng([c.seed, 77, c.day])
    for index in progress(range(len(session.shutters)), "record", len(session.shutters)):
        shutter = session.shutters[index]
        moment = session.moment(index)
        taken = expose(moment, session.effects, photons)
        if sensor is not None:
            taken = sensor(moment, taken)
        truth.add(index)
        stamp = stamp_ns(session, session.stamp_s(shutter))
        yield Event(shutter.time_s, 2, lambda bag, taken=taken, stamp=stamp: write_frame(bag, session, taken, stamp))  # type: ignore[misc]
        if c.output.colour and (index == 0 or session.shutters[index - 1].stop != shutter.stop):
            shot = photograph(session, session.true_pose(shutter), session.stops[shutter.stop].station, index)
            yield Event(shutter.time_s, 3, lambda bag, shot=shot, stamp=stamp: _write_colour(bag, session, shot, stamp))  # type: ignore[misc]


def write_frame(bag: BagWriter, session: Session, taken: Frame, stamp: int) -> None:
    """Write one capture: depth, amplitude and points, each with its camera."""
    c, camera = session.config, session.camera
    depth = encode_depth(taken.depth, taken.saturated, camera.shape, c.output.encoding)
    bag.image(topic(c, "depth/hand/image"), depth, c.output.encoding, camera.frame_id, stamp)
    bag.camera_info(topic(c, "depth/hand/camera_info"), camera, stamp)
    if c.output.amplitude:
        bag.image(topic(c, "ir/hand/image"), encode_amplitude(taken.amplitude, camera.shape), "mono16", camera.frame_id, stamp)
        bag.camera_info(topic(c, "ir/hand/camera_info"), camera, stamp)
    if c.output.points:
        metres = taken.depth.astype(np.float32).reshape(camera.shape)
        bag.points(topic(c, "depth/hand/points"), camera.points(metres), camera.frame_id, stamp)


def _write_colour(bag: BagWriter, session: Session, picture: Bytes, stamp: int) -> None:
    c, camera = session.config, colour_camera(session.config)
    bag.image(topic(c, "camera/hand/image"), picture, "rgb8", camera.frame_id, stamp)
    bag.camera_info(topic(c, "camera/hand/camera_info"), camera, stamp)
