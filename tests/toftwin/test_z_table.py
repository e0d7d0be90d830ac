# SPDX-License-Identifier: Apache-2.0
"""How a driver made depth of distance, before a board: every reading is found, and a camera's offset is none of them."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.toftwin.test_board import BOARD, captures
from tof_core.camera import radial_to_z
from tof_gap.limits.evidence import LevelLimits
from tof_sensor.effects.z_conversion import ZConversion
from toftwin.boarded import BoardSession, board_session
from toftwin.z_table import READINGS, Reading, converted, reading

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_core.capture import Capture, View

ROWS, COLUMNS = 24, 40
"""Lines that are cut off below and to the right: the principal point is then 12 rows and 20 columns off the middle."""


def cropped(capture: Capture) -> Capture:
    """The capture without its last rows and columns."""
    h, w = (n - cut for n, cut in zip(capture.depth.shape, (ROWS, COLUMNS), strict=True))
    assert capture.amplitude is not None
    return replace(
        capture,
        camera=replace(capture.camera, width=w, height=h),
        depth=capture.depth[:h, :w],
        amplitude=capture.amplitude[:h, :w],
        reason=capture.reason[:h, :w],
    )


@lru_cache(maxsize=1)
def session() -> BoardSession:
    """Six views; depth is the board's, with noise and a walk error of 12 mm on black squares."""
    return board_session([cropped(c) for c in captures(10)[4:]], BOARD)


def factor(found: Reading) -> Float:
    """(H, W) published depth over z."""
    camera = session().camera
    along = camera.ray_length() if found.along_ray else np.ones(camera.shape)
    return np.asarray(along * ZConversion(table=found.table).published(camera))


def published(found: Reading, offset_m: float = 0.0) -> list[View]:
    """The views as a driver publishes them that makes depth by this reading, with an offset of the camera."""
    return [replace(v, depth=((v.depth + offset_m) * factor(found)).astype(np.float32)) for v in session().views]


@pytest.mark.parametrize("driver", READINGS, ids=str)
@pytest.mark.parametrize("offset_m", [0.0, 0.016, -0.016])
def test_the_driver_s_reading_is_found_whatever_the_camera_s_offset(driver: Reading, offset_m: float) -> None:
    assert reading(published(driver, offset_m), session().scene) == driver


def test_an_effect_that_is_left_out_is_no_reading() -> None:
    views = published(Reading("rows"))
    assert reading(views, session().scene, {"z_conversion"}) == Reading()


def test_three_views_are_too_few() -> None:
    assert reading(published(Reading("rows"))[:3], session().scene) is None


def test_the_views_are_converted_back_and_each_effect_states_its_share() -> None:
    wrong = published(Reading("rows", along_ray=True))
    views, findings = converted(wrong, Reading("rows", along_ray=True), LevelLimits())
    assert [f.name for f in findings] == ["z_conversion", "radial_depth"]
    assert all(f.corrects for f in findings)
    for k, (before, after, true) in enumerate(zip(wrong, views, session().views, strict=True)):
        shares = [np.asarray(f.share)[k] for f in findings]
        np.testing.assert_allclose(after.depth, true.depth, atol=1e-6)
        np.testing.assert_allclose(before.depth - sum(shares), true.depth, atol=1e-6)
        np.testing.assert_allclose(shares[1], true.depth * (after.camera.ray_length() - 1.0), atol=1e-6)


def test_codes_of_a_millimetre_stay_known_through_the_conversion() -> None:
    coded = [replace(v, depth=(1e-3 * np.rint(1e3 * v.depth)).astype(np.float32)) for v in session().views]
    views, _ = converted(coded, Reading("columns"), LevelLimits())
    assert [v.code_m for v in views] == pytest.approx([1e-3] * len(views), rel=1e-3)
    assert all(len(np.unique(np.round(1e3 * v.depth, 3) % 1.0)) > 100 for v in views), "depth itself shows them no longer"


def test_without_a_reading_depth_is_unchanged() -> None:
    views, findings = converted(session().views, Reading(), LevelLimits())
    assert findings == []
    assert all(a is b for a, b in zip(views, session().views, strict=True))
    assert radial_to_z(views[0].camera, published(Reading(along_ray=True))[0].depth) == pytest.approx(views[0].depth, abs=1e-6)
