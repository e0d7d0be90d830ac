# SPDX-License-Identifier: Apache-2.0
"""The diagnosis of a running session as a task for a process of its own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from tof_gap.steps import REPORT, with_share

if TYPE_CHECKING:
    from collections.abc import Callable

    from tof_align.config import AlignConfig
    from tof_core.capture import View
    from tof_gap.config import GapConfig

NICENESS = 5
"""On a busy host, the graph's frames have priority over a diagnosis of minutes."""


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """Views and settings of a diagnosis; scene, sensor: files (sensor may be empty); out: folder of the report (empty: none)."""

    views: tuple[View, ...]
    scene: str
    config: GapConfig
    align: AlignConfig
    sensor: str
    left_out: frozenset[str]
    out: str


def diagnose(task: Task, progress: Callable[[str], None]) -> dict[str, Any]:
    """The content of gap.json; `progress` is called with the name of each step."""
    from pathlib import Path

    from tof_gap.advice import advise
    from tof_gap.session import diagnose_session
    from tof_gap.tell.report.files import region_maps, report, write
    from tof_gap.tell.report.kept import kept
    from tof_gap.tell.report.page import write_page
    from tof_scene.builtin import open_scene
    from tof_scene.raycast import Raycaster
    from tof_sensor.model import load_model

    known = load_model(Path(task.sensor)) if task.sensor else None
    caster = Raycaster(open_scene(task.scene))

    def report_step(step: str) -> None:
        progress(with_share(step))

    found = diagnose_session(task.views, caster, task.config, task.align, known=known, left_out=task.left_out, progress=report_step)
    report_step(REPORT)
    advice = advise(found, caster)
    if not task.out:
        return report(found, caster, region_maps(found, caster), advice, kept(found, known))
    content = write(found, caster, Path(task.out), advice, kept(found, known))
    return content | {"page": str(write_page(found, content, Path(task.out), "live"))}
