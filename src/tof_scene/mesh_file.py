# SPDX-License-Identifier: Apache-2.0
"""Triangles from a mesh file: STL, OBJ, PLY, GLB, STEP and all other formats of trimesh. The geometry is not changed."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Any

import numpy as np

from tof_core.errors import SceneError
from tof_scene.gltf_size import check_gltf

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from tof_core.arrays import Float

STEP_TOLERANCE_M = 1e-5
"""Largest distance between a STEP file's curved surface and its triangles (chord height)."""
STEP_ANGLE = 0.1
"""Largest angle in radians between neighbouring triangles of a curved STEP surface."""

STL_HEADER = np.dtype([("comment", "S80"), ("triangles", "<u4")])
STL_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("colour", "<u2")])
"""Layout of a binary STL file: its header, and then each triangle."""

ARCHIVES = {".zip", ".gz", ".bz2", ".xz"}
"""Refused, since trimesh would unpack them into memory without a limit."""


def load_mesh(path: Path) -> tuple[Float, NDArray[np.int32]]:
    """Vertices (n, 3) float64 in the file's unit (STEP and GLB: metres) and faces (m, 3) int32.

    All bodies of a file are read, each at its place in the file. Nothing is merged, closed or reoriented.
    Vertices may be NaN; `Part` refuses them with the part's name.
    """
    if not path.is_file():
        raise SceneError("the mesh is missing", where=path, todo="mesh paths are relative to scene.yaml")
    if path.suffix.lower() in ARCHIVES:
        raise SceneError("the mesh is an archive", where=path, todo="unpack it and name the mesh inside")
    if not path.stat().st_size:
        raise SceneError("the mesh is empty (a file of 0 bytes)", where=path, todo="export it again")
    bodies = _bodies(path)
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in bodies)])
    if not starts[-1]:
        raise SceneError("the mesh is empty (no triangles)", where=path, todo="export the part's surface as triangles")
    vertices = np.concatenate([v for v, _ in bodies])
    return vertices, np.concatenate([f + start for (_, f), start in zip(bodies, starts[:-1], strict=True)]).astype(np.int32)


def _bodies(path: Path) -> list[tuple[Float, NDArray[Any]]]:
    binary = _binary_stl(path) if path.suffix.lower() == ".stl" else None
    if binary is not None:
        return [binary]
    import trimesh  # Takes half a second to import.

    logging.getLogger("trimesh").setLevel(logging.CRITICAL)  # trimesh logs the traceback of errors that it raises
    options: dict[str, Any] = {}
    if path.suffix.lower() in {".gltf", ".glb"}:
        check_gltf(path)
        options = {"skip_materials": True}
    if path.suffix.lower() in {".step", ".stp"}:
        options = {"tol_linear": STEP_TOLERANCE_M * 1e3, "tol_angular": STEP_ANGLE}  # its linear unit is the millimetre
    try:
        loaded = trimesh.load_scene(path, process=False, **options)
        meshes = [body for body in loaded.dump() if isinstance(body, trimesh.Trimesh)]
    except Exception as error:  # noqa: BLE001  (each of trimesh's many readers fails in its own way)
        reason = str(error).splitlines()[0][:120] if str(error) else type(error).__name__
        raise SceneError(f"the mesh cannot be read: {reason}", where=path, todo="use STL, OBJ, PLY, GLB or STEP") from None
    if any(np.shape(body.vertices)[1:] != (3,) or np.shape(body.faces)[1:] != (3,) for body in meshes):
        raise SceneError("the mesh has points that are not three numbers each", where=path, todo="export it again")
    return [(np.asarray(body.vertices, np.float64), np.asarray(body.faces)) for body in meshes]


def _binary_stl(path: Path) -> tuple[Float, NDArray[Any]] | None:
    """Vertices (3 m, 3) and faces (m, 3) of a binary STL file as trimesh reads it; None for any other file, also one without triangles."""
    size = path.stat().st_size - STL_HEADER.itemsize
    if size <= 0:
        return None
    count = int(np.fromfile(path, STL_HEADER, 1)["triangles"][0])
    if count == 0 or size != count * STL_TRIANGLE.itemsize:
        return None
    corners = np.fromfile(path, STL_TRIANGLE, offset=STL_HEADER.itemsize)["corners"]
    return corners.reshape(-1, 3).astype(np.float64), np.arange(3 * count).reshape(-1, 3)
