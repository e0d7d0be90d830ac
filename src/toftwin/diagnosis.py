# SPDX-License-Identifier: Apache-2.0
"""The diagnosis of a bag: its views, its scene and the known effects, given to `tof_gap`."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from tof_core.config import section
from tof_gap.config import GapConfig
from tof_gap.session import diagnose_session
from tof_gap.tell.against import AgainstLimits
from tof_scene.raycast import Raycaster
from toftwin.boarded import NOT_TESTABLE, BoardSource
from toftwin.pipeline import PipelineConfig, raw_views
from toftwin.retraining import RetrainConfig

if TYPE_CHECKING:
    from collections.abc import Callable

    from tof_core.bag import BagReader
    from tof_gap.tell.diagnosis import Diagnosis
    from tof_scene.scene import Scene
    from tof_sensor.model import SensorModel


@dataclass(frozen=True, slots=True)
class GapPipelineConfig(PipelineConfig):
    """Settings of the pipeline and of the diagnosis."""

    gap: GapConfig = section(GapConfig, "when an effect is believed")
    against: AgainstLimits = section(AgainstLimits, "when a simulator differs from the camera")
    retrain: RetrainConfig = section(RetrainConfig, "training with the fitted sensor")


def diagnose_bag(
    reader: BagReader | BoardSource,
    scene: Scene,
    config: GapPipelineConfig,
    *,
    known: SensorModel | None = None,
    left_out: frozenset[str] = frozenset(),
    progress: Callable[[str], None] = lambda _: None,
) -> tuple[Diagnosis, Raycaster]:
    """Read every view unfiltered, remove the bias of the effects in `known`, and diagnose the rest."""
    progress("reading views")
    views = raw_views(reader, config)
    caster, gap, align, untestable = Raycaster(scene), config.gap, config.align, dict[str, str]()
    if isinstance(reader, BoardSource):
        align, untestable = reader.session.align(align), NOT_TESTABLE
        gap = replace(gap, calibration=reader.session.calibration(gap.calibration))
    found = diagnose_session(views, caster, gap, align, known=known, left_out=left_out, progress=progress, untestable=untestable)
    return found, caster
