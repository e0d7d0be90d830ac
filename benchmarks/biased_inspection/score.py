# SPDX-License-Identifier: Apache-2.0
"""What `toftwin inspect` finds in a recorded session, beside what is true of each part."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tof_inspect.config import InspectConfig
from tof_inspect.displaced import UNKNOWN
from tof_inspect.judge import Inspector
from tof_scene.raycast import Raycaster
from toftwin.inputs import opened
from toftwin.inspection import InspectionConfig, inspect_bag

if TYPE_CHECKING:
    from pathlib import Path

    from benchmarks.biased_inspection.cases import Case
    from benchmarks.parts import Fate
    from tof_core.arrays import Float
    from tof_inspect.judge import PartVerdict


@dataclass(frozen=True, slots=True)
class Row:
    """One part of one session: what is true (moved_mm, 0 in its place), and the verdict.

    errors: error over its standard deviation along each axis in which the displacement is known, of parts with a fit that are not gone.
    """

    case: int
    camera: str
    part: str
    truth: str
    moved_mm: float
    state: str
    pixels: int
    displaced_mm: float
    std_mm: float
    errors: list[float]
    why: str


def score(case: Case, fate: dict[str, Fate], folder: Path) -> list[Row]:
    """Inspect the session in `folder` (`cases.record_case`)."""
    config = InspectionConfig()
    with opened(folder / "bag", folder / "scene" / "scene.yaml", config, "") as (reader, scene):
        assert scene is not None
        found = inspect_bag(reader, Inspector(Raycaster(scene), config.inspect, config.align), config)
    rows = []
    for v in found.verdicts:
        true = fate[v.name]
        moved = 1e3 * np.array(true.shift)
        errors = _errors(v, moved) if true.state != "absent" else []
        rows.append(
            Row(case.number, case.camera, v.name, true.state, float(np.linalg.norm(moved)), v.state, v.pixels, v.displaced_mm, v.std_mm, errors, v.why)
        )  # fmt: skip
    return rows


def _errors(verdict: PartVerdict, moved_mm: Float) -> list[float]:
    """Error over its standard deviation along each axis in which the place is known."""
    if not verdict.shift_mm:
        return []
    values, axes = np.linalg.eigh(np.array(verdict.cov_mm2))
    known = values < (UNKNOWN * InspectConfig().search_mm) ** 2
    return [float(e) for e in ((np.array(verdict.shift_mm) - moved_mm) @ axes / np.sqrt(values))[known]]
