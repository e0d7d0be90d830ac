# SPDX-License-Identifier: Apache-2.0
"""Missing parts and foreign objects are taken out of the views before any effect is asked, with the rim where both mix."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import pytest

from tests.tof_gap.quiet_views import SHAPE, views
from tof_core.camera import Camera
from tof_core.capture import View
from tof_core.reasons import Reason
from tof_gap.limits.evidence import WorldEvidence
from tof_gap.seen import world
from tof_gap.seen.world import without_world, world_of
from tof_scene.world.surprises import ABSENT, BEFORE, BEHIND, DISPLACED, NONE, OBJECT, Surprises

if TYPE_CHECKING:
    from tof_scene.raycast import Raycaster

CAMERA = Camera(width=40, height=30, fx=40.0, fy=40.0, cx=19.5, cy=14.5)


def view() -> View:
    shape = CAMERA.shape
    depth, noise = np.ones(shape, np.float32), np.full(shape, 1e-3, np.float32)
    return View(1, 1, CAMERA, depth, noise, np.ones(shape, np.uint16), np.zeros(shape, np.uint8), None)


def test_objects_and_absent_parts_are_taken_out_with_their_rim_and_sensor_errors_stay() -> None:
    codes = np.full(CAMERA.shape, NONE, np.uint8)
    codes[5:10, 5:10], codes[20:25, 5:10] = OBJECT, ABSENT
    codes[5:10, 25:30], codes[20:25, 25:30], codes[12:18, 30:36] = BEFORE, BEHIND, DISPLACED
    before = view()
    (after,) = without_world([before], Surprises((codes,), (), ()), rim_px=2)
    gone = np.zeros(CAMERA.shape, bool)
    gone[3:12, 3:12] = gone[18:27, 3:12] = True
    np.testing.assert_array_equal(np.isnan(after.depth), gone)
    np.testing.assert_array_equal(after.reason == Reason.NOT_CAD, gone)
    np.testing.assert_array_equal(before.depth, 1.0)


def test_views_without_surprises_are_the_same_objects() -> None:
    one = view()
    assert without_world([one], Surprises((np.zeros(CAMERA.shape, np.uint8),), (), ()), rim_px=2)[0] is one


@pytest.mark.parametrize("mm_s", [0.0, 2.0, 150.0])
def test_views_in_motion_are_searched_as_still_ones_are(monkeypatch: pytest.MonkeyPatch, mm_s: float) -> None:
    twist = np.array([1e-3 * mm_s, 0, 0, 0, 0, 0])
    seen = [replace(v, frame=replace(v.frame, context=replace(v.frame.context, twist=twist))) for v in views(np.random.default_rng(1))]

    def everything(found: list[Any], *_: object) -> Surprises:
        return Surprises(tuple(np.full(SHAPE, OBJECT, np.uint8) for _ in found), (), ())

    monkeypatch.setattr(world, "find_surprises", everything)
    codes = world_of(seen, cast("Raycaster", None), WorldEvidence()).pixels
    assert len(codes) == len(seen)
    assert all((c == OBJECT).all() for c in codes)
