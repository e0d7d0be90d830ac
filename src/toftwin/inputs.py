# SPDX-License-Identifier: Apache-2.0
"""Opening the bag and the scene of a command."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING, Protocol

from tof_core.errors import RefusedError
from toftwin.options import parse_placement

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from tof_core.bag import BagReader
    from tof_core.options import BagOptions
    from tof_scene.scene import Scene
    from toftwin.boarded import BoardSource
    from toftwin.pipeline import PipelineConfig


class ReadsBag(Protocol):
    """Settings of a command that reads a bag."""

    @property
    def input(self) -> BagOptions:
        """Topics, frames and units."""


@contextmanager
def opened(
    bag: str | Path, scene_path: Path | None, config: ReadsBag, initial_pose: str | None = None
) -> Iterator[tuple[BagReader, Scene | None]]:
    """A bag and its scene; the cell's pose is that of `--initial-pose`, or the scene's `placed_in`."""
    from dataclasses import replace

    from tof_core.bag import open_bag

    scene = None
    if scene_path is not None:
        from tof_scene.builtin import open_scene

        scene = open_scene(scene_path)
    cell = scene.frame if scene else ""
    with open_bag(bag, config.input, cell_frame=cell, placed=scene.placed_in if scene else None) as reader:
        if placed := parse_placement(initial_pose, reader.camera.frame_id):
            reader.chain = replace(reader.chain, placed=placed)
        yield reader, scene


@contextmanager
def source(
    bag: str | Path,
    config: PipelineConfig,
    *,
    scene: Path | None = None,
    board: str | None = None,
    calibrate: bool = False,
    apart: bool = False,
    initial_pose: str | None = None,
) -> Iterator[tuple[BagReader | BoardSource, Scene]]:
    """What the command line names: a bag and `--scene`, or captures before `--board`, which is then the scene; `apart` as of `BoardSource`.

    Raises:
        UsageError: neither or both are given.
    """
    from tof_core.board.spec import FORMS, Board
    from tof_core.errors import UsageError

    if (scene is None) == (board is None):
        what = "neither a scene nor a board is given" if scene is None else "a scene and a board are given"
        raise UsageError(what, where=bag, todo=f"pass --scene FILE, or --board {FORMS}")
    if board is not None:
        from toftwin.boarded import BoardSource, read_captures

        before = BoardSource(read_captures(bag, config.input), Board.parse(board), calibrate=calibrate, apart=apart)
        yield before, before.session.scene
        return
    with opened(bag, scene, config, initial_pose) as (reader, opened_scene):
        assert opened_scene is not None
        yield reader, opened_scene


def must_have_frames(frames: int, reader: BagReader, where: str) -> None:
    """Refuse a bag of which no frame could be read."""
    if not frames:
        what = f"no frame of {reader.frame_count} could be read ({reader.last_error or 'all empty'})"
        raise RefusedError(what, where=where, todo="toftwin doctor lists what the bag lacks")
