# SPDX-License-Identifier: Apache-2.0
"""The judgement of the recent dwells as a task for a process of its own."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    from tof_align.config import AlignConfig
    from tof_align.known import Bias
    from tof_core.capture import View
    from tof_inspect.config import InspectConfig
    from tof_inspect.judge import Inspection
    from tof_inspect.picture import Picture


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """Views and settings of a judgement; scene: file; bias: known error of the camera; first: reference images; out: folder of the report (empty: none)."""

    views: tuple[View, ...]
    scene: str
    config: InspectConfig
    align: AlignConfig
    bias: Bias | None
    first: tuple[Picture, ...]
    out: str


def judge(task: Task, progress: Callable[[str], None]) -> tuple[Inspection, str]:
    """The verdicts, without the views, which the caller has, and the page of the report; `progress` is called with the name of each step."""
    from pathlib import Path

    from tof_inspect.judge import Inspector
    from tof_inspect.report import write
    from tof_scene.builtin import open_scene
    from tof_scene.raycast import Raycaster

    inspector = Inspector(Raycaster(open_scene(task.scene)), task.config, task.align, task.first, task.bias)
    found = inspector.judge(task.views, progress)
    page = write(inspector, found, Path(task.out), "live") if task.out else ""
    return replace(found, views=()), str(page)
