# SPDX-License-Identifier: Apache-2.0
"""scene.yaml: every allowed key, and one line of error with file and line number for everything else."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.tof_scene.solids import block
from tests.tof_scene.step import box_step
from tof_core.errors import SceneError
from tof_scene.builtin import make_builtin, open_scene, write_builtin
from tof_scene.scene import Material, Part, Scene
from tof_scene.scene_file import load_scene, save_scene, stl_bytes

if TYPE_CHECKING:
    from pathlib import Path

CUBE = Part("cube", *block(0.1, 0.2, 0.3, (0.2, 0.2, 0.2)))
HEAD = "frame: cell\nparts:\n"


def write(folder: Path, text: str, mesh: bytes | None = None) -> Path:
    (folder / "cube.stl").write_bytes(stl_bytes(CUBE) if mesh is None else mesh)
    (folder / "scene.yaml").write_text(text)
    return folder / "scene.yaml"


def refusal(path: Path) -> str:
    with pytest.raises(SceneError) as caught:
        load_scene(path)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_every_key_of_a_part_is_read(tmp_path: Path) -> None:
    path = write(
        tmp_path,
        """
frame: line_3
placed_in: {frame: odom, pose: [1, 2, 3, 0, 0, 0.7071068, 0.7071068]}
parts:
- name: a
  mesh: cube.stl
  scale: 0.5
  pose: [10, 0, 0, 0, 0, 1, 0]
  material: {albedo: 0.8, roughness: 0.3}
  inspect: true
  tolerance_mm: 0.4
