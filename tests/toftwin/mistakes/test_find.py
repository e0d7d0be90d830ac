# SPDX-License-Identifier: Apache-2.0
"""Usual mistakes are named with the line to change; a session without one gets no advice. All twenty: `benchmarks --only mistakes`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from benchmarks.surprises.mistakes import TWENTY, Made, edited
from tof_align.config import AlignConfig
from tof_core.camera import Camera
from tof_core.capture import RobotPose, View
from tof_core.errors import RefusedError
from tof_core.options import BagOptions
from tof_scene.builtin import write_builtin
from tof_scene.raycast import Raycaster
from tof_scene.render import render
from tof_scene.scene_file import load_scene
from tof_virtual.plan import look_at
from toftwin.doctor.finding import Level
from toftwin.doctor.fit import examine_parts, in_words
from toftwin.mistakes.find import FITS, NOWHERE, Found, explained, find_mistake
from toftwin.mistakes.hypotheses import Mistake
from toftwin.mistakes.parts import suspicious

if TYPE_CHECKING:
    from pathlib import Path

CAMERA = Camera(width=96, height=72, fx=90.0, fy=90.0, cx=47.5, cy=35.5)
BASE_OFF = np.array([0.02, -0.015, 0.002])
"""Metres by which the robot's base is not where TF has it."""
IN_VIEWS = [m for m in TWENTY if m.scene is None]
IN_SCENE = [m for m in TWENTY if m.scene is not None]


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A built-in scene on disk."""
    return write_builtin("body_section", tmp_path_factory.mktemp("cell"))


@pytest.fixture(scope="module")
def views(scene: Path) -> list[View]:
    """Three views of it with 3 mm of noise, from a base that TF has elsewhere."""
    caster, rng, out = Raycaster(load_scene(scene)), np.random.default_rng(3), []
    for k, eye in enumerate(((1.0, -0.3, 1.1), (1.1, 0.1, 0.9), (0.9, 0.35, 1.0))):
        T = look_at(np.array(eye), np.array([0.1, 0.0, 0.8]))
        depth = (render(caster, CAMERA, T).depth + rng.normal(0, 0.003, CAMERA.shape)).astype(np.float32)
        believed = T.copy()
        believed[:3, 3] += BASE_OFF
        shape = CAMERA.shape
        robot = RobotPose(np.eye(4), believed)
        sigma, count, reason = np.full(shape, 0.003, np.float32), np.ones(shape, np.uint16), np.zeros(shape, np.uint8)
        out.append(View(k, k, CAMERA, depth, sigma, count, reason, robot))
    return out


def test_a_session_without_a_mistake_gets_no_advice(views: list[View], scene: Path) -> None:
    found = find_mistake(views, Raycaster(load_scene(scene)), BagOptions())
    assert found.fits
    assert found.mistake is None
    assert list(suspicious(load_scene(scene), scene)) == []


@pytest.mark.parametrize("made", [IN_VIEWS[0], IN_VIEWS[5], IN_VIEWS[8], IN_VIEWS[14]], ids=lambda m: m.name)
def test_a_mistake_of_the_bag_is_named(made: Made, views: list[View], scene: Path) -> None:
    found = find_mistake([made.view(v) for v in views], Raycaster(load_scene(scene)), BagOptions())
    assert not found.fits
    assert found.mistake is not None
    assert made.words in found.mistake.what
    assert found.mistake.todo
    assert found.undone > 0.7


@pytest.mark.parametrize("made", IN_SCENE, ids=lambda m: m.name)
def test_a_mistake_of_the_scene_is_named(made: Made, views: list[View], scene: Path, tmp_path: Path) -> None:
    other = write_builtin("housing", tmp_path / "other").parent
    path = edited(scene.parent, tmp_path / "edited", made, "stand", other)
    changed = load_scene(path)
    words = [f"{f.what}; {f.todo}" for f in examine_parts(changed, path) if f.level is Level.FIX]
    found = find_mistake(views, Raycaster(changed), BagOptions())
    words += [found.mistake.what] if found.mistake else ["another scene"] if found.nowhere else []
    assert any(made.words in w for w in words), words


def test_a_step_file_with_a_scale_is_named(scene: Path, tmp_path: Path) -> None:
    made = next(m for m in IN_SCENE if "0.001" in m.name)
    path = edited(scene.parent, tmp_path / "edited", made, "stand", scene.parent)
    path.write_text(path.read_text().replace("stand.stl", "stand.step"))
    small = load_scene(edited(scene.parent, tmp_path / "as_stl", made, "stand", scene.parent))
    ((must, what, todo),) = suspicious(small, path)
    assert must
    assert what.startswith("part 'stand' is 0.3 x")
    assert todo.endswith("remove its scale: STEP and GLB are read in metres")


def test_a_refusal_says_which_mistake_explains_it(views: list[View], scene: Path) -> None:
    caster = Raycaster(load_scene(scene))
    refused = RefusedError("fits nowhere", where="alignment", todo="check everything")
    turned = explained(refused, [IN_VIEWS[6].view(v) for v in views], caster, BagOptions(), AlignConfig())
    assert "fits nowhere; the image is upside down" in turned.what
    assert "of the pixels are within 15 mm of the CAD, with it " in turned.what
    assert turned.todo.startswith("let the driver publish the image as the lens sees it")
    assert explained(refused, views, caster, BagOptions(), AlignConfig()) is refused


def test_doctor_states_what_fits_means_and_which_share_is_usual() -> None:
    fits, some, nowhere = (in_words(Found(share)) for share in (FITS, 0.5 * (FITS + NOWHERE), 0.5 * NOWHERE))
    assert (fits.level, fits.what) == (Level.OK, "75 % of the measured pixels are within 15 mm of the CAD (usual: 75 % and more)")
    assert some.level is Level.NOTE
    assert some.what.startswith("55 % of the measured pixels are within 15 mm of the CAD (usual: 75 % and more): parts may be missing")
    assert "toftwin label names parts that are missing" in some.todo
    assert nowhere.level is Level.FIX
    assert "within 15 mm of the CAD (usual: 75 % and more), and no usual mistake explains it" in nowhere.what


@pytest.mark.parametrize(("metres", "limit"), [(1.0, "within 15 mm"), (0.001, "within 100 mm")])
def test_a_mistake_of_the_scenes_unit_is_judged_by_the_looser_limit(metres: float, limit: str) -> None:
    scaled = Mistake("the scene is in millimetres", "set scale: 0.001", lambda view: view, metres)
    told = in_words(Found(0.1, 1.0, scaled, 0.9))
    assert told.level is Level.FIX
    assert f"90 % {limit} of the CAD without a mistake: the scene is in millimetres" in told.what
