# SPDX-License-Identifier: Apache-2.0
"""Schema of a dataset: names, types and shapes of its arrays, and its attributes."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

from tof_core.camera import Camera
from tof_core.errors import DatasetError

if TYPE_CHECKING:
    from collections.abc import Mapping

SCHEMA = "toftwin.dataset/1"

IMAGE = ("height", "width")
"""Placeholder for the camera's raster in the tables below."""


@dataclass(frozen=True, slots=True)
class Column:
    """One array: its type as NumPy writes it, and the shape of one frame."""

    dtype: str
    frame: tuple[str | int, ...]
    text: str

    @property
    def image(self) -> bool:
        """Whether a frame is a raster of the camera; these alone are compressed."""
        return self.frame == IMAGE

    def frame_shape(self, camera: Camera) -> tuple[int, ...]:
        """The shape of one frame for this camera."""
        sizes = {"height": camera.height, "width": camera.width}
        return tuple(sizes[n] if isinstance(n, str) else n for n in self.frame)


COLUMNS: dict[str, dict[str, Column]] = {
    "captures": {
        "raw": Column("f4", IMAGE, "z-depth of one frame as the camera gave it, metres, NaN invalid"),
        "amplitude": Column("f4", IMAGE, "amplitude in the camera's unit, NaN where there is none"),
        "stamp_ns": Column("i8", (), "header stamp"),
        "temperature": Column("f4", (), "degrees Celsius, NaN where unknown"),
        "view": Column("i4", (), "the view that contains it, -1 where that view was never written"),
    },
    "views": {
        "depth": Column("f4", IMAGE, "accumulated and filtered z-depth, metres, NaN invalid"),
        "sigma": Column("f4", IMAGE, "standard error of depth, metres"),
        "count": Column("u2", IMAGE, "captures that went into the pixel"),
        "label": Column("f4", IMAGE, "z-depth of the CAD at the solved pose, metres, NaN where the ray misses it"),
        "label_sigma": Column("f4", IMAGE, "standard deviation of label, metres"),
        "mask": Column("u1", IMAGE, "1 where the label may be trained on"),
        "reason": Column("u1", IMAGE, "why not: 0 usable, else a code of tof_sim_label.reasons"),
        "part": Column("i2", IMAGE, "index into the attribute 'parts', -1 where the ray misses"),
        "mixed": Column("f4", IMAGE, "share of the second surface in the pixel, 0 to 0.5"),
        "incidence": Column("f4", IMAGE, "angle between ray and surface normal, radians"),
        "T_cell_camera": Column("f8", (4, 4), "solved pose of the camera"),
        "pose_cov": Column("f8", (6, 6), "its covariance: x y z rotX rotY rotZ, fixed axes of the cell"),
        "station": Column("i4", (), "interval in which the base stood still; the unit of every split"),
        "stamp_ns": Column("i8", (), "header stamp of the view's last capture"),
    },
}


@dataclass(frozen=True, slots=True)
class Attributes:
    """Attributes of one dataset. Frames made under other attributes are refused.

    `cad_hash` and `config_hash` name the scene and the configuration that made the labels,
    `pose_source` the source of the poses ("session, final", "session, causal", "per view",
    "robot"), `parts` the names that `views/part` indexes.
    """

    cad_hash: str
    config_hash: str
    pose_source: str
    parts: tuple[str, ...] = ()
    notes: dict[str, Any] = field(default_factory=dict)
    """Further facts (bag, version); not compared on appending."""

    def must_equal(self, other: Attributes, where: object) -> None:
        """Refuse to append frames with other attributes."""
        for name in ("cad_hash", "config_hash", "pose_source", "parts"):
            mine, theirs = getattr(self, name), getattr(other, name)
            if mine != theirs:
                msg = f"was made with {name} {_short(theirs)}, not {_short(mine)}"
                raise DatasetError(msg, where=where, todo="write to another dataset")


def to_json(camera: Camera, attributes: Attributes) -> dict[str, Any]:
    """The group's attributes of a new, empty dataset."""
    return {
        "schema": SCHEMA,
        "camera": asdict(camera),
        "hashes": {"cad": attributes.cad_hash, "config": attributes.config_hash},
        "pose_source": attributes.pose_source,
        "parts": list(attributes.parts),
        "notes": attributes.notes,
        "columns": {f"{g}/{n}": c.text for g, columns in COLUMNS.items() for n, c in columns.items()},
        "committed": dict.fromkeys(COLUMNS, 0),
        "verdicts": [],
        "lenses": [],
    }


def from_json(values: Mapping[str, Any], where: object) -> tuple[Camera, Attributes]:
    """Camera and attributes of a dataset; refuses another schema."""
    schema = values.get("schema")
    if schema != SCHEMA:
        msg = f"has schema {schema!r}, not '{SCHEMA}'"
        raise DatasetError(msg, where=where, todo="make it again with this version of toftwin")
    try:
        return camera_of(values["camera"]), Attributes(
            cad_hash=values["hashes"]["cad"],
            config_hash=values["hashes"]["config"],
            pose_source=values["pose_source"],
            parts=tuple(values["parts"]),
            notes=dict(values["notes"]),
        )
    except (KeyError, TypeError) as error:
        msg = f"its attributes are damaged ({error})"
        raise DatasetError(msg, where=where) from error


def camera_of(values: Mapping[str, Any]) -> Camera:
    """A camera from its plain values."""
    return Camera(**(dict(values) | {"distortion": tuple(values["distortion"])}))


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
