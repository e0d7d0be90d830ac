# SPDX-License-Identifier: Apache-2.0
"""The BOP export contains the dataset's values in BOP's units and layout."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import trimesh
from PIL import Image as Pillow

from tof_core import se3
from tof_core.camera import Camera
from tof_core.capture import Capture, Posed, View
from tof_core.errors import DatasetError
from tof_scene.raycast import Raycaster
from tof_scene.scene import Part, Scene
from tof_sim_label.bop import export_bop
from tof_sim_label.bop_models import diameter, vertex_normals
from tof_sim_label.dataset import Dataset, DatasetWriter
from tof_sim_label.label import label_view
from tof_sim_label.schema import Attributes

if TYPE_CHECKING:
    from pathlib import Path

CAMERA = Camera(width=64, height=48, fx=70.0, fy=70.0, cx=31.5, cy=23.5)
POSES = [np.eye(4), se3.exp([0.05, 0.0, -0.05, 0.02, 0.03, 0.01])]


def box(x: float, y: float, z: float, size: float) -> tuple[Any, Any]:
    """A cube of that size centred at x, y, z."""
    cube = trimesh.creation.box((size, size, size))
    return np.asarray(cube.vertices) + np.array([x, y, z]), np.asarray(cube.faces)


@pytest.fixture(scope="module")
def scene() -> Scene:
    """A far cube, a near one that hides part of it, and one behind the camera."""
    return Scene(
        "cell", (Part("far", *box(0.0, 0.0, 1.1, 0.2)), Part("near", *box(0.08, 0.0, 0.7, 0.1)), Part("behind", *box(0.0, 0.0, -1.0, 0.1)))
    )


def record(path: Path, scene: Scene, camera: Camera) -> Dataset:
    """Two views at two stations whose measured depth is 5 mm beyond the label."""
    caster = Raycaster(scene)
    with DatasetWriter(path, camera, Attributes(scene.digest, "c", "session, final", scene.names)) as writer:
        for i, T in enumerate(POSES):
            none = np.zeros(camera.shape, np.uint8)
            view = View(
                i,
                i,
                camera,
                np.zeros(camera.shape, np.float32),
                np.full(camera.shape, 1e-3, np.float32),
                none.astype(np.uint16),
                none,
                None,
                i,
            )
            label = label_view(view, Posed(T, 1e-8 * np.eye(6)), caster)
            view = replace(view, depth=label.depth + np.float32(5e-3))
            writer.append_capture(Capture(i, camera, view.depth, none, amplitude=np.full(camera.shape, 4.0, np.float32)), view=i)
            writer.append_view(view, label)
    return Dataset(path)


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory, scene: Scene) -> tuple[Dataset, Path]:
    folder = tmp_path_factory.mktemp("bop")
    data = record(folder / "d", scene, CAMERA)
    return data, export_bop(data, scene, folder / "bop")


def read(path: Path) -> Any:
    return json.loads(path.read_text())


def image(path: Path) -> Any:
    return np.asarray(Pillow.open(path))


def test_every_station_is_a_scene_with_its_images_and_annotations(exported: tuple[Dataset, Path]) -> None:
    _, root = exported
    assert sorted(p.name for p in (root / "train").iterdir()) == ["000000", "000001"]
    for station in (0, 1):
        folder = root / "train" / f"{station:06d}"
        assert sorted(p.name for p in folder.iterdir()) == [
            "depth",
            "depth_label",
            "gray",
            "mask",
            "mask_visib",
            "scene_camera.json",
            "scene_gt.json",
            "scene_gt_info.json",
        ]
        assert list(read(folder / "scene_gt.json")) == [str(station)]
        assert sorted(p.name for p in (folder / "mask_visib").iterdir()) == [f"{station:06d}_{k:06d}.png" for k in range(2)]


def test_depth_in_the_images_is_depth_in_the_dataset(exported: tuple[Dataset, Path]) -> None:
    data, root = exported
    scale = read(root / "train/000001/scene_camera.json")["1"]["depth_scale"]
    for folder, name in (("depth", "views/depth"), ("depth_label", "views/label")):
        stored = image(root / "train/000001" / folder / "000001.png")
        assert stored.dtype == np.uint16
        expected = 1e3 * data.frame(name, 1)
        np.testing.assert_allclose(np.where(stored > 0, stored * scale, np.nan), expected, atol=0.5 * scale + 1e-3)


def test_a_models_pose_brings_its_points_to_the_surface_the_label_has(exported: tuple[Dataset, Path]) -> None:
    data, root = exported
    annotation = read(root / "train/000001/scene_gt.json")["1"]
    K = np.array(read(root / "train/000001/scene_camera.json")["1"]["cam_K"]).reshape(3, 3)
    for known in annotation:
        model = trimesh.load_mesh(root / "models" / f"obj_{known['obj_id']:06d}.ply")
        R, t = np.array(known["cam_R_m2c"]).reshape(3, 3), np.array(known["cam_t_m2c"])
        centre = (R @ np.asarray(model.bounds).mean(axis=0) + t) / 1e3
        true = se3.apply(se3.inverse(POSES[1]), {1: [0, 0, 1.1], 2: [0.08, 0, 0.7]}[known["obj_id"]])
        np.testing.assert_allclose(centre, true, atol=1e-6)
        front = R @ [0, 0, float(model.bounds[0, 2])] + t
        u, v = np.rint((K @ front)[:2] / front[2]).astype(int)
        if known["obj_id"] == 2:
            assert abs(1e3 * data.frame("views/label", 1)[v, u] - front[2]) < 1.0


def test_the_cameras_pose_maps_the_world_into_the_camera(exported: tuple[Dataset, Path]) -> None:
    _, root = exported
    known = read(root / "train/000001/scene_camera.json")["1"]
    R, t = np.array(known["cam_R_w2c"]).reshape(3, 3), np.array(known["cam_t_w2c"]) / 1e3
    np.testing.assert_allclose(R @ POSES[1][:3, 3] + t, 0.0, atol=1e-9)


def test_visibility_is_the_share_of_the_outline_that_is_seen(exported: tuple[Dataset, Path]) -> None:
    data, root = exported
    far, near = read(root / "train/000000/scene_gt_info.json")["0"]
    part = data.frame("views/part", 0)
    assert near["visib_fract"] == pytest.approx(1.0, abs=0.02)
    # The far cube's front is 14 x 14 pixels at 1 m; the near one's, 10.8 x 10.8 at 0.65 m, covers 3.8 columns of it.
    assert far["px_count_visib"] == (part == 0).sum()
    assert far["visib_fract"] == pytest.approx(1 - 3.8 * 10.8 / 14**2, abs=0.03)
    assert far["px_count_all"] == pytest.approx(14 * 14, abs=16)
    assert far["bbox_obj"] == [25, 17, 14, 14]
    assert far["px_count_valid"] == far["px_count_all"]
    visible = image(root / "train/000000/mask_visib/000000_000000.png")
    np.testing.assert_array_equal(visible == 255, part == 0)


def test_models_are_in_millimetres_centred_and_with_unit_normals(exported: tuple[Dataset, Path]) -> None:
    _, root = exported
    info = read(root / "models/models_info.json")
    assert info["1"]["diameter"] == pytest.approx(200 * np.sqrt(3), rel=1e-6)
    assert (info["2"]["min_x"], info["2"]["size_x"], info["2"]["name"]) == (pytest.approx(-50), pytest.approx(100), "near")
    lines = (root / "models/obj_000002.ply").read_text().splitlines()
    assert lines[:2] == ["ply", "format ascii 1.0"]
    first = np.array(lines[lines.index("end_header") + 1].split(), float)
    assert np.abs(first[:3]).max() == pytest.approx(50, abs=1e-3)
    assert np.linalg.norm(first[3:]) == pytest.approx(1.0, abs=1e-4)


def test_a_bent_lens_is_undone_without_mixing_depths(tmp_path: Path, scene: Scene) -> None:
    bent = replace(CAMERA, distortion_model="plumb_bob", distortion=(-0.2, 0.03, 0.0, 0.0, 0.0))
    data = record(tmp_path / "d", scene, bent)
    root = export_bop(data, scene, tmp_path / "bop", views=[0])
    stored = image(root / "train/000000/depth_label/000000.png")
    # On the far cube's front face, 1 m from the camera and upright, z is 1000 mm whatever the lens.
    assert set(np.unique(stored)) <= {0, 6500, 10000} | set(range(6500, 12000))
    assert stored[23, 27] == 10000
    known = set(np.rint(data.frame("views/label", 0)[np.isfinite(data.frame("views/label", 0))].astype(float) * 1e4).astype(int))
    assert set(np.unique(stored)) - {0} <= known


def test_another_scene_than_the_datasets_is_refused(exported: tuple[Dataset, Path], scene: Scene, tmp_path: Path) -> None:
    data, _ = exported
    with pytest.raises(DatasetError, match="another scene"):
        export_bop(data, scene.without("near"), tmp_path / "bop")
    assert not (tmp_path / "bop").exists()


def test_diameter_and_normals_of_flat_and_of_fine_meshes() -> None:
    flat = np.array([[0.0, 0, 0], [3, 0, 0], [3, 4, 0], [0, 4, 0]])
    assert diameter(flat) == pytest.approx(5.0)
    ball = trimesh.creation.icosphere(subdivisions=5, radius=2.0)
    assert diameter(np.asarray(ball.vertices)) == pytest.approx(4.0, rel=1e-3)
    np.testing.assert_allclose(
        vertex_normals(np.asarray(ball.vertices), np.asarray(ball.faces)), np.asarray(ball.vertices) / 2.0, atol=2e-3
    )
