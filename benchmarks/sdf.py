# SPDX-License-Identifier: Apache-2.0
"""The ARIAC assembly insert and its parts (NIST, SDF models for Gazebo) as a scene: each part seated on its contact."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

import numpy as np

from tof_core import se3
from tof_core.errors import SceneError
from tof_scene.builtin.parts import room
from tof_scene.builtin.shapes import box, join
from tof_scene.mesh_file import load_mesh
from tof_scene.scene import Material, Part, Scene
from tof_scene.scene_file import save_scene

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tof_core.arrays import Float
    from tof_scene.builtin.shapes import Solid

OPAQUE = 0.5
"""Panes more transparent than this are left out: a ToF camera looks through them."""
ALBEDO = (0.06, 0.85)
LEAN = 65.0
"""Degrees by which the insert is tipped from lying to facing the robot."""


@dataclass(frozen=True, slots=True)
class Seat:
    """How a model sits in the insert: its point `tip` lies at the middle of `contact`, turned by a rotation vector in degrees."""

    model: str
    contact: str
    tip: tuple[float, float, float]
    turn: tuple[float, float, float]


SEATS = (
    Seat("pump", "pump_contact", (0.0, 0.0, 0.0), (0, 0, 0)),
    Seat("battery", "battery_contact", (0.067, 0.0, 0.020), (0, 0, 90)),
    Seat("regulator", "regulator_contact", (0.0, -0.080, 0.035), (90, 0, 0)),
    Seat("sensor", "sensor_contact", (0.075, 0.0, 0.035), (0, 0, -90)),
)
"""Seats of the models, which the SDF does not hold: pump on its plate, battery's pins, regulator's long and sensor's peg in their sockets."""


def write_sdf_scene(folder: Path | str, out_folder: Path | str, insert: str = "assembly_insert", seats: tuple[Seat, ...] = SEATS) -> Path:
    """Make a scene folder from a folder of SDF models with their meshes beside them (`<model>_<mesh>.stl`).

    The insert stands on a table, tipped toward +x, around (0, 0, 0.8); one part per visual of the insert, one per model
    seated in it (`inspect: true`, 2 mm). Albedos are the mean of the visuals' diffuse colour.

    Raises:
        SceneError: a model, a mesh or a contact is missing.
    """
    folder = Path(folder)
    T_cell_insert = se3.from_quat((0.0, 0.0, 0.78), se3.quat_from_matrix(se3.so3_exp([0, np.radians(LEAN), 0])))
    base = [Part(f"insert_{name}", *_placed(T_cell_insert, solid), Material(albedo)) for name, solid, albedo in _visuals(folder, insert)]
    seated = [_seated(folder, insert, seat, T_cell_insert) for seat in seats]
    table = join(box((0.8, 1.4, 0.03), (0.0, 0, 0.48), 8), box((0.04, 0.5, 0.30), (-0.16, 0, 0.645), 4))
    return save_scene(Scene("cell", (*room(), Part("table", *table, Material(0.4)), *base, *seated)), out_folder)


def _seated(folder: Path, insert: str, seat: Seat, T_cell_insert: Float) -> Part:
    """One model on its contact."""
    visuals = list(_visuals(folder, seat.model))
    T = np.eye(4)
    T[:3, :3] = se3.so3_exp(np.radians(seat.turn))
    T[:3, 3] = _contact(folder, insert, seat.contact) - T[:3, :3] @ seat.tip
    area = [np.linalg.norm(np.cross(v[f[:, 1]] - v[f[:, 0]], v[f[:, 2]] - v[f[:, 0]]), axis=1).sum() for _, (v, f), _ in visuals]
    albedo = float(np.average([a for *_, a in visuals], weights=area))
    solid = join(*(solid for _, solid, _ in visuals))
    return Part(seat.model, *_placed(T_cell_insert @ T, solid), Material(round(albedo, 3)), inspect=True, tolerance_mm=2.0)


def _visuals(folder: Path, model: str) -> Iterator[tuple[str, Solid, float]]:
    """Name, geometry in the model's frame and albedo of each opaque visual of a model."""
    for link in _root(folder, model).iter("link"):
        for visual in link.iter("visual"):
            colour = _numbers(visual, "material/diffuse", (0.5, 0.5, 0.5, 1.0))
            if colour[3] >= OPAQUE:
                vertices, faces = load_mesh(_mesh_file(folder, visual))
                T = _pose(link) @ _pose(visual)
                yield visual.get("name", ""), (se3.apply(T, vertices), faces), float(np.clip(np.mean(colour[:3]), *ALBEDO))


def _contact(folder: Path, insert: str, name: str) -> Float:
    """Middle of a contact of the insert, in the insert's frame."""
    for link in _root(folder, insert).iter("link"):
        for shape in link.iter("collision"):
            file = _mesh_file(folder, shape)
            if file.stem.endswith(name):
                return np.asarray(se3.apply(_pose(link) @ _pose(shape), load_mesh(file)[0]).mean(axis=0))
    raise SceneError(f"there is no contact '{name}'", where=folder / f"{insert}.sdf")


def _root(folder: Path, model: str) -> ET.Element:
    path = folder / f"{model}.sdf"
    try:
        return ET.parse(path).getroot()  # noqa: S314  (expat 2.4.1 and later bounds what entities may grow to)
    except (OSError, ET.ParseError) as error:
        raise SceneError(f"the model cannot be read: {error}", where=path) from None


def _mesh_file(folder: Path, shape: ET.Element) -> Path:
    """`model://pump/meshes/pump_base.stl` lies beside the SDF as pump_pump_base.stl."""
    uri = (shape.findtext("geometry/mesh/uri") or "").removeprefix("model://").split("/")
    return folder / f"{uri[0]}_{uri[-1]}"


def _pose(element: ET.Element) -> Float:
    """x y z roll pitch yaw of an element, fixed axes, radians."""
    x, y, z, roll, pitch, yaw = _numbers(element, "pose", (0.0,) * 6)
    T = np.eye(4)
    T[:3, :3] = se3.so3_exp([0, 0, yaw]) @ se3.so3_exp([0, pitch, 0]) @ se3.so3_exp([roll, 0, 0])
    T[:3, 3] = x, y, z
    return T


def _numbers(element: ET.Element, tag: str, default: tuple[float, ...]) -> tuple[float, ...]:
    text = element.findtext(tag)
    return tuple(float(word) for word in text.split()) if text else default


def _placed(T: Float, solid: Solid) -> Solid:
    return se3.apply(T, solid[0]), solid[1]