- {name: b, mesh: cube.stl, pose: [[1, 0, 0, 5], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}
- {name: c, mesh: cube.stl, pose: {xyz: [0, 0, 7]}}
""",
    )
    scene = load_scene(path)
    a, b, c = scene.parts
    assert (scene.frame, scene.names, scene.folder) == ("line_3", ("a", "b", "c"), tmp_path)
    assert scene.placed_in is not None
    assert scene.placed_in.frame == "odom"
    assert np.allclose(scene.placed_in.T_frame_cell @ [1, 0, 0, 1], [1, 3, 3, 1], atol=1e-6)
    assert a.vertices.mean(axis=0) == pytest.approx([10 - 0.05, -0.1, 0.15], abs=1e-6)
    assert (a.material, a.inspect, a.tolerance_mm) == (Material(0.8, 0.3), True, 0.4)
    assert (b.material, b.inspect, b.tolerance_mm) == (Material(0.5, 1.0), False, 1.0)
    assert b.vertices.mean(axis=0) == pytest.approx([5.1, 0.2, 0.3], abs=1e-6)
    assert c.vertices.mean(axis=0) == pytest.approx([0.1, 0.2, 7.3], abs=1e-6)


@pytest.mark.parametrize(("text", "line", "what"), [
    ("frame: cell\nmeshes: []\nparts: []\n", 2, "unknown key 'meshes'"),
    (HEAD + "- name: a\n  mesh: cube.stl\n  colour: red\n", 5, "unknown key 'colour'"),
    (HEAD + "- name: a\n  mesh: cube.stl\n  material:\n    albedo: 0.5\n    gloss: 1\n", 7, "unknown key 'gloss'"),
    (HEAD + "- name: a\n", 3, "the key 'mesh' is missing"),
    (HEAD + "- name: a\n  mesh: cube.stl\n  material: {albedo: 1.5}\n", 5, "albedo must be a number from 0 to 1, not 1.5"),
    (HEAD + "- name: a\n  mesh: cube.stl\n  scale: -1\n", 5, "scale must be a number above 0, not -1"),
    (HEAD + "- name: a\n  mesh: cube.stl\n  inspect: maybe\n", 5, "inspect must be true or false, not 'maybe'"),
    (HEAD + "- name: a\n  mesh: cube.stl\n  pose: [0, 0, 0]\n", 5, "pose must be 7 numbers"),
    (HEAD + "- name: a\n  mesh: cube.stl\n  pose: [0, 0, 0, 0, 0, 0, 0]\n", 5, "has no direction"),
    (HEAD + "- name: a\n  mesh: cube.stl\n  pose: [[2,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]\n", 5, "is no rigid motion"),
    (HEAD + "- name: a\n  mesh: ../cube.stl\n", 4, "lies outside the scene's folder"),
    (HEAD + "- name: a\n  mesh: cube.stl\n  scale: 1000\n", 4, "seems to be in millimetres; set scale: 0.001"),
    (HEAD + "- name: a\n  mesh: cube.stl\n  scale: 40\n  inspect: true\n", 4, "set scale: 0.001"),
    (HEAD + "- name: a\n  mesh: cube.stl\n  scale: 0.0001\n", 4, "is only 0.02 mm long"),
    ("frame: cell\nparts: {a: 1}\n", 2, "parts must be a list"),
    ("frame: 3\nparts: [{name: a, mesh: cube.stl}]\n", 1, "frame must be a text"),
    ("frame: cell\nframe: cell\n", 2, "given twice"),
    ("frame: [\n", 2, "is no valid YAML"),
    ("frame: !!python/object/apply:os.system [ls]\n", 1, "is no valid YAML"),
])  # fmt: skip
def test_each_mistake_is_one_line_that_names_file_and_line(tmp_path: Path, text: str, line: int, what: str) -> None:
    message = refusal(write(tmp_path, text))
    assert what in message
    assert f"scene.yaml:{line}" in message


@pytest.mark.parametrize(
    ("mesh", "what"),
    [
        (b"", "a file of 0 bytes"),
        (b"solid nothing\nendsolid nothing\n", "cube.stl"),
        (stl_bytes(CUBE)[:-30], "cube.stl: the mesh"),
        (stl_bytes(CUBE).replace(np.float32(0.2).tobytes(), np.float32(np.nan).tobytes()), "NaN or infinite"),
    ],
)
def test_meshes_that_no_ray_can_hit_are_refused(tmp_path: Path, mesh: bytes, what: str) -> None:
    assert what in refusal(write(tmp_path, HEAD + "- {name: a, mesh: cube.stl}\n", mesh))


def test_a_missing_scene_and_a_missing_mesh_are_named(tmp_path: Path) -> None:
    assert "scene.yaml" in refusal(tmp_path)
    assert "no.stl: the mesh is missing" in refusal(write(tmp_path, HEAD + "- {name: a, mesh: no.stl}\n"))


def test_a_link_out_of_the_folder_is_followed_and_refused(tmp_path: Path) -> None:
    inside = tmp_path / "scene"
    inside.mkdir()
    (tmp_path / "far.stl").write_bytes(stl_bytes(CUBE))
    write(inside, HEAD + "- {name: a, mesh: near.stl}\n")
    (inside / "near.stl").symlink_to(tmp_path / "far.stl")
    assert "lies outside the scene's folder" in refusal(inside)


def test_names_used_twice_and_scenes_without_parts_are_refused(tmp_path: Path) -> None:
    assert "two parts are called 'a'" in refusal(write(tmp_path, HEAD + "- {name: a, mesh: cube.stl}\n- {name: a, mesh: cube.stl}\n"))
    assert "has no parts" in refusal(write(tmp_path, "frame: cell\nparts: []\n"))


@pytest.mark.parametrize("kind", ["stl", "obj", "ply", "glb"])
def test_formats_give_the_same_triangles(tmp_path: Path, kind: str) -> None:
    trimesh = pytest.importorskip("trimesh")
    trimesh.Trimesh(CUBE.vertices, CUBE.faces, process=False).export(tmp_path / f"cube.{kind}")
    (tmp_path / "scene.yaml").write_text(HEAD + f"- {{name: a, mesh: cube.{kind}}}\n")
    part = load_scene(tmp_path).parts[0]
    assert np.allclose(part.vertices[part.faces], CUBE.vertices[CUBE.faces], atol=1e-6)


def test_an_open_mesh_and_faces_without_area_are_fine(tmp_path: Path) -> None:
    corners = CUBE.vertices[CUBE.faces][:5].copy()
    corners[3, 2] = corners[3, 1]
    open_mesh = Part("a", corners.reshape(-1, 3), np.arange(15, dtype=np.int32).reshape(5, 3))
    assert len(open_mesh.faces) == 4
    assert len(load_scene(write(tmp_path, HEAD + "- {name: a, mesh: cube.stl}\n", stl_bytes(open_mesh))).parts[0].faces) == 4


def test_saved_scenes_come_back(tmp_path: Path) -> None:
    scene = make_builtin("housing")
    back = load_scene(save_scene(scene, tmp_path))
    assert back.names == scene.names
    for before, after in zip(scene.parts, back.parts, strict=True):
        assert (after.material, after.inspect, after.tolerance_mm) == (before.material, before.inspect, before.tolerance_mm)
        assert np.allclose(after.vertices[after.faces], before.vertices[before.faces], atol=2e-7)


def test_a_scene_is_opened_by_name_or_by_path(tmp_path: Path) -> None:
    assert open_scene("pipework").digest == make_builtin("pipework").digest
    assert open_scene(write_builtin("pipework", tmp_path)).names == make_builtin("pipework").names


def test_different_scenes_have_different_digests() -> None:
    scene = Scene("cell", (CUBE, Part("b", *block(1, 0, 0, (0.1, 0.1, 0.1)))))
    assert scene.without("b").names == ("cube",)
    assert len({scene.digest, scene.without("b").digest, scene.without("cube").digest}) == 3
    assert scene.digest == Scene("cell", scene.parts).digest
    with pytest.raises(SceneError, match="there is no part 'c'; parts: cube, b"):
        scene.without("c")


def test_a_step_file_in_millimetres_gives_metres(tmp_path: Path) -> None:
    pytest.importorskip("cascadio", reason="the STEP reader is not installed")
    (tmp_path / "box.step").write_text(box_step((200.0, 100.0, 50.0)))
    (tmp_path / "scene.yaml").write_text(HEAD + "- {name: a, mesh: box.step}\n")
    part = load_scene(tmp_path).parts[0]
    assert np.allclose(part.vertices.min(axis=0), 0, atol=1e-9)
    assert np.allclose(part.vertices.max(axis=0), [0.2, 0.1, 0.05], atol=1e-7)
    a, b, c = (part.vertices[part.faces[:, k]] for k in range(3))
    assert np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6 == pytest.approx(1e-3, rel=1e-6)


@pytest.mark.shared
def test_the_example_scenes_load(shared_data: Path) -> None:
    for case in ("example_null", "example_wiggling"):
        scene = load_scene(shared_data / "cases" / case / "scene")
        assert scene.frame == "cell"
        assert scene.part("rubber").material.albedo == 0.03
        assert len(scene.parts) == 13
