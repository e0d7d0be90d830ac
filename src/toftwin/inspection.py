# SPDX-License-Identifier: Apache-2.0
"""A bag and its scene to verdicts on parts: accumulate, solve the session, weigh every part in all views."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from tof_align.session import solve_session
from tof_core.config import section
from tof_core.errors import RefusedError
from tof_inspect.config import InspectConfig
from tof_inspect.judge import Inspector, PartVerdict
from tof_scene.raycast import Raycaster
from toftwin.pipeline import PipelineConfig, ViewStream

if TYPE_CHECKING:
    from tof_core.bag import BagReader
    from tof_core.capture import Posed, View
    from tof_scene.scene import Scene


@dataclass(frozen=True, slots=True)
class InspectionConfig(PipelineConfig):
    """Everything between a bag and its verdicts."""

    inspect: InspectConfig = section(InspectConfig, "when a part is there")


@dataclass(frozen=True, slots=True, eq=False)
class Inspection:
    """Verdicts, and what they were made from."""

    inspector: Inspector
    verdicts: tuple[PartVerdict, ...]
    views: tuple[View, ...]
    posed: tuple[Posed, ...]


def inspect_bag(reader: BagReader, scene: Scene, config: InspectionConfig) -> Inspection:
    """Inspect all views of a bag together.

    Raises:
        SceneError: no part is to be inspected.
        RefusedError: no view, or none whose pose is accepted.
    """
    inspector = Inspector(Raycaster(scene), config.inspect)
    views = tuple(ViewStream(reader, config))
    if not views:
        raise RefusedError("no view could be made", where="inspection", todo="toftwin doctor tells what the bag lacks")
    posed = solve_session(views, inspector.caster, config.align).posed
    return Inspection(inspector, inspector.inspect(views, posed), views, posed)
