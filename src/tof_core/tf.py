# SPDX-License-Identifier: Apache-2.0
"""Transforms over time: a tree of frames, interpolated at a stamp."""

from __future__ import annotations

import math
from collections import OrderedDict
from threading import RLock
from typing import TYPE_CHECKING, Any

from tof_core import se3
from tof_core.bounds import LONGEST_FRAME_NAME, MOST_FRAMES
from tof_core.decode import stamp_ns
from tof_core.edge import Edge
from tof_core.errors import TransformError, brief
from tof_core.tf_message import StampedTransform

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from tof_core.arrays import Float
    from tof_core.edge import Motion

NAMED_AT_MOST = 30
"""Most frames that an error lists."""
IDENTITY: Motion = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


class TransformBuffer:
    """A tree of frames with history.

    Args:
        max_gap_s: longest pause between two samples that is interpolated, seconds.
        keep_s: length of the history kept, seconds; 0 keeps all.

    At most `MOST_FRAMES` frames have a parent. Beyond that, a buffer with limited history drops the moving frame whose last
    transform is oldest; a buffer that keeps all refuses further frames.
    """

    def __init__(self, max_gap_s: float = 0.2, keep_s: float = 0.0) -> None:
        """An empty tree."""
        self._max_gap_ns = round(max_gap_s * 1e9)
        self._keep_ns = round(keep_s * 1e9)
        self._edges: dict[str, Edge] = {}
        self._moving: OrderedDict[str, None] = OrderedDict()  # children, in the order of their last transform
        self._two_parents: dict[str, tuple[str, str]] = {}
        self._names: tuple[str, ...] = ()  # of all frames, and the branches between two: cached until the tree changes
        self._routes: dict[tuple[str, str], tuple[list[str], list[str]]] = {}
        self._lock = RLock()
        self.changes = 0
        """Transforms recorded so far: as long as it is the same, so are all answers."""

    def add(self, parent: str, child: str, stamp_ns: int, T: ArrayLike, *, static: bool = False) -> None:
        """Record `T_parent_child` (4, 4) at a stamp; leading slashes of frame names are dropped."""
        T = se3.as_se3(f"{parent} -> {child}", T)
        x, y, z = T[:3, 3].tolist()
        self._put(parent, child, stamp_ns, (x, y, z, *se3.quat_from_matrix(T[:3, :3]).tolist()), static=static)

    def add_message(self, msg: Any, *, static: bool = False) -> None:
        """Record all transforms of a `tf2_msgs/TFMessage`."""
        for t in msg.transforms:
            v, q = t.transform.translation, t.transform.rotation
            self.put(StampedTransform(t.header.frame_id, t.child_frame_id, stamp_ns(t), (v.x, v.y, v.z, q.x, q.y, q.z, q.w)), static=static)

    def put(self, sent: StampedTransform, *, static: bool = False) -> None:
        """Record one transform as it was sent.

        Raises:
            TransformError: it is no rigid motion between two frames.
        """
        self._put(sent.parent, sent.child, sent.stamp_ns, _checked(sent), static=static)

    def _put(self, parent: str, child: str, stamp_ns: int, motion: Motion, *, static: bool) -> None:
        parent, child = parent.lstrip("/"), child.lstrip("/")
        if not parent or not child or parent == child or max(len(parent), len(child)) > LONGEST_FRAME_NAME:
            raise TransformError(f"{brief(parent)} -> {brief(child)} is no edge of a tree of frames", where="/tf")
        with self._lock:
            edge = self._edges.get(child)
            if edge is None:
                self._make_room()
                self._forget_found()
                edge = self._edges[child] = Edge(parent, static=static)
            elif edge.parent != parent:
                self._forget_found()
                self.changes += 1
                self._two_parents[child] = (edge.parent, parent)
                return
            self.changes += 1
            edge.static = static
            edge.put(0 if static else stamp_ns, motion)
            if static:
                self._moving.pop(child, None)
                return
            self._moving[child] = None
            self._moving.move_to_end(child)
            if self._keep_ns:
                edge.forget_before(edge.reached - self._keep_ns)

    def _make_room(self) -> None:
        """Drop a moving frame where the tree is full and history is limited."""
        if len(self._edges) < MOST_FRAMES:
            return
        if not self._keep_ns or not self._moving:
            raise TransformError(f"has more than {MOST_FRAMES} frames", where="/tf", todo="is the publisher broken?")
        oldest, _ = self._moving.popitem(last=False)
        del self._edges[oldest]
        self._two_parents.pop(oldest, None)

    def lookup(self, target: str, source: str, stamp_ns: int) -> Float:
        """`T_target_source` (4, 4) at a stamp.

        Raises:
            TransformError: a frame is unknown, the two are not connected, or an edge between
                them has no sample on both sides of the stamp within the allowed gap.
        """
        with self._lock:
            up, down = self._branches(target.lstrip("/"), source.lstrip("/"))
            motion = IDENTITY
            for child in up:
                motion = _compose(motion, _inverse(self._at(child, stamp_ns)))
            for child in reversed(down):
                motion = _compose(motion, self._at(child, stamp_ns))
        return se3.from_quat(motion[:3], motion[3:])

    def check(self, target: str, source: str, stamp_ns: int) -> None:
        """Raise what `lookup` raises, in less time."""
        with self._lock:
            up, down = self._branches(target.lstrip("/"), source.lstrip("/"))
            for child in (*up, *reversed(down)):  # in the order of a lookup
                self._at(child, stamp_ns)

    def settled(self, target: str, source: str, stamp_ns: int) -> bool:
        """Whether TF between two frames is so far past a stamp that a failing lookup will not succeed later.

        Other frames do not count: they may be another robot's, with another clock.
        """
        with self._lock:
            up, down = self._branches(target.lstrip("/"), source.lstrip("/"))
            moving = [edge for frame in (*up, *down) if not (edge := self._edges[frame]).static]
            return any(edge.reached > stamp_ns + self._max_gap_ns for edge in moving)

    def root(self, frame: str) -> str:
        """The topmost frame above `frame`."""
        with self._lock:
            return self._ancestors(frame.lstrip("/"))[-1]

    def frames(self) -> tuple[str, ...]:
        """All known frames, sorted."""
        with self._lock:
            if not self._names:
                self._names = tuple(sorted({*self._edges, *(e.parent for e in self._edges.values())}))
            return self._names

    def connected(self, target: str, source: str) -> bool:
        """Whether a chain of edges joins two frames, at any stamp."""
        try:
            self.chain(target, source)
        except TransformError:
            return False
        return True

    def chain(self, target: str, source: str) -> tuple[str, ...]:
        """The frames from target to source, both included."""
        with self._lock:
            up, down = self._branches(target.lstrip("/"), source.lstrip("/"))
            top = self._edges[up[-1]].parent if up else target.lstrip("/")
        return (*up, top, *reversed(down))

    def latest(self, target: str, source: str) -> int:
        """The newest stamp at which two frames can be related, in nanoseconds; 0 where all transforms between them are static."""
        with self._lock:
            up, down = self._branches(target.lstrip("/"), source.lstrip("/"))
            return min((edge.newest for frame in (*up, *down) if not (edge := self._edges[frame]).static), default=0)

    def clear_dynamic(self) -> None:
        """Forget everything but static transforms (the clock was set back)."""
        with self._lock:
            self._edges = {child: edge for child, edge in self._edges.items() if edge.static}
            self._moving.clear()
            self._forget_found()
            self.changes += 1

    def _forget_found(self) -> None:
        self._names = ()
        self._routes.clear()

    def _at(self, child: str, stamp_ns: int) -> Motion:
        edge = self._edges[child]
        try:
            return edge.at(stamp_ns, self._max_gap_ns)
        except TransformError as error:
            raise TransformError(error.what, where=f"transform {edge.parent} -> {child}") from None

    def _branches(self, target: str, source: str) -> tuple[list[str], list[str]]:
        """The children on the way up from target and from source to their nearest common ancestor."""
        found = self._routes.get((target, source))
        if found is None:
            found = self._routes[target, source] = self._find_branches(target, source)
        return found

    def _find_branches(self, target: str, source: str) -> tuple[list[str], list[str]]:
        up, down = self._ancestors(target), self._ancestors(source)
        shared = set(up) & set(down)
        if not shared:
            frames = self.frames()
            more = f" and {len(frames) - NAMED_AT_MOST} more" if len(frames) > NAMED_AT_MOST else ""
            known = ", ".join(frames[:NAMED_AT_MOST]) + more or "none at all"
            raise TransformError(f"no transform connects '{source}' to '{target}'", where="/tf", todo=f"TF has the frames: {known}")
        up, down = [f for f in up if f not in shared], [f for f in down if f not in shared]
        for frame in (*up, *down):
            if frame in self._two_parents:
                first, second = self._two_parents[frame]
                raise TransformError(
                    f"frame '{frame}' has two parents, '{first}' and '{second}'", where="/tf", todo="let one publisher own it"
                )
        return up, down

    def _ancestors(self, frame: str) -> list[str]:
        """The frame, its parent, and so on to its root."""
        chain = {frame: None}  # ordered, with fast look-up
        while (edge := self._edges.get(frame)) is not None:
            frame = edge.parent
            if frame in chain:
                raise TransformError(f"frames go in a circle at '{frame}'", where="/tf")
            chain[frame] = None
        return list(chain)


