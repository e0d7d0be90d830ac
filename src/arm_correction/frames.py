# SPDX-License-Identifier: Apache-2.0
"""Frames of a correction: the hand that is commanded, and the frame of its target."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from tof_core.errors import UsageError

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_core.robot import RobotChain


@dataclass(frozen=True, slots=True, eq=False)
class Frames:
    """From TF at the view's stamp: `T_hand_camera` (4, 4) with the hand's name, and the frame that targets are wanted in (None: the body)."""

    T_hand_camera: Float = field(default_factory=lambda: np.eye(4))
    T_frame_body: Float | None = None
    frame: str = "body"
    hand: str = "hand"


def frames_of(chain: RobotChain, camera: str, stamp_ns: int, hand: str = "", frame: str = "") -> Frames:
    """Look them up in TF.

    Args:
        chain: TF between cell and camera.
        camera: frame of the depth image.
        stamp_ns: the view's.
        hand: the commanded frame (default: `hand` or `*/hand`; the camera itself where TF has none).
        frame: of the target (default: the body).

    Raises:
        UsageError: TF has no such hand.
        TransformError: TF does not connect them at that time.
    """
    tf = chain.transforms
    cell, body = chain.resolve(camera)
    body = body or cell
    known = [f for f in tf.frames() if f.rpartition("/")[2] == "hand"]
    if hand and hand not in tf.frames():
        raise UsageError(f"TF has no frame '{hand}'", where="hand frame", todo=f"TF has {', '.join(tf.frames())}")
    name = hand or (known[0] if known else camera)
    T_hand_camera = tf.lookup(name, camera, stamp_ns) if name != camera else np.eye(4)
    if frame in {"", "body", body}:
        return Frames(T_hand_camera, None, body, name)
    return Frames(T_hand_camera, tf.lookup(frame, body, stamp_ns), frame, name)
