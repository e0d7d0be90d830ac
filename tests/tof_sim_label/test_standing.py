# SPDX-License-Identifier: Apache-2.0
"""A part is confirmed or contradicted by the pixels of the last accepted views."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.tof_sim_label.test_label import POSED, caster, plane_depth, seen
from tof_sim_label.label import label_view
from tof_sim_label.standing import VIEWS, Standing, Standings

if TYPE_CHECKING:
    from tof_scene.raycast import Raycaster

__all__ = ["caster"]
PLATE, CLIP = 0, 1


def standings(raycaster: Raycaster, clip: list[str]) -> dict[int, Standing]:
    """After views in each of which the clip is `there` or `gone`, or of which the pose is `refused`."""
    out = Standings(2)
    for how in clip:
        view, first = seen(raycaster)
        on_clip = first.part == CLIP
        if how == "gone":
            view.depth[on_clip] = plane_depth(1.0)[on_clip]
        label = label_view(view, replace(POSED, accepted=how != "refused"), raycaster)
        out.add(view, label)
    return out.all()


@pytest.mark.parametrize(
    ("clip", "standing"),
    [
        (["there"], Standing.CONFIRMED),
        (["gone"], Standing.CONTRADICTED),
        (["gone", "there", "there"], Standing.PARTLY),
        (["refused"], Standing.REFUSED),
        (["refused", "there"], Standing.CONFIRMED),
        (["there", "refused"], Standing.CONFIRMED),
        (["there"] * 2 * VIEWS + ["gone"] * VIEWS, Standing.CONTRADICTED),
    ],
)
def test_a_part_stands_as_the_last_views_measure_it(caster: Raycaster, clip: list[str], standing: Standing) -> None:
    found = standings(caster, clip)
    assert found[CLIP] == standing
    assert found[PLATE] == (Standing.REFUSED if set(clip) == {"refused"} else Standing.CONFIRMED)


def test_of_a_part_that_no_view_measured_nothing_is_said(caster: Raycaster) -> None:
    view, label = seen(caster)
    view.depth[label.part == CLIP] = np.nan
    found = Standings(2)
    found.add(view, label)
    assert found.all() == {PLATE: Standing.CONFIRMED}
    assert Standings(2).all() == {}
