# SPDX-License-Identifier: Apache-2.0
"""What a diagnosis notes about the depth of a recording."""

from __future__ import annotations

import numpy as np
import pytest

from tests.tof_gap.quiet_views import views
from toftwin.diagnosis import notes_on


@pytest.mark.parametrize(("topic", "notes"), [("/hand/depth/image_raw", 0), ("/hand/aligned_depth_to_color/image_raw", 1)])
def test_depth_registered_to_another_camera_is_noted_with_what_to_record(topic: str, notes: int) -> None:
    found = notes_on([v.view for v in views(np.random.default_rng(1))], topic)
    assert len(found) == notes
    assert all("registered to another camera. On slopes depth is off" in note.what for note in found)
    assert all(note.todo == "Record the depth camera's own image with its camera_info." for note in found)
