# SPDX-License-Identifier: Apache-2.0
"""Verdicts on parts: present, absent, displaced, not observable."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.tof_inspect.made import SURE, as_built, plate, seen
from tof_core.errors import RefusedError, SceneError
from tof_inspect.config import InspectConfig
from tof_inspect.judge import Inspector, PartVerdict
from tof_scene.raycast import Raycaster

if TYPE_CHECKING:
    from tof_core.capture import View


@lru_cache(maxsize=1)
def inspector() -> Inspector:
    return Inspector(Raycaster(plate()), InspectConfig())


def verdicts(view: View) -> dict[str, PartVerdict]:
    return {v.name: v for v in inspector().inspect([view], [SURE]).verdicts}


def test_parts_that_are_there_are_present() -> None:
    verdict_of = verdicts(seen(plate()))
    for name in ("clip", "block"):
        assert verdict_of[name].state == "present"
        assert verdict_of[name].probability > 0.999
        assert verdict_of[name].displaced_mm < 1.0


def test_parts_that_are_gone_are_absent() -> None:
    verdict_of = verdicts(seen(as_built(plate(), gone=("clip", "block", "buried"))))
    for name in ("clip", "block"):
        assert verdict_of[name].state == "absent"
        assert verdict_of[name].probability < 0.001


@pytest.mark.parametrize("mm", [(6.0, 0.0, 0.0), (0.0, 8.0, 0.0), (0.0, -5.0, 6.0)])
def test_a_displaced_part_is_found_with_how_far_it_moved(mm: tuple[float, float, float]) -> None:
    verdict_of = verdicts(seen(as_built(plate(), moved={"block": mm, "buried": mm})))["block"]
    assert verdict_of.state == "displaced"
    assert abs(verdict_of.displaced_mm - np.linalg.norm(mm)) < 3 * verdict_of.std_mm
    assert verdict_of.std_mm < 2.0


def test_a_part_within_its_tolerance_is_present() -> None:
    verdict_of = verdicts(seen(as_built(plate(), moved={"block": (0.5, 0.5, 0.0), "buried": (0.5, 0.5, 0.0)})))["block"]
    assert verdict_of.state == "present"
    assert 0.2 < verdict_of.displaced_mm < 1.5


def test_what_cannot_be_seen_is_not_observable_and_never_absent() -> None:
    for built in (plate(), as_built(plate(), gone=("shim", "speck", "behind", "buried"))):
        verdict_of = verdicts(seen(built))
        assert "behind or inside" in verdict_of["behind"].why
        assert "valid and distinctive" in verdict_of["speck"].why
        for name in ("shim", "speck", "behind", "buried"):
            assert verdict_of[name].state == "not_observable", name


def test_thirty_distinctive_pixels_make_a_part_observable_and_fewer_do_not() -> None:
    view = seen(plate())
    whole = verdicts(view)["clip"].pixels
    covered = np.abs(view.depth - seen(as_built(plate(), gone=("clip",))).depth) > 4e-3
    rows, cols = np.nonzero(covered)
    for left, state in ((40, "present"), (12, "not_observable")):
        depth = view.depth.copy()
        clip = cols < 70
        drop = np.flatnonzero(clip)[left:]
        depth[rows[drop], cols[drop]] = np.nan
        verdict_of = verdicts(replace(view, depth=depth))["clip"]
        assert verdict_of.pixels <= whole
        assert verdict_of.state == state, (left, verdict_of.pixels)


def test_one_reflection_does_not_decide() -> None:
    view = seen(plate())
    depth = view.depth.copy()
    depth[np.random.default_rng(3).random(depth.shape) < 0.05] = 3.0
    verdict_of = verdicts(replace(view, depth=depth))
    assert verdict_of["clip"].state == "present"
    assert verdict_of["block"].state == "present"


def test_views_are_weighed_together() -> None:
    one = inspector().inspect([seen(plate())], [SURE]).verdicts[0]
    two = inspector().inspect([seen(plate(), seed=k) for k in range(2)], [SURE, SURE]).verdicts[0]
    assert two.pixels > 1.8 * one.pixels
    assert two.log_depth > 1.5 * one.log_depth


def test_no_accepted_pose_and_no_part_to_inspect_are_refused() -> None:
    with pytest.raises(RefusedError, match="no view has an accepted pose"):
        inspector().inspect([seen(plate())], [replace(SURE, accepted=False)])
    scene = plate()
    bare = replace(scene, parts=tuple(replace(p, inspect=False) for p in scene.parts), digest="")
    with pytest.raises(SceneError, match="inspect: true"):
        Inspector(Raycaster(bare), InspectConfig())
