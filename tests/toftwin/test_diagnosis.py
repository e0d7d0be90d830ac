# SPDX-License-Identifier: Apache-2.0
"""What a diagnosis notes about the depth of a recording."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.tof_gap.quiet_views import SHAPE, views
from tof_gap.seen.evidence.rectified import rounded_mm
from toftwin.diagnosis import notes_on, notes_on_rays


@pytest.mark.parametrize(("topic", "notes"), [("/hand/depth/image_raw", 0), ("/hand/aligned_depth_to_color/image_raw", 1)])
def test_depth_registered_to_another_camera_is_noted_with_what_to_record(topic: str, notes: int) -> None:
    found = notes_on([v.view for v in views(np.random.default_rng(1))], topic)
    assert len(found) == notes
    assert all("registered to another camera. On slopes depth is off" in note.what for note in found)
    assert all(note.todo == "Record the depth camera's own image with its camera_info." for note in found)


def test_depth_rectified_by_the_nearest_pixel_is_noted_with_its_size() -> None:
    evidence = views(np.random.default_rng(1))
    assert notes_on_rays(evidence) == ()
    shifted = [replace(v, view=replace(v.view, ray_shift=np.full((*SHAPE, 2), 0.3, np.float32))) for v in evidence]
    (note,) = notes_on_rays(shifted)
    assert f"a ray up to half a pixel beside it: {rounded_mm(shifted):.1f} mm RMS on slopes" in note.what
    assert note.todo.startswith("Have the driver interpolate between pixels of one surface")
