# SPDX-License-Identifier: Apache-2.0
"""The sessions on which the numbers are tried: twelve of the gap check's kind, or those of a folder."""

from __future__ import annotations

import json
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from benchmarks.filtered import FILTERS, through
from benchmarks.gap_check.cases import Case
from benchmarks.gap_check.examine import DATA_SHEET
from benchmarks.gap_check.record import BAGS, record_all
from benchmarks.surprises import cases as surprises
from tof_core.calibration import Calibration, calibration_beside
from tof_scene.raycast import Raycaster
from tof_sensor.model import load_model
from toftwin.diagnosis import GapPipelineConfig
from toftwin.inputs import opened
from toftwin.pipeline import raw_views

if TYPE_CHECKING:
    from pathlib import Path

    from tof_core.capture import View
    from tof_sensor.effects.photon_law import PhotonLaw

SURPRISES = 9
"""Seed of the sessions whose world is not as its CAD."""
SIZE, VIEWS = (160, 122), 12
"""Pixels and views of a session, unless asked otherwise."""
PLAN: tuple[tuple[str, str, dict[str, float], str], ...] = (
    ("null", "body_section", {}, ""),
    ("single", "housing", {"wiggling": 1.0}, ""),
    ("single", "pipework", {"multipath": 1.0}, ""),
    ("pair", "housing", {"cad_deviation": 1.0, "noise": 1.0}, ""),
    ("single", "body_section", {"fixed_pattern": 1.0}, ""),
    ("left-out", "housing", {"lens_scatter": 1.0}, "lens_scatter"),
    ("single", "pipework", {"flying_pixels": 1.0}, ""),
    ("single", "body_section", {"hand_eye": 1.0}, ""),
    ("null", "housing", {}, ""),
    ("single", "pipework", {"dropout": 1.0}, ""),
    ("single", "housing", {"motion": 1.0}, ""),
    ("single", "body_section", {"interference": 1.0}, ""),
)
"""Kind, scene, effects at their usual strength, effect withheld from the list; the most telling sessions first."""


@dataclass(frozen=True, slots=True, eq=False)
class Session:
    """Views of a recorded session, its scene, the effects that may not be named, and what is stated: photon law of a data sheet, calibration."""

    name: str
    views: list[View]
    caster: Raycaster
    left_out: frozenset[str]
    law: PhotonLaw | None = None
    calibration: Calibration = field(default_factory=Calibration)

    @property
    def size(self) -> str:
        """Views and pixels, as the page states them."""
        height, width = self.views[0].depth.shape
        return f"{len(self.views)} views of {width}x{height} pixels"


def record(folder: Path, count: int, size: tuple[int, int] = SIZE, views: int = VIEWS) -> None:
    """Record the first `count` sessions of the plan into `folder`; those that are there are kept."""
    cases = [
        Case(f"case{i:04d}", kind, scene, effects, left_out, 1000 + i, 100.0, {"plan.views": views})
        for i, (kind, scene, effects, left_out) in enumerate(PLAN[:count])
    ]
    record_all(cases, folder, size)


def record_surprise(folder: Path, number: int, size: tuple[int, int], views: int) -> str:
    """Record a session of `benchmarks.surprises` into `folder`, without effects of the camera; returns its name."""
    case = surprises.draw(number + 1, SURPRISES, views, effects=False)[number]
    name = f"surprise{number:04d}"
    surprises.record_case(case, folder / BAGS / name, size)
    (folder / BAGS / name / "list.json").write_text(json.dumps({"left_out": []}))
    return name


def load(folder: Path, name: str, firmware: str = "") -> Session:
    """One session of a folder of the gap check's layout, its depth images through a denoising filter of `benchmarks.filtered` if one is named."""
    case = folder / BAGS / name
    config = GapPipelineConfig()
    with ExitStack() as stack:
        reader, scene = stack.enter_context(opened(case / "bag", case / "scene" / "scene.yaml", config))
        assert scene is not None
        left_out = frozenset(json.loads((case / "list.json").read_text())["left_out"])
        caster, views = Raycaster(scene), raw_views(reader, config)
        if firmware:
            views = list(through(FILTERS[firmware])(views, caster))
        sheet = case / "scene" / DATA_SHEET
        law = load_model(sheet).law if sheet.exists() else None
        return Session(name, views, caster, left_out, law, calibration_beside(case / "scene"))
