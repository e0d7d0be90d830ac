# SPDX-License-Identifier: Apache-2.0
"""The views of a bag, and the corrector for them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from arm_correction.config import CorrectConfig
from tof_core.config import section
from tof_core.errors import RefusedError
from toftwin.pipeline import PipelineConfig, ViewStream

if TYPE_CHECKING:
    from arm_correction.corrector import Corrector
    from arm_correction.reference import Reference
    from tof_align.known import Bias
    from tof_core.bag import BagReader
    from tof_core.capture import View
    from tof_scene.scene import Scene


@dataclass(frozen=True, slots=True)
class CorrectionConfig(PipelineConfig):
    """Settings from the bag to the correction."""

    correct: CorrectConfig = section(CorrectConfig, "registration, trust and limits")


def views_of(reader: BagReader, config: CorrectionConfig) -> list[View]:
    """The views of a bag whose robot pose is known."""
    views = [v for v in ViewStream(reader, config) if v.robot is not None]
    if not views:
        raise RefusedError("no view has a robot pose", where="correction", todo="toftwin doctor lists what the bag lacks")
    return views


def corrector_of(scene: Scene | None, reference: Reference | None, config: CorrectionConfig, bias: Bias | None = None) -> Corrector:
    """A corrector that compares with the CAD, with a reference view, or with both; bias: known bias of the camera."""
    from arm_correction.corrector import Corrector

    caster = None
    if scene is not None:
        from tof_scene.raycast import Raycaster

        caster = Raycaster(scene)
    return Corrector(config.correct, config.align, caster=caster, reference=reference, bias=bias)
