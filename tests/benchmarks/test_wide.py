# SPDX-License-Identifier: Apache-2.0
"""The draw of other cameras, parts and strengths: the same each time, and every scene of it can be recorded."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from benchmarks.gap_check.cases import MOVING
from benchmarks.gap_check.record import config_of
from benchmarks.gap_check.wide import KINDS, LEAST, MOST, draw_wide, scenes, write_scene
from tof_scene.scene_file import load_scene

if TYPE_CHECKING:
    from pathlib import Path


def test_more_cases_leave_the_first_as_they_are() -> None:
    assert draw_wide(12, 5)[:6] == draw_wide(6, 5)
    assert draw_wide(6, 5) != draw_wide(6, 6)


def test_kinds_strengths_and_cameras_are_those_that_are_said() -> None:
    cases = draw_wide(120, 1)
    assert {c.kind for c in cases} == set(KINDS)
    for case in cases:
        assert len(case.effects) == {"null": 0, "pair": 2}.get(case.kind, 1)
        assert case.left_out == (next(iter(case.effects)) if case.kind == "left-out" else "")
        assert all(LEAST <= strength <= MOST for strength in case.effects.values())
        config = config_of(case, (224, 171))
        assert config.camera.modulation_mhz == case.modulation_mhz
        assert config.plan.capture_moving == bool(MOVING & set(case.effects))
    assert len({config_of(c, (224, 171)).camera.width for c in cases}) == 6


@pytest.mark.parametrize("name", ["boxes", "assembly", "mould"])
def test_every_scene_is_written_and_read(name: str, tmp_path: Path, request: pytest.FixtureRequest) -> None:
    if name != "boxes":
        request.getfixturevalue("shared_data")
        assert name in scenes()
    scene = load_scene(write_scene(name, tmp_path, 3))
    assert "table" in scene.names
    assert sum(p.inspect for p in scene.parts) >= 4
    assert len({p.material.albedo for p in scene.parts}) > 3
    assert load_scene(write_scene(name, tmp_path / "again", 3)).digest == scene.digest
