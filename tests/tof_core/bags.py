# SPDX-License-Identifier: Apache-2.0
"""Bags for the tests, written by our writer: a Spot-like robot that drives, stops and looks."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from tof_core import se3
from tof_core.bag_writer import BagWriter
from tof_core.camera import Camera
from tof_core.encode import depth_counts

if TYPE_CHECKING:
    from pathlib import Path

    from tof_core.arrays import Float, Image

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
FRAME = 66_666_667
"""Nanoseconds between frames at 15 Hz."""
CAMERA = Camera(48, 36, 45.0, 44.0, 23.7, 17.2, frame_id="spot/hand_depth_sensor")
T_BODY_CAMERA = se3.exp([0.3, 0.02, 0.4, 0.1, -0.2, 0.3])


def depth_of(i: int) -> Image:
    """The depth of frame i in metres: a slope, other for each frame, with one dead and one far pixel."""
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width]
    depth = (0.8 + 0.001 * u + 0.002 * v + 0.003 * i).astype(np.float32)
    depth[0, 0] = np.nan
    return np.asarray(depth, np.float32)


def body_at(stamp_ns: int) -> Float:
    """Where the body is in the cell: it drives along x at 0.1 m/s and turns."""
    t = (stamp_ns - START) / SECOND
    return se3.exp([0.0, 0.0, 0.0, 0.0, 0.0, 0.2 * t]) @ se3.exp([0.1 * t, 0.0, 0.5, 0.0, 0.0, 0.0])


@dataclass(frozen=True)
class Session:
    """What to write; the defaults are a good bag of a namespaced robot."""

    frames: int = 6
    namespace: str = "/spot"
    encoding: str = "16UC1"
    storage: Literal["mcap", "sqlite3"] = "mcap"
    distro: Literal["jazzy", "humble"] = "jazzy"
    camera: Camera = CAMERA
    root: str = "cell"
    tf_from: float = -0.2
    tf_to: float = 1.0
    tf_gap: tuple[float, float] = (1e9, 1e9)
    info: bool = True
    amplitude: bool = True
    temperature: bool = True
    points: bool = False
    extra: dict[str, Any] = field(default_factory=dict)


def stamp(i: int) -> int:
    """The stamp of frame i."""
    return START + i * FRAME


def write(path: Path, session: Session | None = None) -> Path:
    """Write a session to a new folder."""
    s = session or Session()
    with BagWriter(path, s.storage, s.distro) as bag:
        write_tf(bag, s)
        for i in range(s.frames):
            write_frame(bag, s, i)
    return path


def write_tf(bag: BagWriter, s: Session) -> None:
    """`cell -> spot/body` at 50 Hz, and a static way on to the camera."""
    bag.tf(START, [("spot/body", "spot/hand", T_BODY_CAMERA), ("spot/hand", "spot/hand_depth_sensor", np.eye(4))], static=True)
    for t in np.arange(s.tf_from, s.tf_to, 0.02):
        if not s.tf_gap[0] < t < s.tf_gap[1]:
            at = START + round(t * SECOND)
            bag.tf(at, [(s.root, "spot/body", body_at(at))])


def write_frame(bag: BagWriter, s: Session, i: int) -> None:
    """One frame with all that goes with it."""
    at, frame = stamp(i), s.camera.frame_id
    if s.info:
        bag.camera_info(f"{s.namespace}/depth/hand/camera_info", s.camera, at)
    if s.temperature:
        bag.temperature(f"{s.namespace}/hand/temperature", 30.0 + i, at - 1_000_000)
    if s.amplitude:
        bag.image(f"{s.namespace}/ir/hand/image", np.full(CAMERA.shape, 100 + i, np.uint16), "mono16", frame, at)
    depth = depth_of(i)
    if s.points:
        bag.points(f"{s.namespace}/depth/hand/points", CAMERA.points(depth), frame, at)
    elif s.encoding == "16UC1":
        bag.image(f"{s.namespace}/depth/hand/image", depth_counts(depth), "16UC1", frame, at)
    else:
        bag.image(f"{s.namespace}/depth/hand/image", depth, "32FC1", frame, at)
