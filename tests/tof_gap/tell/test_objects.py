# SPDX-License-Identifier: Apache-2.0
"""Foreign objects against effects that pull surfaces towards the camera."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.tof_gap.quiet_views import SHAPE, views
from tof_gap.seen.finding import Finding
from tof_gap.tell.objects import unexplained_objects
from tof_scene.world.foreign import Foreign
from tof_scene.world.surprises import OBJECT, Surprises
from tof_sensor.effects.phase_wrap import PhaseWrap

PATCH = np.s_[30:50, 40:60]
BEFORE_M = 0.04


def session(explained: float) -> tuple[Surprises, list[Any], Any]:
    """A patch 40 mm before the CAD in two of three views, of which named effects explain a share."""
    seen = views(np.random.default_rng(1))[:3]
    codes, recorded, points, maps = [], [], [], []
    for number, v in enumerate(seen):
        code, depth, pulled = np.zeros(SHAPE, np.uint8), v.view.depth.copy(), np.full(SHAPE, np.nan)
        if number < 2:
            code[PATCH] = OBJECT
            depth[PATCH] -= BEFORE_M
            pulled[PATCH] = -BEFORE_M * explained
            points.append(v.view.camera.points(depth)[PATCH].reshape(-1, 3))
        codes.append(code)
        recorded.append(replace(v.view, depth=depth))
        maps.append(pulled)
    cloud = np.concatenate(points)
    low, high = cloud.min(axis=0), cloud.max(axis=0)
    thing = Foreign((low + high) / 2, high - low, (0, 1), len(cloud), moves=False, points=cloud, clearance=np.full(len(cloud), BEFORE_M))
    figures = SimpleNamespace(maps={"lens_scatter": maps}, total=lambda _, view: np.nan_to_num(maps[view]))
    return (
        Surprises(tuple(codes), (), (thing,)),
        recorded,
        SimpleNamespace(figures=figures, findings=(), solved=SimpleNamespace(evidence=seen)),
    )


@pytest.mark.parametrize(("explained", "objects"), [(0.0, 1), (0.3, 1), (0.8, 0), (1.0, 0)])
def test_an_object_that_named_effects_explain_is_none(explained: float, objects: int) -> None:
    world, recorded, found = session(explained)
    assert len(unexplained_objects(world, recorded, found).foreign) == objects


def test_without_named_effects_all_objects_stay() -> None:
    world, recorded, found = session(1.0)
    found.figures.maps = {}
    assert unexplained_objects(world, recorded, found) is world


def test_a_view_that_the_solution_left_out_says_nothing() -> None:
    """Of the two views that show the object, one contradicts the robot: the other decides."""
    world, recorded, found = session(1.0)
    found.solved.evidence = found.solved.evidence[1:]
    found.figures.total = lambda _, view: np.where(world.pixels[view + 1] == OBJECT, -BEFORE_M, 0.0)
    assert unexplained_objects(world, recorded, found).foreign == ()


@pytest.mark.parametrize(("mhz", "objects"), [(3750.0, 0), (1000.0, 1)])
def test_a_surface_that_wraps_hangs_in_the_air_and_is_no_object(mhz: float, objects: int) -> None:
    """The patch is 40 mm before the CAD: a period of 3750 MHz; the map of the wraps does not cover it."""
    world, recorded, found = session(0.0)
    found.figures.maps = {}
    found.findings = (Finding(PhaseWrap(modulation_mhz=mhz, start_m=0.01, share=1.0), 1.0),)
    assert len(unexplained_objects(world, recorded, found).foreign) == objects
