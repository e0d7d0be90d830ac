# SPDX-License-Identifier: Apache-2.0
"""The doctor before a folder of PNG pairs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np
import pytest

from tof_core.camera import Camera
from tof_core.image_folder import write_camera
from tof_core.options import BagOptions
from toftwin.doctor.finding import Level
from toftwin.doctor.png_pairs import examine_png_pairs

if TYPE_CHECKING:
    from pathlib import Path

    from toftwin.doctor.finding import Finding

CAMERA = Camera(width=64, height=48, fx=60.0, fy=60.0, cx=31.5, cy=23.5)


def pairs(folder: Path, count: int, *, infrared: bool = True, over_exposed: float = 0.0, factor: int = 1) -> dict[str, Finding]:
    """Findings about a wall at a metre; over_exposed: share of the rows without depth and with the largest amplitude."""
    write_camera(CAMERA, folder / "camera.yaml")
    depth, light = (np.full(CAMERA.shape, value, np.uint16) for value in (1000 * factor, 800))
    rows = round(over_exposed * CAMERA.height)
    depth[:rows], light[:rows] = 0, 65535
    for k in range(count):
        cv2.imwrite(str(folder / f"depth_{k}.png"), depth)
        if infrared:
            cv2.imwrite(str(folder / f"ir_{k}.png"), light)
    return {f.check: f for f in examine_png_pairs(folder, BagOptions())}


def test_a_good_folder_has_nothing_to_fix(tmp_path: Path) -> None:
    found = pairs(tmp_path, 12)
    assert found["PNG pairs"].what.startswith("12 depth images, 12 with an amplitude image")
    assert Level.FIX not in {f.level for f in found.values()}
    assert "exposure" not in found


@pytest.mark.parametrize(("share", "stated"), [(0.04, False), (0.5, True)])
def test_over_exposed_pixels_ask_for_less_light(tmp_path: Path, share: float, *, stated: bool) -> None:
    found = pairs(tmp_path, 12, over_exposed=share)
    assert ("exposure" in found) is stated
    assert not stated or found["exposure"].what.startswith("50 % of the pixels have no depth")


def test_few_pairs_are_worth_knowing(tmp_path: Path) -> None:
    assert pairs(tmp_path, 4)["PNG pairs"].level is Level.NOTE


def test_without_infrared_no_board_can_be_found(tmp_path: Path) -> None:
    assert pairs(tmp_path, 4, infrared=False)["PNG pairs"].level is Level.FIX


def test_a_wrong_unit_is_stated(tmp_path: Path) -> None:
    assert "--depth-scale" in pairs(tmp_path, 12, factor=50)["depth"].todo


def test_a_camera_file_that_lacks_values_is_the_finding(tmp_path: Path) -> None:
    pairs(tmp_path, 1)
    (tmp_path / "camera.yaml").write_text("image_width: 64\n")
    (found,) = examine_png_pairs(tmp_path, BagOptions())
    assert (found.check, found.level) == ("PNG pairs", Level.FIX)
