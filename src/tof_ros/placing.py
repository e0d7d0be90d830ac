# SPDX-License-Identifier: Apache-2.0
"""Pose of the cell for a robot whose TF does not contain it (from a parameter, the scene, or a pose drawn in RViz), and TF output."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from geometry_msgs.msg import PoseWithCovarianceStamped
from tf2_msgs.msg import TFMessage

from tof_core import se3
from tof_core.errors import RefusedError, TransformError
from tof_core.placement import Placement, is_planar, moved_in_plane
from tof_ros import messages, qos

if TYPE_CHECKING:
    from collections.abc import Callable

    from tof_core.arrays import Float
    from tof_core.live import ViewOptions
    from tof_core.robot import RobotChain
    from tof_ros.managed import ManagedNode

TOPIC = "initialpose"
"""RViz's "2D Pose Estimate" publishes there."""

PARAMETER = "live.initial_pose"
ROUNDED_M, ROUNDED_DEG = 1e-3, 0.1
"""Poses that differ by less are the same: one of them is written as text."""


class Placing:
    """The placement of one node's cell; it outlives the sessions, which a new one begins anew.

    A pose on `initialpose` in the cell's own frame says where the robot's body is in the cell (as nav2 reads it), in any other frame where
    the cell's origin is. One without height and tilt moves the placement in the plane alone.
    """

    def __init__(self, node: ManagedNode[Any]) -> None:
        """Nobody has drawn a pose yet."""
        self._node = node
        self._estimate: Placement | None = None
        self._guessed = self._used = False
        self._given = ""
        self._chain: RobotChain | None = None
        self._camera = ""
        self._again = node.create_guard_condition(node.restart)
        node.warns.append(self._elsewhere)

    def chain(
        self, live: ViewOptions, cell: str, placed_in: Placement | None, on_placed: Callable[[str, str, Float], None] | None = None
    ) -> RobotChain:
        """Frames and transforms of a session that begins, nothing heard yet; from now on `initialpose` is heard.

        `cell` and `placed_in` are the scene's; `on_placed` receives the pose of the cell, once it is certain that TF does not contain it.
        """
        given = live.placement()
        self._given, self._used = PARAMETER if given else "placed_in of scene.yaml", False

        def use(parent: str, child: str, T_parent_child: Float) -> None:
            self._used = True
            if on_placed is not None:
                on_placed(parent, child, T_parent_child)

        self._chain = live.chain(cell, self._estimate or given or placed_in, use)
        self._node.input(TOPIC, PoseWithCovarianceStamped, self._take, qos.OUTPUT)
        if self._estimate is not None and self._estimate.frame:
            use(self._estimate.frame, self._chain.cell, self._estimate.T_frame_cell)
        return self._chain

    @property
    def source(self) -> str:
        """Who says where the cell is, in words."""
        if not self._used:
            return "TF"
        if self._estimate is None:
            return self._given
        return f"the pose on {TOPIC}{' (of unknown height)' if self._guessed else ''}"

    def _elsewhere(self) -> list[str]:
        """TF has the cell, and elsewhere than `live.initial_pose`, which is used only where TF has none."""
        chain = self._chain
        if chain is None or chain.placed is None or self._used or self._given != PARAMETER or not self._camera:
            return []
        cell, frame = chain.cell.lstrip("/") or "cell", chain.placed.frame.lstrip("/") or self._camera
        try:
            T_frame_cell = chain.transforms.lookup(frame, cell, chain.transforms.latest(frame, cell))
        except TransformError:
            return []
        metres, degrees = se3.distance(T_frame_cell, chain.placed.T_frame_cell)
        if metres < ROUNDED_M and degrees < ROUNDED_DEG:
            return []
        todo = f"leave {PARAMETER} out, or end what publishes that transform (a static transform, another sim_label)"
        return [f"{PARAMETER} is not used: TF has '{cell}' already, {metres:.3f} m and {degrees:.1f} deg from it; {todo}"]

    def camera(self, frame: str) -> None:
        """The frame of the views that come."""
        self._camera = frame.lstrip("/")

    def _take(self, message: PoseWithCovarianceStamped) -> None:
        frame, T = message.header.frame_id.lstrip("/"), messages.matrix(message.pose.pose)
        try:
            self._estimate = self._placed(frame, T)
        except TransformError as error:
            raise RefusedError(f"the pose is not taken: {error.what}", where=TOPIC, todo=error.todo) from error
        x, y, z = self._estimate.T_frame_cell[:3, 3]
        self._node.get_logger().info(
            f"the cell is placed at {x:.3f} {y:.3f} {z:.3f} m in '{self._estimate.frame}' ({TOPIC}); the session begins anew"
        )
        if self._guessed:
            self._node.get_logger().warning(unknown_height(self._estimate))
        self._again.trigger()

    def _placed(self, frame: str, T: Float) -> Placement:
        chain = self._chain
        assert chain is not None  # heard of only once there is one
        cell, before = chain.cell.lstrip("/") or "cell", chain.placed
        if frame != cell:
            stood = self._stood(frame) if is_planar(T) else None
            self._guessed = is_planar(T) and (stood is None or self._guessed)
            return Placement(frame, T if stood is None else moved_in_plane(T, stood))
        if not self._camera:
            raise TransformError("no view has come yet, so the body is not known", todo=f"draw it in a frame other than '{cell}'")
        pose = chain.latest(self._camera)
        root = before.frame if before is not None and before.frame else chain.transforms.root(self._camera)
        T_root_cell = chain.transforms.lookup(root, cell, chain.transforms.latest(root, self._camera))
        T_cell_body = moved_in_plane(T, pose.T_cell_body) if is_planar(T) else T
        self._guessed = self._guessed and is_planar(T)
        return Placement(root, T_root_cell @ pose.T_cell_body @ se3.inverse(T_cell_body))

    def _stood(self, frame: str) -> Float | None:
        """Where the cell was placed before (4, 4), in another frame if TF connects the two; None where nothing placed it."""
        chain = self._chain
        assert chain is not None
        if chain.placed is None:
            return None
        there = chain.placed.frame.lstrip("/") or self._camera
        if there == frame:
            return chain.placed.T_frame_cell
        try:
            T_frame_there = chain.transforms.lookup(frame, there, chain.transforms.latest(frame, there))
        except TransformError:
            return None
        return T_frame_there @ chain.placed.T_frame_cell


