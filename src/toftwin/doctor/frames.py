# SPDX-License-Identifier: Apache-2.0
"""Checks of the depth frames: invalid codes, plausible distances, z or radial distance."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from tof_core.decode import check_size, decode_amplitude, decode_depth, depth_from_points, pixels, stamp_ns
from tof_core.errors import ToftwinError
from tof_core.flat.radial import radial_evidence
from tof_core.flat.wide_plane import wide_bend
from tof_core.reasons import Reason
from tof_core.registered import REMEDY, WHAT, registered
from tof_core.shares import in_percent
from toftwin.doctor.finding import fix, note, ok, refused

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from tof_core.arrays import Bytes, Image
    from tof_core.camera import Camera
    from tof_core.options import BagOptions
    from tof_core.topics import Topics
    from toftwin.doctor.finding import Finding

CHECK = "depth"
PLAUSIBLE_M = (0.03, 15.0)
"""Plausible median distances of a time-of-flight camera on an arm, metres."""
ASKED = 4
"""Frames that are tested for radial distance."""
SURE = 0.99


def examine_frames(
    messages: Sequence[Any], topics: Topics, camera: Camera, options: BagOptions, lights: Sequence[Any] = ()
) -> Iterator[Finding]:
    """Findings about the depth frames sampled from a recording; lights: amplitude images sampled from it."""
    try:
        decoded = [_decoded(m, topics, camera, options) for m in messages]
    except ToftwinError as error:
        yield refused(CHECK, error)
        return
    depths, reasons = [d for d, _ in decoded], np.stack([r for _, r in decoded])
    if topics.depth:
        yield from one_byte(messages)
    yield codes(reasons)
    yield from distances(np.stack(depths), options)
    try:
        amplitudes = _beside(messages, depths, lights, topics.amplitude) if topics.depth and lights else []
    except ToftwinError as error:
        yield refused("amplitude", error)
        amplitudes = []
    if why := registered(depths, topics.depth, amplitudes):
        yield note(CHECK, f"{why}. {WHAT}", REMEDY)
    if options.depth == "z":
        yield radial(depths, camera)


def _beside(messages: Sequence[Any], depths: Sequence[Image], lights: Sequence[Any], topic: str) -> list[Image | None]:
    """The amplitude image (H, W) of each message's stamp, None where there is none, or one of another size than the depth."""
    of_stamp = {stamp_ns(light): light for light in lights}
    found = [of_stamp.get(stamp_ns(m)) for m in messages]
    amplitudes = [None if light is None else decode_amplitude(light, topic) for light in found]
    return [a if a is not None and a.shape == z.shape else None for a, z in zip(amplitudes, depths, strict=True)]


def _decoded(message: Any, topics: Topics, camera: Camera, options: BagOptions) -> tuple[Image, Bytes]:
    if not topics.depth:
        return depth_from_points(message, camera, None, topics.points)
    depth, reason = decode_depth(message, topics.depth, scale=options.depth_scale)
    check_size(depth.shape, camera, topics.depth)
    return depth, reason


def one_byte(messages: Sequence[Any]) -> Iterator[Finding]:
    """A 16-bit image whose counts never exceed 255 has lost its high bytes."""
    raster = np.stack([pixels(m) for m in messages])
    if raster.dtype.kind == "u" and 0 < raster.max() <= 255:
        todo = "the publisher crops to 8 bits, or swaps bytes without declaring it (spot_ros2 #561): record on the robot's own host"
        yield fix(CHECK, f"no count above {raster.max()} in a 16-bit image", todo)


def codes(reasons: Bytes) -> Finding:
    """Shares of the invalid codes: 0 and NaN, 65535 and infinity."""
    shares = [float((reasons == r).mean()) for r in (Reason.VALID, Reason.NO_RETURN, Reason.SATURATED, Reason.OUT_OF_RANGE)]
    valid, nothing, full, beyond = map(in_percent, shares)
    what = f"{valid} of pixels valid, {nothing} no return (0, NaN), {full} saturated (65535), {beyond} out of range"
    if shares[0] == 0:
        return fix(
            "invalid codes",
            what,
            "check that the lens is free, the exposure is set, and --depth-topic names the right topic (spot_ros2 #526)",
        )
    if shares[0] < 0.2:
        return note("invalid codes", what, "move nearer or raise the exposure; dark and shiny parts return little")
    return ok("invalid codes", what)


def distances(depth: Image, options: BagOptions) -> Iterator[Finding]:
    """Check the median distance against `PLAUSIBLE_M`."""
    if not np.isfinite(depth).any():
        return
    low, middle, high = np.nanpercentile(depth, [5, 50, 95])
    what = f"5 %, median, 95 %: {low:.3f}, {middle:.3f}, {high:.3f} m"
    if PLAUSIBLE_M[0] < middle < PLAUSIBLE_M[1]:
        yield ok(CHECK, what)
    else:
        yield fix(
            CHECK, f"{what}: not metres", f"pass --depth-scale (now {options.depth_scale:g} m a count); 32FC1 must be in metres (REP 118)"
        )


def radial(depths: Sequence[Image], camera: Camera) -> Finding:
    """Check for radial distance: read as z, it makes flat surfaces appear bent."""
    step = max(1, len(depths) // ASKED)
    found = [radial_evidence(d, camera) for d in depths[: ASKED * step : step]]
    planes, log_odds = sum(f.planes for f in found), sum(f.log_odds for f in found)
    suspicion = float(1 / (1 + np.exp(-np.clip(log_odds, -50, 50))))
    usable = [f for f in found if f.planes]
    bend_z, bend_radial = (float(np.mean([getattr(f, name) for f in usable] or [0.0])) for name in ("bend_z_mm", "bend_radial_mm"))
    what = f"{planes} flat surfaces bend {bend_z:.1f} mm read as z, {bend_radial:.1f} mm read as radial"
    if 1 - SURE < suspicion < SURE and (wide := wide_bend(depths[0], camera)) is not None:
        suspicion = 1.0 if wide.radial else 0.0
        what = f"a plane seen in pieces ({in_percent(wide.share)} of the pixels) bends {1e3 * wide.metres:.0f} mm read as {'z' if wide.radial else 'radial'}"
    return _verdict(suspicion, planes, what)


def _verdict(suspicion: float, planes: int, what: str) -> Finding:
    if suspicion > SURE:
        return fix("z or radial", f"{what}: the depth looks radial", "pass --depth radial (node: input.depth:=radial)")
    if suspicion < 1 - SURE:
        return ok("z or radial", f"{what}: z")
    if not planes:
        return note("z or radial", "no flat surface is seen", "record a wall and run doctor on that bag, or read the camera's manual")
    return note(
        "z or radial",
        f"{what}: not decided (radial with probability {in_percent(suspicion)})",
        "record a wall that fills the image, and run doctor on that bag",
    )
