# SPDX-License-Identifier: Apache-2.0
"""The ARIAC insert from its SDF files: parts seated where their contacts are."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy.spatial import cKDTree

from benchmarks.sdf import write_sdf_scene
from tests.tof_scene.solids import camera, looking
from tof_core.errors import SceneError
from tof_scene.raycast import Raycaster
from tof_scene.render import render
from tof_scene.scene_file import load_scene

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.shared
def test_the_insert_carries_its_four_parts_touching_it(shared_data: Path, tmp_path: Path) -> None:
    scene = load_scene(write_sdf_scene(shared_data / "cad" / "ariac", tmp_path))
    assert {part.name for part in scene.parts if part.inspect} == {"pump", "battery", "regulator", "sensor"}
    insert = np.concatenate([part.vertices for part in scene.parts if part.name.startswith("insert_")])
    for name in ("pump", "battery", "regulator", "sensor"):
        own = scene.part(name).vertices
        assert cKDTree(insert).query(own)[0].min() < 0.03, name
        assert np.linalg.norm(own.mean(axis=0) - [0, 0, 0.8]) < 0.5
    seen = np.unique(render(Raycaster(scene), camera(200, 150), looking((1.0, 0, 1.0), (0, 0, 0.8)), footprints=False).part)
    assert {scene.index(name) for name in ("pump", "battery", "regulator", "sensor")} <= set(seen.tolist())


def test_a_folder_without_models_is_named(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"assembly_insert\.sdf: the model cannot be read"):
        write_sdf_scene(tmp_path, tmp_path / "out")
