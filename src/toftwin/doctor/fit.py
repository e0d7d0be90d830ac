# SPDX-License-Identifier: Apache-2.0
"""Checks of the scene: sizes and places of its parts, and whether the camera sees it; the usual mistakes are tried where it does not."""

from __future__ import annotations

from itertools import islice
from typing import TYPE_CHECKING

from tof_core.errors import ToftwinError
from toftwin.doctor.finding import fix, note, ok, refused

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from tof_core.options import BagOptions
    from tof_scene.scene import Scene
    from toftwin.doctor.finding import Finding

CHECK = "scene"
VIEWS = 12
"""Views that are read of a bag."""


def examine_parts(scene: Scene, path: Path) -> Iterator[Finding]:
    """Sizes and places of the parts."""
    from toftwin.mistakes.parts import sizes, suspicious

    yield ok(CHECK, sizes(scene))
    for must, what, todo in suspicious(scene, path):
        yield fix(CHECK, what, todo) if must else note(CHECK, what, todo)


def examine_fit(bag: Path | str, scene: Scene, options: BagOptions, initial_pose: str | None) -> Iterator[Finding]:
    """Render some views against the CAD; where they do not fit, name the usual mistake that explains it."""
    from dataclasses import replace

    from tof_core.bag import open_bag
    from tof_scene.raycast import Raycaster
    from toftwin.mistakes.find import find_mistake
    from toftwin.options import parse_placement
    from toftwin.pipeline import PipelineConfig, ViewStream

    config = replace(PipelineConfig(), input=options)
    try:
        with open_bag(bag, options, cell_frame=scene.frame, placed=scene.placed_in) as reader:
            if placed := parse_placement(initial_pose, reader.camera.frame_id):
                reader.chain = replace(reader.chain, placed=placed)
            views = list(islice(ViewStream(reader, config), VIEWS))
    except ToftwinError as error:
        yield refused(CHECK, error)
        return
    if not views:
        return
    found = find_mistake(views, Raycaster(scene), options, config.align)
    share = f"{found.share:.0%} of the measured pixels fit the CAD"
    if found.mistake is not None:
        yield fix(CHECK, f"{share}, {found.undone:.0%} without a mistake: {found.mistake.what}", found.mistake.todo)
    elif found.fits:
        yield ok(CHECK, share)
    elif found.nowhere:
        todo = "is --scene the one that the bag shows? if it is, pass --initial-pose, or correct placed_in of scene.yaml"
        yield fix(CHECK, f"{share}, and no usual mistake explains it: another scene, or another place", todo)
    else:
        yield note(CHECK, share, "look at the scene and the views: toftwin view; toftwin label names missing parts and foreign objects")
