# SPDX-License-Identifier: Apache-2.0
"""Transforms over time: a tree of frames, interpolated at a stamp, never guessed.

Within, a motion is seven floats (x, y, z and a unit quaternion x, y, z, w): on numbers so few,
Python's own arithmetic is ten times faster than arrays.
"""

from __future__ import annotations

import math
from array import array
from bisect import bisect_left
from dataclasses import dataclass, field
from threading import RLock
from typing import TYPE_CHECKING, Any, TypeAlias

from tof_core import se3
from tof_core.errors import TransformError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from tof_core.arrays import Float

Motion: TypeAlias = tuple[float, float, float, float, float, float, float]
IDENTITY: Motion = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


@dataclass(slots=True)
class _Edge:
    """`T_parent_child` over time: stamps ascending, seven floats each; one sample if static."""

    parent: str
    static: bool
    stamps: array[int] = field(default_factory=lambda: array("q"))
    motions: array[float] = field(default_factory=lambda: array("d"))

    def put(self, stamp_ns: int, motion: Motion) -> None:
        """Insert in order; a stamp seen before is replaced."""
        if self.static:
            self.stamps, self.motions = array("q", [0]), array("d", motion)
            return
        i = len(self.stamps) if not self.stamps or stamp_ns > self.stamps[-1] else bisect_left(self.stamps, stamp_ns)
        if i < len(self.stamps) and self.stamps[i] == stamp_ns:
            self.motions[7 * i : 7 * i + 7] = array("d", motion)
        else:
            self.stamps.insert(i, stamp_ns)
            self.motions[7 * i : 7 * i] = array("d", motion)

    @property
    def reached(self) -> int:
        """Time up to which this edge is known: its newest stamp but one, since a single stamp may lie in the future by mistake."""
        return self.stamps[-2 if len(self.stamps) > 1 else -1]

    def forget_before(self, stamp_ns: int) -> None:
        """Drop samples older than `stamp_ns`, many at a time."""
        old = bisect_left(self.stamps, stamp_ns)
        if old > 64 and 2 * old > len(self.stamps):
            del self.stamps[:old]
            del self.motions[: 7 * old]

    def at(self, stamp_ns: int, max_gap_ns: int) -> Motion:
        """The motion at a stamp, or a TransformError with the reason why there is none."""
        if self.static:
            return _sample(self.motions, 0)
        i = bisect_left(self.stamps, stamp_ns)
        if i < len(self.stamps) and self.stamps[i] == stamp_ns:
            return _sample(self.motions, i)
        if i == 0:
            raise TransformError(f"starts {_ms(self.stamps[0] - stamp_ns)} after the stamp {stamp_ns}")
        if i == len(self.stamps):
            raise TransformError(f"ends {_ms(stamp_ns - self.stamps[-1])} before the stamp {stamp_ns}")
        t0, t1 = self.stamps[i - 1], self.stamps[i]
        if t1 - t0 > max_gap_ns:
            raise TransformError(f"has a gap of {_ms(t1 - t0)} at the stamp {stamp_ns} (allowed: {_ms(max_gap_ns)})")
        return _interpolate(_sample(self.motions, i - 1), _sample(self.motions, i), (stamp_ns - t0) / (t1 - t0))


