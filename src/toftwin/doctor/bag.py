# SPDX-License-Identifier: Apache-2.0
"""Checks of a bag, from its files to its transforms; a check that is not possible ends the list, with its reason."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from tof_core.errors import BagError, ToftwinError
from tof_core.topics import find_topics
from toftwin.doctor.camera import camera_of
from toftwin.doctor.chain import examine_chain
from toftwin.doctor.finding import fix, healthy, note, ok, refused
from toftwin.doctor.fit import examine_fit
from toftwin.doctor.frames import examine_frames
from toftwin.doctor.recording import Recording
from toftwin.doctor.streams import examine_streams

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from tof_core.options import BagOptions
    from tof_core.topics import Topics
    from tof_scene.scene import Scene
    from toftwin.doctor.finding import Finding


def examine_bag(
    path: Path | str, options: BagOptions, scene: Scene | None = None, initial_pose: str | None = None, *, where: str = ""
) -> Iterator[Finding]:
    """Check everything that the graph needs of a bag, in the order in which the graph uses it.

    `where` names it in findings about its topics; empty: by its file.
    """
    try:
        recording = Recording(path, options)
    except ToftwinError as error:
        yield refused("bag", error)
        if not isinstance(error, BagError) or options.recover:
            return
        try:  # check the part that can be read
            recording = Recording(path, replace(options, recover=True))
        except ToftwinError:
            return
    try:
        yield from _examine(recording, scene, initial_pose, where or str(path))
    finally:
        recording.close()


def _examine(recording: Recording, scene: Scene | None, initial_pose: str | None, where: str) -> Iterator[Finding]:
    from toftwin.options import parse_placement

    if recording.files.note:
        yield note("bag", recording.files.note, "stop the recorder with Ctrl-C and wait until it has finished")
    else:
        yield ok("bag", f"{len(recording.types)} topics with messages")
    if recording.index.note:
        yield note("session", recording.index.note, "label each session on its own; record the next one after the clocks are set")
    if not {"/tf", "/tf_static"} & recording.types.keys() and not initial_pose:
        yield fix("TF", "no /tf and no /tf_static", "record both: ros2 bag record /tf /tf_static DEPTH CAMERA_INFO")
    try:
        topics = find_topics(recording.types, recording.options, encodings=recording.index.encodings, where=where)
    except ToftwinError as error:
        yield refused("topic", error)
        return
    try:
        streams = recording.read(topics)
    except ToftwinError as error:
        yield refused("bag", error)
        return
    yield from examine_streams(recording, topics, streams)
    camera, findings = camera_of(topics, streams)
    yield from findings
    if camera is None:
        return
    source = streams[topics.depth or topics.points]
    lights = streams[topics.amplitude].kept if topics.amplitude else ()
    yield from examine_frames(source.kept, topics, camera, recording.options, lights)
    frame = _camera_frame(recording, topics) or camera.frame_id
    placed = parse_placement(initial_pose, frame) or (scene.placed_in if scene else None)
    chain = list(examine_chain(recording.transforms, frame, source.stamps, recording.options, scene.frame if scene else "", placed))
    yield from chain
    if scene is not None and healthy(chain):
        yield from examine_fit(recording.files.path, scene, recording.options, initial_pose)


def _camera_frame(recording: Recording, topics: Topics) -> str:
    """The frame named by the depth image; of a point cloud, the frame of its CameraInfo."""
    return recording.index.frame_ids.get(topics.depth, "")