def unknown_height(placed: Placement) -> str:
    """What to do about a pose that was drawn without height, where nothing else says how high the cell is."""
    x, y, _ = placed.T_frame_cell[:3, 3]
    _, _, qz, qw = se3.quat_from_matrix(placed.T_frame_cell[:3, :3])
    return (
        f"height of the cell unknown: a pose drawn in RViz has none, so the scene's origin is assumed at height 0 of '{placed.frame}', not tilted. "
        f"If it is elsewhere, pass --initial-pose '{placed.frame}: {x:.3f} {y:.3f} HEIGHT 0 0 {qz:.4f} {qw:.4f}' "
        "(ros2 run: -p live.initial_pose:=...), or state placed_in in scene.yaml; poses drawn after that keep its height"
    )


class Frames:
    """TF out: the cell where TF does not know it (latched), and the camera as the CAD corrects it (per accepted view)."""

    def __init__(self, node: ManagedNode[Any]) -> None:
        """Publish; it ends with what else the node's `start` began."""
        self._static = node.create_publisher(TFMessage, "/tf_static", qos.LATCHED)
        self._moving = node.create_publisher(TFMessage, "/tf", qos.TF)
        self._node = node
        node.at_stop.append(self.close)

    def placed(self, parent: str, child: str, T_parent_child: Float) -> None:
        """The cell stands there; or, below a cell that another robot has placed, this robot's root."""
        self._static.publish(TFMessage(transforms=[messages.transform(parent, child, T_parent_child)]))

    def aligned(self, cell: str, camera: str, T_cell_camera: Float, stamp_ns: int) -> None:
        """A view's camera was there: frame `CAMERA_aligned`."""
        self._moving.publish(TFMessage(transforms=[messages.transform(cell, f"{camera}_aligned", T_cell_camera, stamp_ns)]))

    def close(self) -> None:
        """Nothing of it stays latched."""
        self._node.destroy_publisher(self._static)
        self._node.destroy_publisher(self._moving)
