# SPDX-License-Identifier: Apache-2.0
"""The gap diagnosis composed: a bag and a scene in, a diagnosis out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from tof_core.config import section
from tof_core.flat.wide_plane import wide_bend
from tof_gap.config import GapConfig
from tof_gap.diagnose import diagnose
from tof_gap.solve.known import known_removed
from tof_scene.raycast import Raycaster
from toftwin.pipeline import PipelineConfig, raw_views
from toftwin.retraining import RetrainConfig

if TYPE_CHECKING:
    from collections.abc import Callable

    from tof_core.bag import BagReader
    from tof_core.capture import View
    from tof_gap.tell.diagnosis import Diagnosis
    from tof_scene.scene import Scene
    from tof_sensor.model import SensorModel


@dataclass(frozen=True, slots=True)
class GapPipelineConfig(PipelineConfig):
    """The pipeline's settings, and the diagnosis's."""

    gap: GapConfig = section(GapConfig, "when an effect is believed")
    retrain: RetrainConfig = section(RetrainConfig, "learning from the fitted sensor")


def diagnose_bag(
    reader: BagReader,
    scene: Scene,
    config: GapPipelineConfig,
    *,
    known: SensorModel | None = None,
    left_out: frozenset[str] = frozenset(),
    say: Callable[[str], None] = lambda _: None,
) -> tuple[Diagnosis, Raycaster]:
    """Read every view unfiltered, take off what is `known`, diagnose the rest."""
    say("reading views")
    views = raw_views(reader, config)
    caster = Raycaster(scene)
    if known is not None:
        say("taking off what is known")
        views = known_removed(views, caster, known, config.align)
    return diagnose(views, caster, config.gap, config.align, left_out, say, _bends), caster


def _bends(view: View) -> bool:
    """Whether the widest plane of a view bends as distances taken for z do."""
    found = wide_bend(view.depth, view.camera)
    return found is not None and found.radial
