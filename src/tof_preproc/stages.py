# SPDX-License-Identifier: Apache-2.0
"""The stages that work on one raster, by name, in the order of the configuration."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

from tof_preproc.config import SAMPLE, PreprocConfig, stages_of
from tof_preproc.gates import remove_amplitude, remove_range, remove_self
from tof_preproc.sor import remove_sor
from tof_preproc.surface import remove_flying, remove_grazing

if TYPE_CHECKING:
    from collections.abc import Callable

    from tof_preproc.frame import Frame, Report

Stage: TypeAlias = "Callable[[Frame, PreprocConfig], int]"
RASTER: dict[str, Stage] = {
    "range": remove_range,
    "amplitude": remove_amplitude,
    "self": remove_self,
    "flying": remove_flying,
    "grazing": remove_grazing,
    "sor": remove_sor,
}


def enabled(config: PreprocConfig) -> tuple[str, ...]:
    """The stages that act, in order: those the order names whose section does not switch them off."""
    return tuple(s for s in stages_of(config.order) if getattr(getattr(config, s, None), "enable", True))


def split(config: PreprocConfig) -> tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]]:
    """Stages for each capture, over the captures of a dwell, for the accumulated view."""
    stages = enabled(config)
    at = stages.index("accumulate")
    before = tuple(s for s in stages[:at] if s not in SAMPLE)
    return before, tuple(s for s in stages[:at] if s in SAMPLE), stages[at + 1 :]


def apply(stages: tuple[str, ...], frame: Frame, config: PreprocConfig, report: Report) -> None:
    """Run raster stages in place and note what each removed."""
    for stage in stages:
        if stage == "amplitude" and frame.amplitude is None:
            report.passed[stage] = "the captures have no amplitude"
        report.removed[stage] = report.removed.get(stage, 0) + RASTER[stage](frame, config)
