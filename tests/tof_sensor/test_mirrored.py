# SPDX-License-Identifier: Apache-2.0
"""What a lacquered part mirrors: the path of the mirror image, Fresnel's share of its light, and nothing where no lamp reaches."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from tof_core.camera import Camera
from tof_scene.raycast import Raycaster
from tof_scene.render import Rendering, render
from tof_scene.scene import Material, Part, Scene
from tof_sensor.effects.specular import Specular
from tof_sensor.frame import LIGHT_M_PER_S, Context, Frame, ideal_frame
from tof_sensor.mirrored import mirrored_light, schlick

if TYPE_CHECKING:
    from numpy.typing import NDArray

CAMERA = Camera(48, 36, 40.0, 40.0, 23.5, 17.5)
DEPTH, HEIGHT = 1.0, 0.3
"""Metres from the lens to the wall ahead, and to the floor below (y is down)."""
WALL, FLOOR = 0, 1
WAVES = 2 * np.pi * 60e6 / LIGHT_M_PER_S


def board(name: str, corners: list[list[float]], albedo: float) -> Part:
    return Part(name, np.array(corners), np.array([[0, 1, 2], [0, 2, 3]], np.int32), Material(albedo=albedo))


def corner(*more: Part) -> Frame:
    """A wall ahead and a floor below that meet at a right angle."""
    wall = board("wall", [[-3, -3, DEPTH], [-3, HEIGHT, DEPTH], [3, HEIGHT, DEPTH], [3, -3, DEPTH]], 0.8)
    floor = board("floor", [[-3, HEIGHT, 0.1], [3, HEIGHT, 0.1], [3, HEIGHT, DEPTH], [-3, HEIGHT, DEPTH]], 0.4)
    caster = Raycaster(Scene("cell", (wall, floor, *more)))
    return ideal_frame(rendering(caster), Context(caster=caster))


def rendering(caster: Raycaster) -> Rendering:
    return render(caster, CAMERA, np.eye(4), footprints=False)


def mirrored_phasor(frame: Frame, part: int) -> NDArray[np.complex128]:
    """(H, W) light reflected by a part relative to its matt light; 0 elsewhere."""
    out, found = np.zeros(frame.depth.size, complex), mirrored_light(frame, part)
    out[found.pixels] = found.phasor(WAVES)
    return out.reshape(frame.depth.shape)


def test_a_lacquer_reflects_a_twenty_fifth_straight_on_and_all_at_grazing_incidence() -> None:
    assert schlick(np.array([1.0, 0.5, 0.0])) == pytest.approx([0.04, 0.07, 1.0])


def test_light_and_path_are_those_of_the_mirror_image() -> None:
    """The floor shows the wall as if the lens stood as far below the floor as it stands above."""
    frame = corner()
    phasor = mirrored_phasor(frame, FLOOR)
    here = frame.rendering.part == FLOOR
    p = frame.points[here]
    image = np.array([0.0, 2 * HEIGHT, 0.0])
    q = image + (p - image) * (DEPTH / p[:, 2:])
    near, far, whole = (np.linalg.norm(a, axis=1) for a in (p, q, q - image))
    cosine = HEIGHT / near
    share = schlick(cosine) * (0.8 * DEPTH / far**3) / (0.4 * cosine / near**2)
    np.testing.assert_allclose(phasor[here], share * np.exp(1j * WAVES * (far + whole - 2 * near)), rtol=1e-3)
    assert not phasor[~here].any()


def test_what_the_lamp_does_not_reach_is_not_mirrored() -> None:
    above = 0.15
    screen = board("screen", [[-3, -3, 0.5], [-3, above, 0.5], [3, above, 0.5], [3, -3, 0.5]], 0.5)
    v, u = 30, 24
    assert abs(mirrored_phasor(corner(), FLOOR)[v, u]) > 0.05
    screened = corner(screen)
    assert screened.rendering.part[v, u] == FLOOR
    assert mirrored_phasor(screened, FLOOR)[v, u] == 0, "the foot of the wall lies in the screen's shadow"


def test_a_coat_makes_the_floor_before_a_wall_farther_and_one_on_all_parts_mirrors_nothing() -> None:
    frame = corner()
    bias = Specular(coat=1.0, part=FLOOR).bias(frame)
    here = frame.rendering.part == FLOOR
    assert (bias[here] > 0).all()
    assert bias[here].max() > 5e-3
    assert not bias[~here].any()
    assert not Specular(coat=1.0).bias(frame).any()
