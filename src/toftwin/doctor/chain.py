# SPDX-License-Identifier: Apache-2.0
"""Checks of the transforms from the cell to the camera, at the stamps of the frames."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

from tof_core.errors import TransformError
from tof_core.robot import RobotChain
from toftwin.doctor.finding import fix, note, ok, refused

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from tof_core.options import BagOptions
    from tof_core.placement import Placement
    from tof_core.tf import TransformBuffer
    from toftwin.doctor.finding import Finding

CHECK = "TF"
WORLDS = ("odom", "vision", "map", "world")
"""TF roots that locate the robot, but not the cell."""


def examine_chain(
    transforms: TransformBuffer, camera_frame: str, stamps: Sequence[int], options: BagOptions, cell: str, placed: Placement | None
) -> Iterator[Finding]:
    """Whether a chain exists, is complete at each stamp, and has a base and a cell.

    Args:
        transforms: all transforms of the recording.
        camera_frame: the optical frame of the depth image.
        stamps: of the depth frames, nanoseconds.
        options: frame names given by the user, longest gap that is interpolated.
        cell: the scene's frame; empty where no scene was given.
        placed: pose of the cell, for a robot whose TF does not contain it.
    """
    if not camera_frame:
        yield fix(CHECK, "the depth image names no frame (header.frame_id is empty)", "set the frame in the camera's driver")
        return
    here = placed is not None and placed.frame.lstrip("/") == camera_frame
    if camera_frame not in transforms.frames() and not here:
        known = ", ".join(transforms.frames()) or "none"
        yield fix(
            CHECK,
            f"no transform to the camera's frame '{camera_frame}' (TF has: {known})",
            "record /tf_static and /tf too; start the recorder before the driver, which sends /tf_static once; without TF, --initial-pose places the camera",
        )
        return
    chain = RobotChain(transforms, options.cell_frame or cell, options.body_frame, placed)
    try:
        root, body = chain.resolve(camera_frame)
        frames = transforms.chain(root, camera_frame)
    except TransformError as error:
        yield refused(CHECK, error)
        return
    yield ok(CHECK, " -> ".join(frames))
    yield from _ends(root, body, named=bool(chain.cell or placed))
    yield gaps(chain, camera_frame, stamps)


def _ends(root: str, body: str, *, named: bool) -> Iterator[Finding]:
    if body:
        yield ok(CHECK, f"base '{body}': stations are distinguished by it")
    else:
        yield note(
            CHECK,
            "no base frame between cell and camera",
            "name it with --body-frame if the robot drives; otherwise the whole bag is one station",
        )
    if not named and root.rpartition("/")[2] in WORLDS:
        yield note(
            CHECK,
            f"the root '{root}' is not a cell",
            "pass --scene with placed_in, or --initial-pose; the pose of the cell is never assumed",
        )


def gaps(chain: RobotChain, camera_frame: str, stamps: Sequence[int]) -> Finding:
    """Number of frames without a pose, and the transform that is missing."""
    lacking: Counter[str] = Counter()
    first = ""
    for stamp in stamps:
        try:
            chain.pose(camera_frame, stamp)
        except TransformError as error:
            lacking[error.where] += 1
            first = first or str(error)
    lost = lacking.total()
    if not lost:
        return ok("TF gaps", f"all {len(stamps)} frames have a pose")
    what = f"{lost} of {len(stamps)} frames have no pose ({first})"
    if lost > len(stamps) // 10:
        return fix(
            "TF gaps",
            what,
            "record /tf without loss (ros2 bag record --max-cache-size), let it run before and after the frames, or raise --max-gap-s",
        )
    return note("TF gaps", what, "these frames are skipped and counted")
