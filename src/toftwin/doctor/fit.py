# SPDX-License-Identifier: Apache-2.0
"""Checks of the scene: sizes and places of its parts, and whether the camera sees it; if not, common mistakes are tried."""

from __future__ import annotations

from itertools import islice
from typing import TYPE_CHECKING

from tof_core.errors import ToftwinError
from tof_core.shares import in_percent
from toftwin.doctor.finding import fix, note, ok, refused

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from tof_core.options import BagOptions
    from tof_scene.scene import Scene
    from toftwin.doctor.finding import Finding
    from toftwin.mistakes.find import Found

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
    """Compare some views with the CAD, and the captures of each with each other; where they do not fit, name the common mistake."""
    from dataclasses import replace

    from tof_core.bag import open_bag
    from tof_scene.raycast import Raycaster
    from toftwin.doctor.dwell import ends_of, examine_dwells
    from toftwin.mistakes.find import find_mistake
    from toftwin.options import parse_placement
    from toftwin.pipeline import PipelineConfig, ViewStream

    config = replace(PipelineConfig(), input=options)
    try:
        with open_bag(bag, options, cell_frame=scene.frame, placed=scene.placed_in) as reader:
            if placed := parse_placement(initial_pose, reader.camera.frame_id):
                reader.chain = replace(reader.chain, placed=placed)
            stream = ViewStream(reader, config)
            seen = [(view, ends_of(stream.members)) for view in islice(stream, VIEWS)]
    except ToftwinError as error:
        yield refused(CHECK, error)
        return
    if not seen:
        return
    views = [view for view, _ in seen]
    yield from examine_dwells([ends for _, ends in seen])
    yield in_words(find_mistake(views, Raycaster(scene), options, config.align))


def in_words(found: Found) -> Finding:
    """The share of pixels that fit, the distance within which a pixel fits, and the common share."""
    from toftwin.mistakes.find import FITS
    from toftwin.mistakes.fit import fitting

    share = f"{in_percent(found.share)} of the measured pixels are {fitting()}"
    usual = f"{share} (usual: {in_percent(FITS)} and more)"
    if found.mistake is not None:
        return fix(
            CHECK,
            f"{usual}, {in_percent(found.undone)} {fitting(found.mistake.metres)} without a mistake: {found.mistake.what}",
            found.mistake.todo,
        )
    if found.fits:
        return ok(CHECK, usual)
    if found.nowhere:
        todo = "is --scene the one that the bag shows? if it is, pass --initial-pose, or correct placed_in of scene.yaml"
        return fix(CHECK, f"{usual}, and no usual mistake explains it: another scene, or another place", todo)
    todo = (
        "toftwin label names parts that are missing and objects that the CAD lacks; if it names none, compare scene and views: toftwin view"
    )
    return note(CHECK, f"{usual}: parts may be missing or elsewhere, objects in view, or the camera off", todo)
