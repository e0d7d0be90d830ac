# SPDX-License-Identifier: Apache-2.0
"""Parts that a diagnosis finds elsewhere: which of them labels follow, where they stand, how sure that is."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from tests.tof_align.made import at, box, scene_of
from tof_core.capture import Posed
from tof_gap.solved import Named
from tof_scene.raycast import Raycaster
from tof_sensor.effects.cad_deviation import CadDeviation
from tof_sensor.effects.range_offset import RangeOffset
from toftwin.cameras import Cameras
from toftwin.displaced import Displaced, as_found, displaced_parts, in_words, unsure_of

SCENE = scene_of(box("wall", (2.0, 2.0, 0.1), at(0.0, 0.0, 2.0)), box("block", (0.4, 0.4, 0.4), at(0.0, 0.0, 1.2)))
NEARER = CadDeviation(values=(0.0, 0.0, -0.006, *[0.0] * 6), part=1, centre=(0.0, 0.0, 1.2), half_size_m=0.2)
SURE = Named("cad_deviation", (NEARER,), ({},), (), 1.0)


def test_only_parts_that_the_diagnosis_asserts_alone_are_followed() -> None:
    verdict = ("cad_deviation", "range_offset")
    offset = Named("range_offset", (RangeOffset(),), ({},), (), 1.0)
    assert displaced_parts(verdict, [replace(SURE, confidence=0.9), offset]) == (Displaced(NEARER, 0.9),)
    assert (
        displaced_parts(verdict, [replace(SURE, ties=("subsurface",))]) == displaced_parts(verdict, [replace(SURE, suspected=True)]) == ()
    )
    assert displaced_parts((*verdict, "unknown"), [SURE]) == ()


def test_rays_meet_the_part_where_it_stands() -> None:
    caster = Cameras([], (Displaced(NEARER, 1.0),)).caster(Raycaster(SCENE))
    t = caster.cast(np.zeros((2, 3)), np.array([[0.0, 0.0, 1.0], [0.4, 0.0, 1.0]])).t
    np.testing.assert_allclose(t, [1.0 - 0.006, 1.95], atol=1e-6)
    assert as_found(SCENE, ()) is SCENE
    plain = Raycaster(SCENE)
    assert Cameras([]).caster(plain) is plain


def test_a_part_is_off_by_its_motion_along_the_normal_over_its_whole_surface() -> None:
    """Of the six equal faces of a cube, two move along their normals."""
    assert Displaced(NEARER, 1.0).off_m(SCENE.parts[1]) == pytest.approx(0.006 / np.sqrt(3))
    assert in_words(SCENE, [Displaced(NEARER, 1.0)]).endswith(": block 3.5 mm")
    assert in_words(SCENE, []) == ""


def test_a_bow_bends_the_middle_of_large_faces() -> None:
    """The face towards the camera bows by 4 mm at half a size from its middle, towards the camera (normal -z); its corners move by it."""
    bow = replace(NEARER, values=(*[0.0] * 6, 0.004, 0.004, 0.0), normal=(0.0, 0.0, -1.0))
    caster = Cameras([], (Displaced(bow, 1.0),)).caster(Raycaster(SCENE))
    x = np.array([0.0, 0.1, 0.19])
    t = caster.cast(np.stack([x, x, np.zeros(3)], axis=1), np.tile([0.0, 0.0, 1.0], (3, 1))).t
    np.testing.assert_allclose(t, 1.0 - 0.004 * 2 * (x / 0.2) ** 2, atol=0.004 / 16)


@pytest.mark.parametrize(("confidence", "share"), [(1.0, 0.15), (0.9, np.sqrt(0.15**2 + 0.09)), (0.5, np.sqrt(0.15**2 + 0.25))])
def test_its_place_is_as_uncertain_as_its_shape_and_its_name(confidence: float, share: float) -> None:
    found = Displaced(NEARER, confidence)
    off = found.off_m(SCENE.parts[1])
    assert found.sigma_m(SCENE.parts[1]) == pytest.approx(share * off)
    solved = [Posed(np.eye(4), np.eye(6), parts=np.array([0.001, 0.002])), Posed(np.eye(4), np.eye(6))]
    both, alone = unsure_of(solved, SCENE, [found])
    np.testing.assert_allclose(both.parts, [0.001, np.hypot(0.002, share * off)])
    np.testing.assert_allclose(alone.parts, [0.0, share * off])
    assert unsure_of(solved, SCENE, []) == solved


def test_a_displaced_part_survives_the_file_of_an_interrupted_run() -> None:
    found = Displaced(NEARER, 0.93)
    assert Displaced.from_dict(json.loads(json.dumps(found.to_dict()))) == found
