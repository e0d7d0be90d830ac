# SPDX-License-Identifier: Apache-2.0
"""Bags in: rosbag2 in MCAP or sqlite3, ordered by header stamp, TF known from the start.

Two passes: the first indexes stamps and reads all of TF; the second streams messages and holds
back only those that were recorded out of order.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, Self

from tof_core.bag_files import deserialize, open_files
from tof_core.bag_index import BagIndex, RawMessage
from tof_core.builder import CaptureBuilder
from tof_core.errors import BagError, TransformError
from tof_core.motion import is_still
from tof_core.options import BagOptions
from tof_core.placement import Placement
from tof_core.robot import RobotChain
from tof_core.tf import TransformBuffer
from tof_core.topics import Topics, find_topics

if TYPE_CHECKING:
    from collections import Counter
    from collections.abc import Iterator
    from pathlib import Path
    from types import TracebackType

    from tof_core.bag_files import BagFiles
    from tof_core.camera import Camera
    from tof_core.capture import Capture
    from tof_core.motion import MotionConfig

__all__ = ["BagOptions", "BagReader", "CaptureBuilder", "Placement", "RawMessage", "open_bag"]


def open_bag(
    path: Path | str,
    options: BagOptions | None = None,
    *,
    cell_frame: str = "",
    placed: Placement | None = None,
) -> BagReader:
    """Open a recording of one depth camera; use the reader as a context manager.

    Args:
        path: a bag's folder, or its .mcap or .db3 file.
        options: the user's choice of topics, frames and units.
        cell_frame: TF frame of the cell (the scene's), unless the options name another.
        placed: pose of the cell, for a robot whose TF lacks the cell frame.

    Raises:
        BagError: no bag, or damaged.
        TopicError: no depth, no CameraInfo, or several that fit.
    """
    options = options or BagOptions()
    files = open_files(path, recover=options.recover)
    try:
        return BagReader(files, options, cell_frame=options.cell_frame or cell_frame, placed=placed)
    except BaseException:
        files.close()
        raise


class BagReader:
    """A recording of one depth camera. Made by `open_bag`."""

    def __init__(self, files: BagFiles, options: BagOptions, *, cell_frame: str, placed: Placement | None) -> None:
        """Index the bag: stamps of all messages, all transforms, topics."""
        self.options, self._files = options, files
        self.transforms = TransformBuffer(options.max_gap_s)
        self.chain = RobotChain(self.transforms, cell_frame, options.body_frame, placed)
        self._index = BagIndex(files, self.transforms, lenient=options.recover, session=options.session)
        self.topics: Topics = find_topics(self.types, options, encodings=self._index.encodings, where=str(files.path))
        self._builder = self._new_builder(need_tf=True)
        self.camera: Camera = self._first_camera()

    def __enter__(self) -> Self:
        """The reader itself."""
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        """Close the files."""
        self.close()

    def close(self) -> None:
        """Close the files."""
        self._files.close()

    @property
    def note(self) -> str:
        """Warning about the bag's state, such as an unfinished recording; empty for a complete bag."""
        left_out = [f"{n} messages left out: {why}" for why, n in self._index.left_out.items()]
        return "; ".join(filter(None, [self._files.note, self._index.note, *left_out]))

    @property
    def types(self) -> dict[str, str]:
        """The type of each topic that has messages."""
        return {t.name: t.type for t in self._files.topics.values() if t.count}

    @property
    def frame_count(self) -> int:
        """Depth messages of the session that is read, frozen ones included."""
        return self._index.count(self.topics.depth or self.topics.points)

    @property
    def skipped(self) -> Counter[str]:
        """Frames left out by the last `captures()`, by reason."""
        return self._builder.skipped

    @property
    def last_error(self) -> str:
        """Why the last frame was left out, in one line."""
        return self._builder.last_error

    def captures(self, *, need_tf: bool = True, repeats: bool = False) -> Iterator[Capture]:
        """Captures in the order of header stamps; frozen frames and frames without a transform are left out and counted in `skipped`.

        Args:
            need_tf: False also yields frames without a transform, with `robot=None`.
            repeats: True keeps a frame whose content equals that of the frame before: ideal images at rest are equal; False takes it for frozen.

        Raises:
            TransformError: TF lacks the cell or the camera frame altogether.
        """
        builder = self._builder = self._new_builder(need_tf=need_tf, repeats=repeats)
        if need_tf:
            self._check_frames()
        takes = {
            self.topics.info: builder.info,
            self.topics.depth: builder.depth,
            self.topics.points: builder.points,
            self.topics.amplitude: builder.amplitude,
            self.topics.colour: builder.colour,
            self.topics.colour_info: builder.colour_info,
            self.topics.temperature: builder.temperature,
        }
        for m in self.messages(self.topics.named()):
            try:
                takes[m.topic](self.deserialize(m))
            except BagError as error:
                if not self.options.recover:
                    raise
                builder.skipped["damaged"] += 1
                builder.last_error = str(error)
            yield from builder.ready()
        yield from builder.ready(final=True)

    def still(self, capture: Capture, gate: MotionConfig) -> bool:
        """Whether the camera stood still around a capture, by TF; a capture without a robot pose counts as still."""
        if capture.robot is None:
            return True
        cell, _ = self.chain.resolve(capture.camera.frame_id)
        return is_still(self.transforms, cell, capture.camera.frame_id, capture.stamp_ns, gate)

    def messages(self, topics: tuple[str, ...] = ()) -> Iterator[RawMessage]:
        """Messages of the named topics (of all, where none is named): static transforms first, the others by header stamp."""
        yield from self._index.ordered(topics)

    def deserialize(self, message: RawMessage) -> Any:
        """The message's fields."""
        return deserialize(self._files, message.topic, message.cdr)

    def _new_builder(self, *, need_tf: bool, repeats: bool = False) -> CaptureBuilder:
        return CaptureBuilder(self.options, self.chain, self.topics, need_tf=need_tf, repeats=repeats)

    def _first_camera(self) -> Camera:
        first = next(iter(self.messages((self.topics.info,))), None)
        if first is None:
            raise BagError(f"has no message on {self.topics.info}", where=self._files.path)
        self._builder.info(self.deserialize(first))
        frame_id = self._index.frame_ids.get(self.topics.depth, "")
        camera = self._builder.camera
        assert camera is not None
        return replace(camera, frame_id=frame_id) if frame_id else camera

    def _check_frames(self) -> None:
        """Raise a TransformError that names the flags where TF gives no frame a pose."""
        try:
            self.chain.resolve(self.camera.frame_id)
        except TransformError as error:
            raise TransformError(error.what, where=self._files.path, todo=error.todo) from None
