# SPDX-License-Identifier: Apache-2.0
"""Publishes views as `preproc` does, and the TF of the robot that took them."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from tof_core import se3

if TYPE_CHECKING:
    from tof_core.arrays import Bytes, Float
    from tof_core.capture import View

T_HAND_CAMERA = se3.from_quat((0.06, 0.0, 0.04), (0.5, -0.5, 0.5, -0.5))


class ViewSource:
    """One robot: frames `root`, PREFIX/body, PREFIX/hand, and the camera's; a root that is not the cell stands at `T_root_cell` (4, 4) from it."""

    def __init__(self, node: Any, prefix: str = "spot", *, root: str = "cell", T_root_cell: Float | None = None) -> None:
        from geometry_msgs.msg import PoseWithCovarianceStamped
        from tf2_msgs.msg import TFMessage

        from tof_ros import qos
        from tof_ros.views import KINDS, UNFILTERED

        self.node, self.prefix, self.root = node, prefix, root
        self._T_root_cell = np.eye(4) if T_root_cell is None else T_root_cell
        kinds = {**KINDS, **dict.fromkeys(UNFILTERED.values(), KINDS["depth"])}
        self._out = {part: node.create_publisher(kind, f"{prefix}/preproc/{part}", qos.OUTPUT) for part, kind in kinds.items()}
        self._label = node.create_publisher(PoseWithCovarianceStamped, f"{prefix}/label/pose", qos.OUTPUT)
        self._tf = node.create_publisher(TFMessage, "/tf", qos.TF)
        self._colour = node.create_publisher(KINDS["depth"], f"{prefix}/camera/hand/image", qos.sensor(reliable=True))
        self._colour_info = node.create_publisher(KINDS["camera_info"], f"{prefix}/camera/hand/camera_info", qos.sensor(reliable=True))

    @property
    def matched(self) -> bool:
        """Whether a node hears it."""
        from tof_ros.views import DWELL

        depth = self._out["depth"].get_subscription_count() or self._out["unfiltered_depth"].get_subscription_count()
        return bool(self._out[DWELL].get_subscription_count() and depth)

    def place(self, T_cell_camera: Float, camera: str, stamp_ns: int) -> None:
        """Publish where the robot is, for a while before and after a stamp; the body stands at (0.2, 0, 0) of the cell."""
        from tf2_msgs.msg import TFMessage

        from tof_ros import messages

        body, hand = f"{self.prefix}/body", f"{self.prefix}/hand"
        T_cell_body = se3.from_quat((0.2, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
        T_body_hand = se3.inverse(T_cell_body) @ T_cell_camera @ se3.inverse(T_HAND_CAMERA)
        for stamp in range(stamp_ns - 200_000_000, stamp_ns + 250_000_000, 50_000_000):
            chain = ((self.root, body, self._T_root_cell @ T_cell_body), (body, hand, T_body_hand), (hand, camera, T_HAND_CAMERA))
            self._tf.publish(TFMessage(transforms=[messages.transform(a, b, T, stamp) for a, b, T in chain]))

    def send(self, view: View, *, age_s: float = 0.0, station: int = 0, colour: Bytes | None = None) -> View:
        """Publish a view as if taken `age_s` ago, `colour` (H, W, 3) by the same lens; gives it with its stamp."""
        from tof_ros import messages
        from tof_ros.views import DWELL

        assert view.robot is not None
        stamp = time.time_ns() - round(age_s * 1e9)
        self.place(view.robot.T_cell_camera, view.camera.frame_id, stamp)
        head = messages.header(stamp, view.camera.frame_id)
        if colour is not None:
            self._colour_info.publish(messages.camera_info(view.camera, head))
            self._colour.publish(messages.image(colour, "rgb8", head))
            time.sleep(0.3)
        for name, encoding in (("depth", "32FC1"), ("sigma", "32FC1"), ("count", "16UC1"), ("reason", "8UC1")):
            for topic in (name, f"unfiltered_{name}"):
                self._out[topic].publish(messages.image(np.asarray(getattr(view, name)), encoding, head))
        noise = np.asarray(view.sigma if view.noise is None else view.noise, np.float32)
        self._out["unfiltered_noise"].publish(messages.image(noise, "32FC1", head))
        self._out["camera_info"].publish(messages.camera_info(view.camera, head))
        sent = replace(view, stamp_ns=stamp, dwell_ns=stamp, station=station, amplitude=None)
        if DWELL == "dwell":  # without toftwin_msgs
            about = f"station={station} captures={view.captures} amplitude=0"
            self._out[DWELL].publish(messages.time_reference(stamp, stamp, about, view.camera.frame_id))
        else:
            from tof_ros.results import dwell

            self._out[DWELL].publish(dwell(sent, head))
        return sent

    def label(self, view: View, T_cell_camera: Float, cov: Float) -> None:
        """Publish where `sim_label` found the camera."""
        from tof_ros import messages

        self._label.publish(messages.pose(T_cell_camera, cov, messages.header(view.stamp_ns, "cell")))
