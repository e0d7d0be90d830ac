# SPDX-License-Identifier: Apache-2.0
"""Checks of the topics: found or missing, type, encoding, rate, stamps, repeated frames."""

from __future__ import annotations

from dataclasses import fields
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from tof_core import se3
from tof_core.decode import stamp_ns
from tof_core.errors import TransformError
from toftwin.doctor.finding import fix, note, ok

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tof_core.tf import TransformBuffer
    from tof_core.topics import Topics
    from toftwin.doctor.finding import Finding
    from toftwin.doctor.recording import Recording, Stream

LACKING = {
    "amplitude": "record an amplitude or infrared image beside the depth: without it amplitude_bias cannot be distinguished from wiggling",
    "colour": "record the colour camera if parts are to be inspected in 2D, too",
    "temperature": "record sensor_msgs/Temperature: without it, drift can only be related to time",
}
"""Optional topics, and the functions that need them."""
SLOW_HZ = (0.5, 5.0)
"""Rates of a driver that is too slow for the camera; still lower rates are single captures."""
ANOTHER_CLOCK_S = 3600.0
LATE_LOG_S = 1.0


def examine_streams(recording: Recording, topics: Topics, streams: dict[str, Stream]) -> Iterator[Finding]:
    """Findings about each topic, then about stamps and contents of the frames."""
    for f in fields(topics):
        name = getattr(topics, f.name)
        if name:
            yield _found(recording, f.name, name, streams[name])
        elif f.name in LACKING:
            yield note("topic", f"no {f.name}", LACKING[f.name])
    source = topics.depth or topics.points
    yield from stamps(source, streams[source])
    yield from pauses(source, streams[source], recording.transforms, recording.index.frame_ids.get(source, ""))
    yield frozen(source, streams[source])
    yield from joined(topics, streams, recording.options.join_s)


def _found(recording: Recording, what: str, name: str, stream: Stream) -> Finding:
    encoding = recording.index.encodings.get(name, "")
    kind = recording.types[name].rpartition("/")[2] + (f" {encoding}" if encoding else "")
    line = f"{what} {name}: {kind}, {len(stream.stamps)} messages at {stream.rate:.3g} Hz"
    if what in ("depth", "points") and SLOW_HZ[0] < stream.rate < SLOW_HZ[1]:
        return note(
            "topic",
            line,
            "few captures a second: a view at rest averages those of half a second to two; where the camera runs freely, let the driver publish it alone (spot_ros2: cameras_used: [hand])",
        )
    return ok("topic", line)


def stamps(name: str, stream: Stream) -> Iterator[Finding]:
    """Check that header stamps exist and follow the clock of the recording."""
    if stream.kept and all(stamp_ns(m) == 0 for m in stream.kept):
        yield fix(
            "stamps",
            f"{name} has no header stamps",
            "let the driver stamp frames with their acquisition time; messages are joined by it",
        )
        return
    stamp, logged = np.array(stream.stamps, np.int64), np.array(stream.logged, np.int64)
    behind = (logged - stamp) / 1e9
    if abs(float(np.median(behind))) > ANOTHER_CLOCK_S:
        yield note(
            "stamps",
            f"{name} has stamps of another clock than the recorder's",
            "nothing to do with simulated time; otherwise set the robot's clock",
        )
    elif float(np.median(behind)) < -0.1:
        yield fix(
            "stamps",
            f"{name} has stamps {-np.median(behind):.1f} s in the future",
            "synchronise the clocks of camera and recorder (chrony, PTP)",
        )
    elif float(np.percentile(behind, 95)) > LATE_LOG_S:
        yield note(
            "stamps", f"{name} arrives {np.percentile(behind, 95):.1f} s after its stamp", "check the network, or raise live.patience_s"
        )
    else:
        yield ok("stamps", f"{name}: {len(stamp)} stamps over {(stamp[-1] - stamp[0]) / 1e9:.1f} s")


MOVED_M, MOVED_DEG = 0.005, 0.3
"""Larger motions are moves of the camera, not the sway of a standing robot."""


def pauses(name: str, stream: Stream, transforms: TransformBuffer, camera: str) -> Iterator[Finding]:
    """Long gaps between frames: moves between views where TF shows that the camera moved, else lost frames."""
    stamp = np.array(stream.stamps, np.int64)
    gaps = np.diff(stamp) / 1e9
    usual = float(np.median(gaps)) if len(gaps) else 0.0
    long = np.flatnonzero(gaps > max(3 * usual, 0.5)) if usual > 0 else np.zeros(0, np.int64)
    driven = [k for k in long if _moved(transforms, camera, int(stamp[k]), int(stamp[k + 1]))]
    lost = [k for k in long if k not in driven]
    if driven:
        yield ok(
            "stamps",
            f"{name} pauses {len(driven)} times, up to {gaps[driven].max():.1f} s; the camera is elsewhere after each: views of one session",
        )
    if lost:
        yield note(
            "stamps",
            f"{name} pauses {len(lost)} times, up to {gaps[lost].max():.1f} s{'; the camera is where it was after each' if driven else ''}",
            "nothing to do where the camera is triggered by software; otherwise frames were lost before recording: see the logs of recorder and driver",
        )


def _moved(transforms: TransformBuffer, camera: str, before: int, after: int) -> bool:
    """Whether TF has the camera elsewhere after a pause."""
    try:
        root = transforms.root(camera)
        metres, degrees = se3.distance(*(transforms.lookup(root, camera, stamp) for stamp in (before, after)))
    except TransformError:
        return False
    return metres > MOVED_M or degrees > MOVED_DEG


def frozen(name: str, stream: Stream) -> Finding:
    """Check for frames with the stamp or the content of the frame before."""
    pairs = list(zip(stream.stamps, stream.content, strict=True))
    again = sum(a[0] == b[0] or a[1] == b[1] for a, b in pairwise(pairs))
    if not again:
        return ok("frozen frames", f"none of {len(pairs)} on {name}")
    what = f"{again} of {len(pairs)} on {name} repeat the frame before; they are counted once"
    if again > len(pairs) // 2:
        return fix("frozen frames", what, "restart the camera's driver and record again (spot_ros2 #605)")
    return note("frozen frames", what, "check the driver's rate: it publishes faster than the camera measures")


def joined(topics: Topics, streams: dict[str, Stream], join_s: float) -> Iterator[Finding]:
    """Check that each depth frame has an amplitude image near its stamp."""
    if not topics.amplitude:
        return
    depth = np.array(streams[topics.depth or topics.points].stamps, np.int64)
    beside = np.array(sorted(streams[topics.amplitude].stamps), np.int64)
    i = np.clip(np.searchsorted(beside, depth), 1, max(len(beside) - 1, 1))
    nearest = np.minimum(np.abs(depth - beside[i - 1]), np.abs(depth - beside[np.minimum(i, len(beside) - 1)])) / 1e9
    alone = int((nearest > join_s).sum())
    if alone:
        what = f"{alone} of {len(depth)} depth frames have no amplitude within {1e3 * join_s:.0f} ms (median {1e3 * np.median(nearest):.0f} ms)"
        yield note("joining", what, f"raise --join-s, for instance to {1.2 * np.percentile(nearest, 95):.3f}, if the scene stands still")
    else:
        yield ok("joining", f"all {len(depth)} depth frames have amplitude within {1e3 * join_s:.0f} ms")
