# SPDX-License-Identifier: Apache-2.0
"""Triangles of a mesh file are those that the file states, whichever reader takes it."""

from __future__ import annotations

import subprocess
import sys
from typing import TYPE_CHECKING

import numpy as np
import pytest
import trimesh

from tof_core.errors import SceneError
from tof_scene.mesh_file import load_mesh

if TYPE_CHECKING:
    from pathlib import Path

TRIANGLES = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[1, 0, 0], [1, 1, 0], [0, 1, 0.5]]], float)


def exported(path: Path, form: str) -> Path:
    mesh = trimesh.Trimesh(TRIANGLES.reshape(-1, 3), np.arange(6).reshape(2, 3), process=False)
    mesh.export(path, file_type=form)
    return path


@pytest.mark.parametrize("form", ["stl", "stl_ascii"])
def test_a_binary_and_a_text_stl_hold_the_same_triangles(tmp_path: Path, form: str) -> None:
    vertices, faces = load_mesh(exported(tmp_path / "a.stl", form))
    assert vertices.dtype == np.float64
    assert faces.dtype == np.int32
    np.testing.assert_array_equal(vertices[faces], TRIANGLES)


def test_a_binary_stl_is_read_without_trimesh(tmp_path: Path) -> None:
    code = "import sys; from pathlib import Path; from tof_scene.mesh_file import load_mesh; load_mesh(Path(sys.argv[1])); print('trimesh' in sys.modules)"
    path = exported(tmp_path / "a.stl", "stl")
    assert subprocess.run([sys.executable, "-c", code, path], check=True, capture_output=True, text=True).stdout.split() == ["False"]


def test_a_binary_stl_that_is_cut_off_is_refused(tmp_path: Path) -> None:
    path = exported(tmp_path / "a.stl", "stl")
    path.write_bytes(path.read_bytes()[:-7])
    with pytest.raises(SceneError, match="no triangles"):
        load_mesh(path)
