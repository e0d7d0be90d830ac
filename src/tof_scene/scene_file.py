# SPDX-License-Identifier: Apache-2.0
"""Reading and writing scene.yaml: unknown keys are refused, meshes must be inside the folder, errors name file and line."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tof_core import se3
from tof_core.errors import SceneError, TransformError
from tof_core.placement import Placement
from tof_core.yamlio import save_yaml
from tof_scene.marked import Marked, load_marked
from tof_scene.mesh_file import load_mesh
from tof_scene.scene import Material, Part, Scene

if TYPE_CHECKING:
    from tof_core.arrays import Float

SCENE_KEYS = ("frame", "placed_in", "parts")
PART_KEYS = ("name", "mesh", "scale", "pose", "material", "inspect", "tolerance_mm")
LARGEST_M = {False: 50.0, True: 5.0}
"""Largest extent of a part and of an inspected part, metres; a larger mesh is taken for one in millimetres."""
SMALLEST_M = 1e-4


def load_scene(path: Path | str) -> Scene:
    """Read `scene.yaml` (or the folder that holds it) with all its meshes.

    Raises SceneError, in one line with file and line, for unknown keys, bad values, meshes that are missing, empty,
    not finite, outside the scene's folder or in millimetres.
    """
    path = Path(path)
    path = path / "scene.yaml" if path.is_dir() else path
    top = load_marked(path)
    top.only(SCENE_KEYS)
    listed = top.need("parts").items()
    parts = tuple(_part(entry, path.parent) for entry in listed)
    return Scene(top.need("frame").text(), parts, _placed_in(top), path.parent)


def _placed_in(top: Marked) -> Placement | None:
    entry = top.get("placed_in")
    if entry is None:
        return None
    entry.only(("frame", "pose"))
    return Placement(entry.need("frame").text(), _pose(entry.need("pose")))


def _part(entry: Marked, folder: Path) -> Part:
    entry.only(PART_KEYS)
    name = entry.need("name").text()
    mesh = entry.need("mesh")
    path = _inside(mesh, folder)
    scale, pose = entry.get("scale"), entry.get("pose")
    inspect, tolerance = entry.get("inspect"), entry.get("tolerance_mm")
    inspected = inspect.flag() if inspect else False
    vertices, faces = load_mesh(path)
    vertices = vertices * (scale.number(above=0.0) if scale else 1.0)
    _plausible(mesh, vertices, inspected=inspected)
    return Part(
        name, se3.apply(_pose(pose), vertices) if pose else vertices, faces, _material(entry.get("material")), inspected,
        tolerance.number(above=0.0) if tolerance else 1.0,
    )  # fmt: skip


def _material(entry: Marked | None) -> Material:
    if entry is None:
        return Material()
    entry.only(("albedo", "roughness"))
    albedo, roughness = entry.get("albedo"), entry.get("roughness")
    return Material(albedo.number(low=0.0, high=1.0) if albedo else 0.5, roughness.number(low=0.0, high=1.0) if roughness else 1.0)


def _inside(mesh: Marked, folder: Path) -> Path:
    """The mesh's path, which must lie in the scene's folder once links are followed."""
    path = folder / mesh.text()
    if not path.resolve().is_relative_to(folder.resolve()):
        raise mesh.error(f"the mesh '{mesh.text()}' lies outside the scene's folder", "copy it beside scene.yaml")
    return path


def _plausible(mesh: Marked, vertices: Float, *, inspected: bool) -> None:
    """Refuse sizes that indicate a wrong unit; `Part` checks for vertices that are not finite."""
    if not np.isfinite(vertices).all():
        raise mesh.error(f"the mesh '{mesh.text()}' has vertices that are NaN or infinite", "export it again")
    size = float(np.ptp(vertices, axis=0).max())
    if size > LARGEST_M[inspected]:
        raise mesh.error(f"the mesh '{mesh.text()}' is {size:.4g} m long; it seems to be in millimetres", "set scale: 0.001")
    if size < SMALLEST_M:
        raise mesh.error(f"the mesh '{mesh.text()}' is only {size * 1e3:.2g} mm long", "set scale (1 for a mesh in metres)")


def _pose(entry: Marked) -> Float:
    """(4, 4) from [x, y, z, qx, qy, qz, qw], {xyz: [...], xyzw: [...]}, or four rows of four."""
    try:
        if isinstance(entry.value, dict):
            entry.only(("xyz", "xyzw"))
            xyzw = entry.get("xyzw")
            return se3.from_quat(entry.need("xyz").numbers(3), xyzw.numbers(4) if xyzw else (0, 0, 0, 1))
        if isinstance(entry.value, list) and len(entry.value) == 4:
            return se3.as_se3("pose", [row.numbers(4) for row in entry.items()])
        values = entry.numbers(7)
        return se3.from_quat(values[:3], values[3:])
    except TransformError as error:
        raise entry.error(f"the pose {error.what}", "give x y z and a quaternion x y z w, or a rigid 4x4 matrix") from None


def save_scene(scene: Scene, folder: Path | str) -> Path:
    """Write `scene.yaml` with its meshes (binary STL, cell frame, metres) into a folder; returns the file.

    STL holds float32, so vertices move by at most 1e-7 of their distance from the cell's origin.
    """
    folder = Path(folder)
    (folder / "meshes").mkdir(parents=True, exist_ok=True)
    parts = []
    for part in scene.parts:
        mesh = f"meshes/{_file_name(part.name)}.stl"
        (folder / mesh).write_bytes(stl_bytes(part))
        material = {"albedo": part.material.albedo, "roughness": part.material.roughness}
        parts.append({"name": part.name, "mesh": mesh, "material": material, "inspect": part.inspect, "tolerance_mm": part.tolerance_mm})
    top: dict[str, Any] = {"frame": scene.frame}
    if scene.placed_in:
        top["placed_in"] = {"frame": scene.placed_in.frame, "pose": scene.placed_in.T_frame_cell.tolist()}
    save_yaml(folder / "scene.yaml", {**top, "parts": parts})
    return folder / "scene.yaml"


def stl_bytes(part: Part) -> bytes:
    """A part as binary STL: 80 bytes of header, a count, then normal and corners of each face in float32."""
    corners = part.vertices[part.faces]
    record = np.zeros(len(corners), np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")]))
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    record["normal"] = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    record["corners"] = corners
    return b"toftwin".ljust(80) + np.uint32(len(corners)).tobytes() + record.tobytes()


def _file_name(name: str) -> str:
    if not all(c.isalnum() or c in "-_." for c in name) or name.startswith("."):
        raise SceneError(f"the part name '{name}' makes no file name", todo="use letters, digits, - and _")
    return name
