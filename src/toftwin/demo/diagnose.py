# SPDX-License-Identifier: Apache-2.0
"""First question of the demonstration: why do simulation and camera differ? Leaves `gap/` with its report and sensor.yaml."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from toftwin.inputs import opened

if TYPE_CHECKING:
    from pathlib import Path


@dataclass(frozen=True, slots=True)
class Diagnosed:
    """The content of `gap.json`, its verdict in words, and a picture of the gap.

    before_mm, after_mm: RMS gap of the held-out views above the noise, before and after the named effects are added.
    """

    content: dict[str, Any]
    sentence: str
    picture: str
    before_mm: float
    after_mm: float


def diagnose(folder: Path, bag: Path, scene_path: Path) -> Diagnosed:
    """Diagnose a bag as `toftwin gap` does, into `folder`; without progress, since it runs beside other steps."""
    from tof_core.progress import set_quiet
    from tof_gap.advice import advise
    from tof_gap.tell.report.files import write
    from tof_gap.tell.report.page import map_picture, write_page
    from tof_gap.tell.report.words import sentence
    from toftwin.diagnosis import GapPipelineConfig, diagnose_bag

    set_quiet()
    config = GapPipelineConfig()
    with opened(bag, scene_path, config) as (reader, scene):
        assert scene is not None
        found, caster = diagnose_bag(reader, scene, config)
    content = write(found, caster, folder, advise(found, caster))
    write_page(found, content, folder, "the first day", caster.scene.names)
    gap = found.gap
    picture = map_picture(found, caster.scene.names)
    return Diagnosed(content, sentence(content), picture, gap.above_mm(gap.before), gap.above_mm(gap.after))
