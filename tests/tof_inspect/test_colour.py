# SPDX-License-Identifier: Apache-2.0
"""Colour as evidence: right under any lighting, none where part and background share a colour, and reported where it is missing."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.tof_align.made import at, box, look, scene_of
from tests.tof_inspect.made import EYE, SURE, seen
from tof_core.camera import Camera
from tof_core.capture import Colour
from tof_inspect.config import InspectConfig
from tof_inspect.evidence import Ratios
from tof_inspect.judge import Inspector, PartVerdict
from tof_inspect.light import fit_light
from tof_inspect.picture import Picture, tones_of
from tof_scene.raycast import Raycaster

if TYPE_CHECKING:
    from tof_scene.scene import Scene

LENS = Camera(320, 240, 250.0, 250.0, 159.1, 120.3, frame_id="colour")
BESIDE = at(0.025, 0.0, 0.0)
PAINT = {"wall": (0.4, 0.42, 0.45), "rib": (0.5, 0.5, 0.5), "step": (0.3, 0.28, 0.25), "red": (0.4, 0.1, 0.1), "same": (0.4, 0.42, 0.45)}
OLD = np.array([1.5, 1.0, 1.5]), (0.9, 0.9, 0.9)
NEW = np.array([1.5, -1.3, 0.4]), (0.6, 0.55, 0.5)
"""Lamps: where, and how bright in red, green and blue."""


def cabinet() -> Scene:
    """A wall with a rib and a slanted step, a red part, and one in the wall's own colour."""
    fixed = (
        box("wall", (0.03, 0.6, 0.5), at(0.0, 0.0, 0.8)), box("rib", (0.05, 0.02, 0.5), at(0.03, 0.14, 0.8)),
        box("step", (0.05, 0.5, 0.05), at(0.02, 0.0, 0.66, (0.0, 0.6, 0.0))),
    )  # fmt: skip
    parts = (box("red", (0.02, 0.04, 0.04), at(0.025, -0.06, 0.84)), box("same", (0.02, 0.04, 0.04), at(0.025, 0.05, 0.80)))
    return scene_of(*fixed, *(replace(p, inspect=True) for p in parts))


