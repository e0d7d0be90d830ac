# SPDX-License-Identifier: Apache-2.0
"""The two libraries that find which triangle a ray hits first; both are Intel's Embree underneath, built and called differently."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol, TypeVar

import numpy as np

from tof_core.cores import CORES, in_threads
from tof_core.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from tof_core.arrays import Float, Mask

    T = TypeVar("T")
    Float32 = NDArray[np.float32]
    Found = tuple[NDArray[np.int32], Float32]

MISS = 0xFFFFFFFF
SHARED_FROM = 20_000
"""Rays from which threads pay for themselves."""
ORDER = ("embree", "open3d")
"""Which one `auto` takes first: they cost the same processor time and share the cores alike (`python -m benchmarks --only scene`
measures them side by side), and embreex adds 19 MB to a process where open3d adds 190."""


class Backend(Protocol):
    """What float32 rays meet."""

    name: str

    def nearest(self, origins: Float32, directions: Float32) -> Found:
        """Face (N,) int32, -1 for none, and its distance (N,) in lengths of the direction."""
        ...

    def blocked(self, origins: Float32, directions: Float32, reach: float) -> Mask:
        """(N,) whether anything is met within `reach` lengths of the direction; which, and where, is not asked."""
        ...


class EmbreeBackend:
    """embreex: Embree 4; many rays are shared out between the cores (it lets go of Python's lock while it works)."""

    name = "embree"

    def __init__(self, vertices: Float, faces: NDArray[np.int32]) -> None:
        """Build the tree over vertices (n, 3) and faces (m, 3)."""
        from embreex import rtcore_scene
        from embreex.mesh_construction import TriangleMesh

        self._scene: Any = rtcore_scene.EmbreeScene(robust=True)
        self._mesh: Any = TriangleMesh(self._scene, vertices.astype(np.float32), faces)
        self._run(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32))  # the tree is built by the first ray

    def nearest(self, origins: Float32, directions: Float32) -> Found:
        """See Backend."""
        found = _shared(self._run, origins, directions)
        return np.concatenate([face for face, _ in found]), np.concatenate([near for _, near in found])

    def blocked(self, origins: Float32, directions: Float32, reach: float) -> Mask:
        """See Backend."""

        def work(origins: Float32, directions: Float32) -> Mask:
            end = np.full(len(origins), reach, np.float32)
            return np.asarray(self._scene.run(origins, directions, end, "OCCLUDED") >= 0)

        return np.concatenate(_shared(work, origins, directions))

    def _run(self, origins: Float32, directions: Float32) -> Found:
        found = self._scene.run(origins, directions, output=True)
        return found["primID"].astype(np.int32, copy=False), found["tfar"]


def _shared(work: Callable[[Float32, Float32], T], origins: Float32, directions: Float32) -> list[T]:
    """`work` of rays, in one piece or in one for each core."""
    if CORES == 1 or len(origins) < SHARED_FROM:
        return [work(origins, directions)]
    return in_threads(work, np.array_split(origins, CORES), np.array_split(directions, CORES))


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

    def blocked(self, origins: Float32, directions: Float32, reach: float) -> Mask:
        """See Backend."""
        rays = np.concatenate([origins, directions], axis=1)
        return np.asarray(self._scene.test_occlusions(self._tensor(rays), tfar=reach).numpy())


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
