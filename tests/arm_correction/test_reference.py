# SPDX-License-Identifier: Apache-2.0
"""The reference on disk, and its refusal for another camera."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from arm_correction.reference import Reference, capture_reference, load_reference, save_reference
from tests.arm_correction.made import CAMERA, CONFIG, FIRST, reference, seen
from tests.tof_align.made import section
from tof_core.capture import Colour
from tof_core.errors import RefusedError, UsageError

if TYPE_CHECKING:
    from pathlib import Path


def test_a_reference_comes_back_as_it_was(tmp_path: Path) -> None:
    image = np.arange(120 * 160 * 3, dtype=np.uint32).astype(np.uint8).reshape(120, 160, 3)
    colour = Colour(image, replace(CAMERA, fx=170.0), FIRST, 1)
    kept = replace(reference(section()), colour=colour, T_cell_camera=FIRST, scene="abc")
    back = load_reference(save_reference(kept, tmp_path / "first"))
    assert isinstance(back, Reference)
    assert back.camera == kept.camera
    assert (back.stamp_ns, back.scene) == (kept.stamp_ns, "abc")
    for name in ("depth", "sigma", "region", "T_cell_body", "T_body_camera", "T_cell_camera"):
        np.testing.assert_allclose(getattr(back, name), getattr(kept, name), atol=1e-12)
    assert back.colour is not None
    np.testing.assert_array_equal(back.colour.image, image)
    assert back.colour.camera == colour.camera
    assert back.colour.T_camera_colour is not None
    np.testing.assert_allclose(back.colour.T_camera_colour, FIRST, atol=1e-12)


def test_a_reference_without_colour_is_one_too(tmp_path: Path) -> None:
    assert load_reference(save_reference(reference(section()), tmp_path / "first")).colour is None


def test_another_camera_size_and_scene_are_refused() -> None:
    kept = replace(reference(section()), scene="abc")
    view = seen(section(), FIRST)
    kept.check(view, "abc")
    with pytest.raises(RefusedError, match="160x120"):
        kept.check(replace(view, camera=replace(CAMERA, width=224, height=171)))
    with pytest.raises(RefusedError, match="another camera"):
        kept.check(replace(view, camera=replace(CAMERA, fx=160.0)))
    with pytest.raises(RefusedError, match="another scene"):
        kept.check(view, "xyz")


def test_a_damaged_or_missing_reference_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="no such reference"):
        load_reference(tmp_path / "none")
    path = save_reference(reference(section()), tmp_path / "first")
    path.with_suffix(".npz").write_bytes(path.with_suffix(".npz").read_bytes()[:200])
    with pytest.raises(RefusedError, match="cannot be read"):
        load_reference(path)
    path.write_text('{"schema": "other"}')
    with pytest.raises(RefusedError):
        load_reference(path)


def test_a_region_without_depth_is_no_reference() -> None:
    view = seen(section(), FIRST)
    with pytest.raises(RefusedError, match="pixels of the region"):
        capture_reference(view, CONFIG.weights, region=np.zeros(view.depth.shape, bool))
    with pytest.raises(UsageError, match="region is"):
        capture_reference(view, CONFIG.weights, region=np.ones((3, 3), bool))


@pytest.mark.parametrize(
    ("changes", "same"),
    [
        ({"fx": 150.14}, True),
        ({"fx": 150.5}, False),
        ({"fy": 149.5}, False),
        ({"cx": 79.3}, True),
        ({"cx": 80.0}, False),
        ({"cy": 60.0}, False),
        ({"distortion": (0.0, 0.0, 0.0, 0.0, 0.0)}, True),
        ({"distortion": (0.0, 0.0, 9e-5, 0.0, 0.0)}, True),
        ({"distortion": (0.0, 0.0, 2e-4, 0.0, 0.0)}, False),
        ({"height": 119}, False),
    ],
)
def test_a_camera_is_the_same_within_a_thousandth_and_a_fifth_of_a_pixel(changes: dict[str, Any], *, same: bool) -> None:
    kept, view = reference(section()), seen(section(), FIRST)
    view = replace(view, camera=replace(CAMERA, **changes))
    if same:
        kept.check(view)
    else:
        with pytest.raises(RefusedError, match=r"another camera|the view 160x119"):
            kept.check(view)


@pytest.mark.parametrize(
    ("mine", "its", "fits"), [("abc", "abc", True), ("abc", "", True), ("", "abc", True), ("", "", True), ("abc", "xyz", False)]
)
def test_a_scene_without_a_digest_fits_any(mine: str, its: str, *, fits: bool) -> None:
    kept = replace(reference(section()), scene=mine)
    if fits:
        kept.check_scene(its)
    else:
        with pytest.raises(RefusedError, match="another scene"):
            kept.check_scene(its)
