# SPDX-License-Identifier: Apache-2.0
"""A part that is not there is called missing by the verdict of the views, not out of its place."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.tof_align.made import scene_of, section, session
from tof_core.capture import Posed
from tof_scene.raycast import Raycaster
from tof_scene.world.absent import Missing
from tof_scene.world.surprises import Surprises
from tof_sim_label.labeller import label_session
from tof_sim_label.world import missing_named

if TYPE_CHECKING:
    from collections.abc import Sequence

NAMES = ("wall", "crate", "drum")
OPEN = "robot's pose kept where the data do not say: slides along x; "


def without(gone: Sequence[int]) -> Surprises:
    """A world in which these parts are not there."""
    return Surprises((), tuple(Missing(p, (0,), 500, 1.0) for p in gone), ())


def said(verdict: str, apart: Sequence[float], gone: Sequence[int]) -> str:
    """The verdict of a view once the world is known; apart: metres per part."""
    posed = Posed(np.eye(4), np.eye(6), verdict=verdict, apart=np.array(apart))
    return missing_named([posed], without(gone), NAMES)[0].verdict


@pytest.mark.parametrize(
    ("verdict", "apart", "gone", "expected"),
    [
        ("parts disagree with the CAD: crate by 38 mm", (0, 0.038, 0), [1], "part missing: crate (the views see what lies behind)"),
        (
            "parts disagree with the CAD: crate by 38 mm, drum by 5 mm",
            (0, 0.038, 0.005),
            [1],
            "part missing: crate (the views see what lies behind); parts disagree with the CAD: drum by 5 mm",
        ),
        (
            f"{OPEN}parts disagree with the CAD: crate by 38 mm, drum by 5 mm",
            (0, 0.038, 0.005),
            [1, 2],
            f"{OPEN}parts missing: crate, drum (the views see what lies behind)",
        ),
        ("parts disagree with the CAD: drum by 5 mm", (0, 0, 0.005), [1], "parts disagree with the CAD: drum by 5 mm"),
        ("ok", (), [1], "ok"),
        ("parts disagree with the CAD: drum by 5 mm", (0, 0, 0.005), [], "parts disagree with the CAD: drum by 5 mm"),
    ],
)
def test_the_verdict_calls_a_missing_part_missing(verdict: str, apart: Sequence[float], gone: Sequence[int], expected: str) -> None:
    assert said(verdict, apart, gone) == expected


def test_labels_of_a_session_without_a_part_say_so() -> None:
    bare = Raycaster(scene_of(*(p for p in section().scene.parts if p.name != "block")))
    views, _ = session(bare, views=6)
    solution, labels = label_session(views, section())
    assert all("block by" in p.verdict for p in solution.posed), "the solution alone takes it for a part out of its place"
    assert {label.posed.verdict for _, label in labels} == {"part missing: block (the views see what lies behind)"}
