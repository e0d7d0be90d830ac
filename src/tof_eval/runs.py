# SPDX-License-Identifier: Apache-2.0
"""Comparison of two recorded runs of the graph, value by value, up to the first frame and topic that differ."""

from __future__ import annotations

from contextlib import closing
from dataclasses import dataclass
from fnmatch import fnmatch
from typing import TYPE_CHECKING, Any

import numpy as np

from tof_core.bag_files import deserialize, open_files
from tof_core.clouds import cloud_fields
from tof_core.decode import pixels, stamp_ns
from tof_core.errors import BagError

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Tolerance:
    """Values may differ by `absolute` (in their unit); a `share` of the elements of one message may differ by more."""

    absolute: float
    share: float = 0.0


EXACT = Tolerance(0.0)
TOLERANCES: dict[str, Tolerance] = {
    "preproc/depth": Tolerance(1e-6),
    "preproc/sigma": Tolerance(1e-6),
    "preproc/noise": Tolerance(1e-6),
    "preproc/points": Tolerance(2e-6),
    "preproc/reason": Tolerance(0, 1e-3),
    "preproc/amplitude": Tolerance(1e-3),
    "label/depth": Tolerance(5e-5, 2e-3),
    "label/sigma": Tolerance(5e-5, 2e-3),
    "label/points": Tolerance(1e-4, 2e-3),
    "label/mask": Tolerance(0, 2e-3),
    "label/part": Tolerance(0, 2e-3),
    "label/pose": Tolerance(2e-5),
}
"""Differences that another processor or ray caster may cause, metres or radians; other topics are compared exactly."""
IGNORED = ("/diagnostics", "/rosout", "/parameter_events", "/clock", "/tf", "/tf_static", "*/done")


@dataclass(frozen=True, slots=True)
class Difference:
    """The first disagreement of two runs, in order of stamps."""

    stamp_ns: int
    topic: str
    what: str

    def __str__(self) -> str:
        """One line: where and what."""
        return f"frame {self.stamp_ns} ns, topic {self.topic}: {self.what}"


@dataclass(frozen=True, slots=True)
class RunComparison:
    """Messages compared and largest difference per topic, and the first difference (None: within the tolerances)."""

    compared: Mapping[str, int]
    largest: Mapping[str, float]
    first: Difference | None

    @property
    def same(self) -> bool:
        """Whether the runs agree within the tolerances."""
        return self.first is None


def tolerance_of(topic: str, tolerances: Mapping[str, Tolerance] = TOLERANCES) -> Tolerance:
    """The tolerance whose name the topic ends with, in any namespace."""
    return next((t for name, t in tolerances.items() if topic.strip("/") == name or topic.endswith(f"/{name}")), EXACT)


def compare_runs(new: Path, old: Path, tolerances: Mapping[str, Tolerance] = TOLERANCES) -> RunComparison:
    """Compare two bags of the graph's outputs; messages are matched by topic and header stamp."""
    a, b = read_run(new), read_run(old)
    if not b:
        raise BagError("holds no outputs of the graph", where=old, todo="make it with toftwin replay --record")
    compared: dict[str, int] = {}
    largest: dict[str, float] = {}
    first: Difference | None = None
    for key in sorted(a.keys() | b.keys()):
        stamp, topic = key
        found, worst = _compare_pair(a.get(key), b.get(key), tolerance_of(topic, tolerances))
        compared[topic] = compared.get(topic, 0) + 1
        largest[topic] = max(largest.get(topic, 0.0), worst)
        if found and first is None:
            first = Difference(stamp, topic, found)
    return RunComparison(compared, largest, first)


def read_run(path: Path) -> dict[tuple[int, str], Any]:
    """Messages of a bag by (header stamp in ns, topic); topics that the graph does not compute are left out."""
    out: dict[tuple[int, str], Any] = {}
    try:
        with closing(open_files(path)) as files:
            kept = [topic for topic in files.topics if not any(fnmatch(topic, pattern) for pattern in IGNORED)]
            for topic, _, raw in files.messages(kept) if kept else ():
                message = deserialize(files, topic, raw)
                out[stamp_ns(message), topic] = message
    except BagError as error:
        raise BagError(error.what, where=path, todo="make it with toftwin replay --record") from error
    return out


def _compare_pair(new: Any, old: Any, tolerance: Tolerance) -> tuple[str, float]:
    """Description of the first difference ("" if there is none), and the largest difference."""
    if new is None or old is None:
        return ("is missing in the new run" if new is None else "is not in the recorded run"), 0.0
    new_parts, old_parts = parts(new), parts(old)
    if new_parts.keys() != old_parts.keys():
        return "the message has another type", 0.0
    worst = 0.0
    for name, value in new_parts.items():
        found, size = _compare_values(value, old_parts[name], tolerance)
        worst = max(worst, size)
        if found:
            return f"{name} {found}", worst
    return "", worst


def parts(message: Any) -> dict[str, NDArray[Any]]:
    """The compared contents of a message by name: pixels, points, camera, pose or text."""
    frame = {"frame_id": np.array(message.header.frame_id)}
    if hasattr(message, "encoding"):
        return frame | {"encoding": np.array(message.encoding), "pixels": pixels(message)}
    if hasattr(message, "point_step"):
        return frame | {"points": np.stack(cloud_fields(message, ("x", "y", "z")), axis=-1)}
    if hasattr(message, "distortion_model"):
        size = np.array([message.width, message.height])
        return frame | {"size": size, "k": np.asarray(message.k), "d": np.asarray(message.d), "p": np.asarray(message.p)}
    if hasattr(message, "pose"):
        pose, cov = (message.pose.pose, message.pose.covariance) if hasattr(message.pose, "covariance") else (message.pose, [])
        p, q = pose.position, pose.orientation
        return frame | {"pose": np.array([p.x, p.y, p.z, q.x, q.y, q.z, q.w]), "covariance": np.asarray(cov, float)}
    if hasattr(message, "time_ref"):
        return frame | {"time_ref": np.array([message.time_ref.sec, message.time_ref.nanosec]), "source": np.array(message.source)}
    return frame | {"message": np.array(repr(message))}


def _compare_values(new: NDArray[Any], old: NDArray[Any], tolerance: Tolerance) -> tuple[str, float]:
    if new.shape != old.shape:
        return f"has shape {new.shape}, recorded was {old.shape}", 0.0
    if new.dtype.kind in "US":
        return (f"is '{new}', recorded was '{old}'" if str(new) != str(old) else ""), 0.0
    a, b = new.astype(np.float64), old.astype(np.float64)
    with np.errstate(invalid="ignore"):
        error = np.abs(a - b)
    error[(a == b) | (np.isnan(a) & np.isnan(b))] = 0.0
    one_sided = np.isnan(error)
    off = one_sided | (error > tolerance.absolute)
    worst = float(np.max(error, initial=0.0, where=~one_sided))
    if off.sum() <= tolerance.share * off.size:
        return "", worst
    return _described(a, b, off, tolerance), worst


def _described(a: NDArray[np.float64], b: NDArray[np.float64], off: NDArray[np.bool_], tolerance: Tolerance) -> str:
    where = tuple(int(i) for i in np.argwhere(off)[0])
    at = f" at {where}" if where else ""
    return f"differs in {int(off.sum())} of {off.size} values by more than {tolerance.absolute:g}, first{at}: {a[where]:.9g}, recorded was {b[where]:.9g}"
