# SPDX-License-Identifier: Apache-2.0
"""Opening the bag and the scene of a command."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING

from toftwin.options import parse_placement

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Iterator
    from pathlib import Path

    from tof_core.bag import BagReader
    from tof_scene.scene import Scene
    from toftwin.boarded import BoardSource
    from toftwin.pipeline import PipelineConfig
    from toftwin.sensing import SensingConfig


@contextmanager
def opened(
    bag: str | Path, scene_path: Path | None, config: PipelineConfig | SensingConfig, initial_pose: str | None = None
) -> Iterator[tuple[BagReader, Scene | None]]:
    """A bag and its scene; the pose of the cell comes from `--initial-pose`, or from `placed_in` of the scene."""
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
def source(args: Namespace, config: PipelineConfig) -> Iterator[tuple[BagReader | BoardSource, Scene]]:
    """What the command line names: a bag and `--scene`, or captures before `--board`, which is then the scene.

    Raises:
        UsageError: neither or both are given.
    """
    from tof_core.board.spec import FORMS, Board
    from tof_core.errors import UsageError
    from toftwin.boarded import BoardSource, read_captures

    if (args.scene is None) == (args.board is None):
        what = "neither a scene nor a board is given" if args.scene is None else "a scene and a board are given"
        raise UsageError(what, where=args.bag, todo=f"say --scene FILE, or --board {FORMS}")
    if args.board is not None:
        before = BoardSource(read_captures(args.bag, config.input), Board.parse(args.board), calibrate=args.calibrate)
        yield before, before.session.scene
        return
    with opened(args.bag, args.scene, config, args.initial_pose) as (reader, scene):
        assert scene is not None
        yield reader, scene
