# SPDX-License-Identifier: Apache-2.0
"""The diagnosis of a bag: its views, its scene and the known effects, given to `tof_gap`."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from tof_align.known import known_removed
from tof_core.calibration import FILE as CALIBRATION_FILE
from tof_core.calibration import Calibration, load_calibration
from tof_core.config import section
from tof_gap.config import GapConfig
from tof_gap.diagnose import diagnose
from tof_gap.tell.against import AgainstLimits
from tof_scene.raycast import Raycaster
from tof_sensor.effects.photon_law import PhotonLaw
from tof_sensor.known import KnownBias
from tof_sensor.origin import check_camera
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
    """Read every view unfiltered, remove the bias of the effects in `known`, diagnose the rest; noise is compared with their photon law."""
    progress("reading views")
    views = raw_views(reader, config)
    caster, align, untestable = Raycaster(scene), config.align, dict[str, str]()
    if isinstance(reader, BoardSource):
        align, untestable = reader.session.align(align), NOT_TESTABLE
        config = replace(config, gap=replace(config.gap, calibration=reader.session.calibration(config.gap.calibration)))
    if known is not None and views:
        check_camera(known.camera, views[0].camera)
    if known is not None and known.names != (PhotonLaw.NAME,):
        progress("removing known effects")
        views = known_removed(views, caster, KnownBias(known), align)
    gap = config.gap
    beside = scene.folder / CALIBRATION_FILE
    if gap.calibration == Calibration() and beside.exists():
        gap = replace(gap, calibration=load_calibration(beside))
    law = None if known is None else known.law
    return diagnose(views, caster, gap, align, left_out, progress, untestable=untestable, law=law), caster