def _checked(sent: StampedTransform) -> Motion:
    """Refuse numbers that are not finite; normalise the quaternion."""
    x, y, z, qx, qy, qz, qw = sent.motion
    n = math.sqrt(qx * qx + qy * qy + qz * qz + qw * qw)
    if not math.isfinite(n + x + y + z) or abs(n - 1.0) > 1e-2:
        where = f"{sent.parent} -> {sent.child}"
        raise TransformError(f"translation or quaternion is no rigid motion: {sent.motion}", where=where)
    return x, y, z, qx / n, qy / n, qz / n, qw / n


def _rotate(q: Motion, x: float, y: float, z: float) -> tuple[float, float, float]:
    """v + 2 q x (q x v + w v)."""
    _, _, _, a, b, c, w = q
    tx, ty, tz = 2 * (b * z - c * y), 2 * (c * x - a * z), 2 * (a * y - b * x)
    return x + w * tx + b * tz - c * ty, y + w * ty + c * tx - a * tz, z + w * tz + a * ty - b * tx


def _compose(p: Motion, q: Motion) -> Motion:
    x, y, z = _rotate(p, q[0], q[1], q[2])
    _, _, _, a, b, c, d = p
    _, _, _, e, f, g, h = q
    return (
        p[0] + x,
        p[1] + y,
        p[2] + z,
        d * e + a * h + b * g - c * f,
        d * f - a * g + b * h + c * e,
        d * g + a * f - b * e + c * h,
        d * h - a * e - b * f - c * g,
    )


def _inverse(p: Motion) -> Motion:
    q = (0.0, 0.0, 0.0, -p[3], -p[4], -p[5], p[6])
    x, y, z = _rotate(q, p[0], p[1], p[2])
    return (-x, -y, -z, *q[3:])
