# SPDX-License-Identifier: Apache-2.0
"""Starts from far: hidden points are no contradiction, and the CAD reaches beyond the reference."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from arm_correction.corrector import Corrector
from arm_correction.first import First, widened
from arm_correction.match import make_matcher, reference_surface
from arm_correction.register import judge
from benchmarks.closed_loop import close_loop
from tests.arm_correction.made import CAMERA, CONFIG, FIRST, reference, seen, twist
from tests.tof_align.made import foreign, section
from tof_core import se3

if TYPE_CHECKING:
    from tof_core.capture import View

SCENE = foreign()
AWAY = twist((150, 60, -80), (4, 11, -5))
ONLY = np.broadcast_to(np.abs(np.arange(CAMERA.width) - 80) < 9, CAMERA.shape)
"""Region of interest of the reference: too small for a registration."""


def test_points_hidden_from_the_reference_are_no_contradiction() -> None:
    motion = twist((-250, 120, 60), (-9, 11, 5))
    matcher = make_matcher(reference_surface(reference(SCENE), CONFIG), seen(SCENE, FIRST @ motion, believed=FIRST), CONFIG)
    truth = judge(matcher, motion, 0.0, far=True)
    e = matcher.linearise(motion)[0]
    assert (e < -0.025).mean() > 0.02  # surfaces that a box in front hid from the first camera
    assert truth.support > 0.97
    nearer = judge(matcher, motion @ twist((0, 0, -60)), 0.0, far=True)
    assert nearer.support < 0.5  # but what stands before a surface that was seen is one


def test_the_wider_camera_has_the_same_pixels_in_its_middle() -> None:
    wide = widened(CAMERA)
    np.testing.assert_allclose(wide.rays()[60:180, 80:240], CAMERA.rays(), atol=1e-12)


def test_the_cad_leads_back_where_the_reference_alone_cannot() -> None:
    kept = replace(reference(SCENE), T_cell_camera=FIRST, region=ONLY)
    view = seen(SCENE, FIRST @ AWAY, believed=FIRST)
    alone = First.of(kept, CONFIG).register(view, CONFIG)
    assert not alone.accepted
    found = First.of(kept, CONFIG, SCENE).register(view, CONFIG)
    assert found.accepted, found.reason
    assert found.by == "cad"
    metres, degrees = se3.distance(found.T_reference_now, AWAY)
    assert 1e3 * metres < 3.0
    assert degrees < 0.3
    assert Corrector(CONFIG, caster=SCENE, reference=kept).propose([view])["reference"].by == "cad"


def test_without_a_pose_by_cad_there_is_nothing_wider() -> None:
    assert First.of(reference(SCENE), CONFIG, SCENE).wide is None


def test_the_reference_decides_in_the_end() -> None:
    """An arm that never comes near enough for the two images to overlap is not reported as done, whatever the result by the CAD."""
    kept = replace(reference(SCENE), T_cell_camera=FIRST, region=ONLY)

    class Stuck:
        def goto(self, T_body_hand: np.ndarray) -> None:
            pass

    def look() -> View:
        return seen(SCENE, FIRST @ AWAY, believed=FIRST)

    ended = close_loop(Stuck(), look, First.of(kept, CONFIG, SCENE), CONFIG, np.eye(4))
    assert not ended.done
    assert ended.reason == "moves used up"


def test_an_empty_view_ends_the_loop_in_one_line() -> None:
    away = FIRST.copy()
    away[:3, :3] = away[:3, :3] @ se3.so3_exp([0, np.pi, 0])
    ended = close_loop(None, lambda: seen(section(), away), First.of(reference(section()), CONFIG), CONFIG, np.eye(4))  # type: ignore[arg-type]
    assert not ended.done
    assert ended.moves == 0
    assert "empty view" in ended.reason


def test_rivals_are_compared_without_their_neutral_points() -> None:
    """Points outside the reference cost the same for every solution; they must not make a clear solution ambiguous."""
    kept = replace(reference(SCENE), region=ONLY)
    loose = replace(CONFIG, trust=replace(CONFIG.trust, min_overlap=0.05))
    matcher = make_matcher(reference_surface(kept, loose), seen(SCENE, FIRST, believed=FIRST), loose)
    rival = twist((0, 0, 20))
    scores = matcher.misfits(np.array([np.eye(4), rival]))
    assert scores[1] < 2 * scores[0]
    assert matcher.rivalry(np.eye(4), np.array([np.eye(4), rival])) > 2.5
    assert matcher.rivalry(AWAY, AWAY[None]) == np.inf
