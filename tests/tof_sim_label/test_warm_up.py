# SPDX-License-Identifier: Apache-2.0
"""Warming up labels one small view of any scene, and never fails."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.tof_align.made import box, scene_of
from tof_scene.raycast import Raycaster
from tof_sim_label.stream import Labelled, LabelStream, warm_up

if TYPE_CHECKING:
    from tof_scene.scene import Scene


@pytest.mark.parametrize(
    "scene", [scene_of(box("box", (0.4, 0.5, 0.3), np.eye(4))), scene_of(box("speck", (1e-3, 1e-3, 1e-3), np.eye(4)))], ids=["box", "speck"]
)
def test_warm_up_works_for_any_scene(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    flush, seen = LabelStream.flush, list[Labelled]()

    def noted(stream: LabelStream) -> None:
        labelled = flush(stream)
        assert labelled is not None
        seen.append(labelled)

    monkeypatch.setattr(LabelStream, "flush", noted)
    warm_up(Raycaster(scene))
    assert len(seen) == 1
    assert int(np.isfinite(seen[0].view.depth).sum()) > 100
