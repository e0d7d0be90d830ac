# SPDX-License-Identifier: Apache-2.0
"""The two libraries that find which triangle a ray hits first; both are Intel's Embree underneath, built and called differently."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from tof_core.errors import UsageError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tof_core.arrays import Float

    Float32 = NDArray[np.float32]
    Found = tuple[NDArray[np.int32], Float32]

MISS = 0xFFFFFFFF
ORDER = ("embree", "open3d")
"""Which one `auto` takes, the faster first (`python -m benchmarks --only scene` measures them side by side)."""


class Backend(Protocol):
    """Nearest hits of float32 rays."""

    name: str

    def nearest(self, origins: Float32, directions: Float32) -> Found:
        """Face (N,) int32, -1 for none, and its distance (N,) in lengths of the direction."""
        ...


class EmbreeBackend:
    """embreex: Embree 4, one ray at a time, one core."""

    name = "embree"

    def __init__(self, vertices: Float, faces: NDArray[np.int32]) -> None:
        """Build the tree over vertices (n, 3) and faces (m, 3)."""
        from embreex import rtcore_scene
        from embreex.mesh_construction import TriangleMesh

        self._scene: Any = rtcore_scene.EmbreeScene(robust=True)
        self._mesh: Any = TriangleMesh(self._scene, vertices.astype(np.float32), faces)

    def nearest(self, origins: Float32, directions: Float32) -> Found:
        """See Backend."""
        found = self._scene.run(origins, directions, output=True)
        return found["primID"].astype(np.int32, copy=False), found["tfar"]


class Open3dBackend:
    """open3d's RaycastingScene: Embree 4 on all cores."""

    name = "open3d"

    def __init__(self, vertices: Float, faces: NDArray[np.int32]) -> None:
        """Build the tree over vertices (n, 3) and faces (m, 3)."""
        import open3d

        self._tensor: Any = open3d.core.Tensor.from_numpy
        self._scene: Any = open3d.t.geometry.RaycastingScene()
        self._scene.add_triangles(self._tensor(vertices.astype(np.float32)), self._tensor(faces.astype(np.uint32)))

    def nearest(self, origins: Float32, directions: Float32) -> Found:
        """See Backend."""
        rays = np.concatenate([origins, directions], axis=1)
        found = self._scene.cast_rays(self._tensor(rays))
        face = found["primitive_ids"].numpy()
        return np.where(face == MISS, -1, face.astype(np.int32)).astype(np.int32), found["t_hit"].numpy()


BACKENDS: dict[str, type[EmbreeBackend | Open3dBackend]] = {"embree": EmbreeBackend, "open3d": Open3dBackend}


def make_backend(name: str, vertices: Float, faces: NDArray[np.int32]) -> Backend:
    """The backend of that name; `auto` is the faster of those installed."""
    if name != "auto" and name not in BACKENDS:
        raise UsageError(f"there is no ray caster '{name}'", where="backend", todo=f"use auto, {' or '.join(BACKENDS)}")
    for choice in ORDER if name == "auto" else (name,):
        try:
            return BACKENDS[choice](vertices, faces)
        except ImportError:
            continue
    missing = "embreex or open3d" if name == "auto" else {"embree": "embreex"}.get(name, name)
    raise UsageError(f"the ray caster '{name}' is not installed", where="backend", todo=f"pip install {missing}")