def shot(scene: Scene, lamp: tuple[np.ndarray, tuple[float, float, float]], T: np.ndarray, *, shadow: float = 1.0, seed: int = 0) -> Colour:
    """A picture with shading, a shadow over its lower third, and noise."""
    rays = LENS.rays().reshape(-1, 3) @ (T @ BESIDE)[:3, :3].T
    eye = (T @ BESIDE)[:3, 3]
    hits = Raycaster(scene).cast(eye, rays)
    way = lamp[0] - (eye + rays * hits.t[:, None])
    shading = np.clip(np.einsum("ij,ij->i", way, hits.normal) / np.linalg.norm(way, axis=1), 0, None)
    shading[len(shading) * 2 // 3 :] *= shadow
    paint = np.array([PAINT[p.name] for p in scene.parts] + [(0.02, 0.02, 0.02)])[hits.part]
    light = paint * (0.3 + np.nan_to_num(shading)[:, None] * np.array(lamp[1]))
    grey = 255 * np.clip(light, 0, 1) ** (1 / 2.2) + np.random.default_rng(seed).normal(0, 1.5, light.shape)
    return Colour(np.clip(grey + 0.5, 0, 255).astype(np.uint8).reshape(*LENS.shape, 3), LENS, BESIDE)


@lru_cache(maxsize=1)
def inspector() -> Inspector:
    first = Picture.of(shot(cabinet(), OLD, look(np.array([0.56, 0.09, 0.88]), np.array([0.0, 0.0, 0.8])), seed=9), np.eye(4))
    T = look(np.array([0.56, 0.09, 0.88]), np.array([0.0, 0.0, 0.8]))
    assert first is not None
    return Inspector(Raycaster(cabinet()), InspectConfig(), first=(replace(first, T_cell_camera=T @ BESIDE),))


def judged(gone: tuple[str, ...] = (), *, shadow: float = 1.0) -> dict[str, PartVerdict]:
    built = replace(cabinet(), parts=tuple(p for p in cabinet().parts if p.name not in gone), digest="")
    view = replace(seen(built), colour=shot(built, NEW, EYE, shadow=shadow))
    found = inspector().inspect([view], [SURE])
    assert found.colour == "depth and colour (pairs of a current image with a reference image: 1)"
    return {v.name: v for v in found.verdicts}


@pytest.mark.parametrize("shadow", [1.0, 0.2])
def test_colour_is_recognised_under_other_lighting(shadow: float) -> None:
    assert judged(shadow=shadow)["red"].log_colour > 4
    assert judged(("red",), shadow=shadow)["red"].log_colour < -4


def test_one_colour_for_part_and_background_is_hardly_any_evidence() -> None:
    assert abs(judged()["same"].log_colour) < 1.5
    assert abs(judged(("same",))["same"].log_colour) < 1.5


def test_both_together_are_weighed_as_independent() -> None:
    for v in judged().values():
        assert v.log_ratio == pytest.approx(v.log_depth + v.log_colour)
        assert v.state == "present"
        assert "by depth and colour" in v.why
    for v in judged(("red", "same")).values():
        assert v.state == "absent"
        assert v.why == "the background is visible in its place, by depth and colour"


def test_colour_is_evidence_for_the_place_in_the_cad_alone() -> None:
    assert Ratios.of(2.0, 5.0) == Ratios(2.0, 5.0, 7.0)
    assert Ratios.of(-40.0, -10.0, moved=30.0) == Ratios(30.0, -10.0, 30.0)  # it moved: its old place looks as if it were gone


def test_the_simulated_change_of_lighting_is_estimated() -> None:
    first = inspector().first[0]
    now = Picture.of(
        shot(cabinet(), (OLD[0], (0.45, 0.9, 0.9)), first.T_cell_camera @ np.linalg.inv(BESIDE)),
        first.T_cell_camera @ np.linalg.inv(BESIDE),
    )
    assert now is not None
    light = fit_light(Raycaster(cabinet()), first, now, np.array([True, True, True, False, False]), InspectConfig().colour)
    assert light is not None
    change = light.change(np.array([[1.0, 0.0, 0.0]]))[0]
    lit = 0.3 + 0.85 * np.array([0.45, 0.9])  # about: ambient and the lamp at that slant
    assert change[1] == pytest.approx(np.log(lit[0] / lit[1]), abs=0.1)
    assert abs(change[2]) < 0.05


@pytest.mark.parametrize(
    ("first", "colour", "note"),
    [
        (False, True, "no reference image"),
        (True, False, "no view has a colour image"),
        (True, True, ""),
    ],
)
def test_without_colour_depth_alone_judges_and_reports_it(first: bool, colour: bool, note: str) -> None:  # noqa: FBT001
    made = Inspector(Raycaster(cabinet()), first=inspector().first if first else ())
    found = made.inspect([replace(seen(cabinet()), colour=shot(cabinet(), NEW, EYE) if colour else None)], [SURE])
    assert all(v.state == "present" for v in found.verdicts)
    if note:
        assert found.colour.startswith("depth alone: ")
        assert note in found.colour
        assert all(v.log_colour == 0.0 for v in found.verdicts)


def test_colour_can_be_switched_off() -> None:
    config = InspectConfig()
    made = Inspector(Raycaster(cabinet()), replace(config, colour=replace(config.colour, enabled=False)), first=inspector().first)
    assert "switched off" in made.inspect([replace(seen(cabinet()), colour=shot(cabinet(), NEW, EYE))], [SURE]).colour


def test_an_image_of_another_place_is_no_evidence() -> None:
    first = inspector().first[0]
    away = replace(first, T_cell_camera=look(np.array([-0.5, 0.0, 0.8]), np.array([-1.0, 0.0, 0.8])))
    made = Inspector(Raycaster(cabinet()), first=(away,))
    assert "overlap too little" in made.inspect([replace(seen(cabinet()), colour=shot(cabinet(), NEW, EYE))], [SURE]).colour


def test_a_colour_image_without_its_camera_is_no_picture() -> None:
    assert Picture.of(None, EYE) is None
    assert Picture.of(Colour(np.zeros((4, 4, 3), np.uint8)), EYE) is None


def test_saturated_pixels_have_no_tone_and_ratios_hold_at_half_the_brightness() -> None:
    grey = np.full((8, 8, 3), (160, 120, 80), np.uint8)
    half = (255 * (0.5 * (grey / 255) ** 2.2) ** (1 / 2.2)).astype(np.uint8)
    np.testing.assert_allclose(tones_of(grey)[4, 4, 1:], tones_of(half)[4, 4, 1:], atol=0.05)
    assert tones_of(grey)[4, 4, 0] - tones_of(half)[4, 4, 0] == pytest.approx(np.log(2), abs=0.08)
    grey[4, 4] = 255
    assert np.isnan(tones_of(grey)[4, 4]).all()
