# SPDX-License-Identifier: Apache-2.0
"""The CAD scene: named parts with geometry in the cell frame, material, and inspection settings."""

from __future__ import annotations

from dataclasses import astuple, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tof_core.errors import SceneError
from tof_core.hashing import digest_bytes

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from tof_core.arrays import Float
    from tof_core.placement import Placement

DIVISIONS = 24
"""Most halvings of an edge: of a face of kilometres, more than any part needs."""


@dataclass(frozen=True, slots=True)
class Material:
    """Reflectance of a surface: diffuse albedo at the sensor's wavelength, roughness 0 (mirror) to 1 (matt)."""

    albedo: float = 0.5
    roughness: float = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """One part at its place in the cell.

    vertices (n, 3) float64 metres in the cell frame, pose and scale applied; faces (m, 3) int32.
    """

    name: str
    vertices: Float
    faces: NDArray[np.int32]
    material: Material = field(default_factory=Material)
    inspect: bool = False
    tolerance_mm: float = 1.0

    def __post_init__(self) -> None:
        """Refuse geometry without a valid face; drop faces without area."""
        vertices = np.ascontiguousarray(self.vertices, np.float64).reshape(-1, 3)
        faces = np.ascontiguousarray(self.faces, np.int32).reshape(-1, 3)
        if not np.isfinite(vertices).all():
            raise SceneError("the mesh has vertices that are NaN or infinite", where=self.name, todo="export it again")
        if faces.size and (faces.min() < 0 or faces.max() >= len(vertices)):
            raise SceneError("the mesh has faces without vertices", where=self.name, todo="export it again")
        faces = faces[has_area(vertices, faces)]
        if not len(faces):
            raise SceneError("the mesh is empty (no face with an area)", where=self.name, todo="export the part's surface as triangles")
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "faces", faces)

    def divided(self, edge_m: float) -> Part:
        """The same surface in faces whose edges are at most `edge_m` long."""
        from trimesh.remesh import subdivide_to_size

        vertices, faces = subdivide_to_size(self.vertices, self.faces, edge_m, max_iter=DIVISIONS)
        return replace(self, vertices=vertices, faces=faces.astype(np.int32))

    def digest(self) -> str:
        """Digest of geometry, material and inspection settings."""
        facts = repr((self.name, astuple(self.material), self.inspect, self.tolerance_mm)).encode()
        return digest_bytes(facts, self.vertices.tobytes(), self.faces.tobytes())


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """The parts of one cell. `frame` is the cell's TF frame; `placed_in` its placement if TF lacks it."""

    frame: str
    parts: tuple[Part, ...]
    placed_in: Placement | None = None
    folder: Path = field(default_factory=Path)
    digest: str = ""

    def __post_init__(self) -> None:
        """Refuse an empty scene and names used twice; compute the digest."""
        names = [part.name for part in self.parts]
        if not names:
            raise SceneError("the scene has no parts", where=self.folder)
        if twice := sorted({name for name in names if names.count(name) > 1}):
            raise SceneError(f"two parts are called '{twice[0]}'", where=self.folder, todo="give each part a name of its own")
        if not self.digest:
            object.__setattr__(self, "digest", digest_bytes(self.frame.encode(), *(part.digest().encode() for part in self.parts)))

    @property
    def names(self) -> tuple[str, ...]:
        """Part names; their positions are the part ids of renderings and labels."""
        return tuple(part.name for part in self.parts)

    def part(self, name: str) -> Part:
        """The part of that name."""
        return self.parts[self.index(name)]

    def index(self, name: str) -> int:
        """The id of the part of that name."""
        if name not in self.names:
            raise SceneError(f"there is no part '{name}'", where=self.folder, todo=f"parts: {', '.join(self.names)}")
        return self.names.index(name)

    def replaced(self, parts: Mapping[int, Part]) -> Scene:
        """The same cell with other geometry of some parts, by their ids."""
        return replace(self, parts=tuple(parts.get(k, part) for k, part in enumerate(self.parts)), digest="")

    def without(self, name: str) -> Scene:
        """The same cell without one part."""
        gone = self.index(name)
        return replace(self, parts=self.parts[:gone] + self.parts[gone + 1 :], digest="")

    def bounds(self) -> Float:
        """(2, 3) lowest and highest corner in metres."""
        return np.array(
            [
                np.min([part.vertices.min(axis=0) for part in self.parts], axis=0),
                np.max([part.vertices.max(axis=0) for part in self.parts], axis=0),
            ]
        )

    def triangles(self) -> tuple[Float, NDArray[np.int32], NDArray[np.int16]]:
        """All parts in one mesh: vertices (n, 3), faces (m, 3), part id of each face (m,)."""
        starts = np.cumsum([0, *(len(part.vertices) for part in self.parts)])
        faces = [part.faces + np.int32(start) for part, start in zip(self.parts, starts[:-1], strict=True)]
        ids = np.repeat(np.arange(len(self.parts), dtype=np.int16), [len(f) for f in faces])
        return np.concatenate([part.vertices for part in self.parts]), np.concatenate(faces), ids

    def surface_regions(self) -> NDArray[np.int32]:
        """(m,) region of each face of `triangles()`: smooth patches of one part (see tof_scene.topology)."""
        from tof_scene.topology import surface_regions

        return surface_regions(*self.triangles())


def has_area(vertices: Float, faces: NDArray[np.int32]) -> NDArray[np.bool_]:
    """(m,) faces whose height over their longest side is above rounding (1e-9 of it, and 1e-12 m)."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    doubled = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    longest = np.sqrt(np.max([((p - q) ** 2).sum(axis=1) for p, q in ((a, b), (b, c), (c, a))], axis=0, initial=0.0))
    return np.asarray(doubled > np.maximum(1e-9 * longest, 1e-12) * longest)