class TransformBuffer:
    """A tree of frames with history.

    Args:
        max_gap_s: the longest pause between two samples over which is interpolated, in seconds.
        keep_s: how much history to keep behind the newest sample, in seconds; 0 keeps all.
    """

    def __init__(self, max_gap_s: float = 0.2, keep_s: float = 0.0) -> None:
        """An empty tree."""
        self._max_gap_ns = round(max_gap_s * 1e9)
        self._keep_ns = round(keep_s * 1e9)
        self._edges: dict[str, _Edge] = {}
        self._two_parents: dict[str, tuple[str, str]] = {}
        self._lock = RLock()

    def add(self, parent: str, child: str, stamp_ns: int, T: ArrayLike, *, static: bool = False) -> None:
        """Record `T_parent_child` (4, 4) at a stamp; leading slashes of frame names are dropped."""
        T = se3.as_se3(f"{parent} -> {child}", T)
        x, y, z = T[:3, 3].tolist()
        self._put(parent, child, stamp_ns, (x, y, z, *se3.quat_from_matrix(T[:3, :3]).tolist()), static=static)

    def add_message(self, msg: Any, *, static: bool = False) -> None:
        """Record all transforms of a `tf2_msgs/TFMessage`."""
        for t in msg.transforms:
            v, q, stamp = t.transform.translation, t.transform.rotation, t.header.stamp
            name = f"{t.header.frame_id} -> {t.child_frame_id}"
            motion = _checked(name, (v.x, v.y, v.z, q.x, q.y, q.z, q.w))
            stamp_ns = int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)
            self._put(t.header.frame_id, t.child_frame_id, stamp_ns, motion, static=static)

    def _put(self, parent: str, child: str, stamp_ns: int, motion: Motion, *, static: bool) -> None:
        parent, child = parent.lstrip("/"), child.lstrip("/")
        if not parent or not child or parent == child:
            raise TransformError(f"'{parent}' -> '{child}' is no edge of a tree of frames", where="/tf")
        with self._lock:
            edge = self._edges.get(child)
            if edge is None:
                edge = self._edges[child] = _Edge(parent, static)
            elif edge.parent != parent:
                self._two_parents[child] = (edge.parent, parent)
                return
            edge.static = static
            edge.put(stamp_ns, motion)
            if not static and self._keep_ns:
                edge.forget_before(edge.reached - self._keep_ns)

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

    def settled(self, target: str, source: str, stamp_ns: int) -> bool:
        """Whether TF between two frames has gone so far past a stamp that a lookup failing now will not succeed later.

        Other frames do not count: they may be another robot's, by another clock.
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
            return tuple(sorted({*self._edges, *(e.parent for e in self._edges.values())}))

    def connected(self, target: str, source: str) -> bool:
        """Whether a chain of edges joins two frames, at whatever stamp."""
        try:
            self.chain(target, source)
        except TransformError:
            return False
        return True

    def chain(self, target: str, source: str) -> tuple[str, ...]:
        """The frames from target to source, both included."""
        with self._lock:
            up, down = self._branches(target.lstrip("/"), source.lstrip("/"))
            top = self._edges[up[-1]].parent if up else self._edges[down[-1]].parent if down else target.lstrip("/")
        return (*up, top, *reversed(down))

    def latest(self, target: str, source: str) -> int:
        """The newest stamp at which two frames can be related, in nanoseconds; 0 where nothing on the way moves."""
        with self._lock:
            up, down = self._branches(target.lstrip("/"), source.lstrip("/"))
            return min((edge.stamps[-1] for frame in (*up, *down) if not (edge := self._edges[frame]).static), default=0)

    def clear_dynamic(self) -> None:
        """Forget everything but static transforms (the clock was set back)."""
        with self._lock:
            self._edges = {child: edge for child, edge in self._edges.items() if edge.static}

    def _at(self, child: str, stamp_ns: int) -> Motion:
        edge = self._edges[child]
        try:
            return edge.at(stamp_ns, self._max_gap_ns)
        except TransformError as error:
            raise TransformError(error.what, where=f"transform {edge.parent} -> {child}") from None

    def _branches(self, target: str, source: str) -> tuple[list[str], list[str]]:
        """The children on the way up from target and from source to their nearest common ancestor."""
        up, down = self._ancestors(target), self._ancestors(source)
        shared = set(up) & set(down)
        if not shared:
            known = ", ".join(self.frames()) or "none at all"
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
        chain = [frame]
        while (edge := self._edges.get(chain[-1])) is not None:
            if edge.parent in chain:
                raise TransformError(f"frames go in a circle at '{edge.parent}'", where="/tf")
            chain.append(edge.parent)
        return chain


def _sample(motions: array[float], i: int) -> Motion:
    x, y, z, qx, qy, qz, qw = motions[7 * i : 7 * i + 7]
    return x, y, z, qx, qy, qz, qw


def _checked(name: str, motion: Motion) -> Motion:
    """Refuse what is not finite; normalise the quaternion."""
    x, y, z, qx, qy, qz, qw = motion
    n = math.sqrt(qx * qx + qy * qy + qz * qz + qw * qw)
    if not math.isfinite(n + x + y + z) or abs(n - 1.0) > 1e-2:
        raise TransformError(f"translation or quaternion is no rigid motion: {motion}", where=name)
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


def _interpolate(p: Motion, q: Motion, share: float) -> Motion:
    """Linear in translation, slerp in rotation along the shorter arc."""
    dot = p[3] * q[3] + p[4] * q[4] + p[5] * q[5] + p[6] * q[6]
    sign = -1.0 if dot < 0 else 1.0
    angle = math.acos(min(abs(dot), 1.0))
    a, b = (
        (1 - share, share) if angle < 1e-7 else (math.sin((1 - share) * angle) / math.sin(angle), math.sin(share * angle) / math.sin(angle))
    )
    r = [a * m + sign * b * n for m, n in zip(p[3:], q[3:], strict=True)]
    n = math.sqrt(sum(c * c for c in r))
    s = 1 - share
    return (s * p[0] + share * q[0], s * p[1] + share * q[1], s * p[2] + share * q[2], r[0] / n, r[1] / n, r[2] / n, r[3] / n)


def _ms(duration_ns: int) -> str:
    return f"{duration_ns / 1e6:.0f} ms"
