# SPDX-License-Identifier: Apache-2.0
"""The two ray casting libraries, embreex and open3d. Both contain Intel's Embree, built and called differently."""

from __future__ import annotations

from threading import Lock
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
"""Least number of rays for which threads save time."""
ORDER = ("embree", "open3d")
"""The order in which `auto` tries them. Their processor times are equal (`python -m benchmarks --only scene`
measures both); embreex adds 19 MB to a process, open3d 190."""


class Backend(Protocol):
    """First hits of float32 rays."""

    name: str

    def nearest(self, origins: Float32, directions: Float32) -> Found:
        """Face (N,) int32, -1 for none, and its distance (N,) in lengths of the direction."""
        ...

    def blocked(self, origins: Float32, directions: Float32, reach: float) -> Mask:
        """(N,) whether a ray hits anything within `reach` lengths of its direction; faster than `nearest`."""
        ...


class EmbreeBackend:
    """embreex: Embree 4. Many rays are split between the cores; embreex releases the interpreter lock."""

    name = "embree"

    def __init__(self, vertices: Float, faces: NDArray[np.int32]) -> None:
        """Take vertices (n, 3) and faces (m, 3); the first ray builds the tree."""
        from embreex import rtcore_scene
        from embreex.mesh_construction import TriangleMesh

        self._scene: Any = rtcore_scene.EmbreeScene(robust=True)
        self._mesh: Any = TriangleMesh(self._scene, vertices.astype(np.float32), faces)
        self._building, self._built = Lock(), False

    def nearest(self, origins: Float32, directions: Float32) -> Found:
        """See Backend."""
        self._build()
        found = _shared(self._run, origins, directions)
        return np.concatenate([face for face, _ in found]), np.concatenate([near for _, near in found])

    def blocked(self, origins: Float32, directions: Float32, reach: float) -> Mask:
        """See Backend."""

        def work(origins: Float32, directions: Float32) -> Mask:
            end = np.full(len(origins), reach, np.float32)
            return np.asarray(self._scene.run(origins, directions, end, "OCCLUDED") >= 0)

        self._build()
        return np.concatenate(_shared(work, origins, directions))

    def _build(self) -> None:
        """Cast the first ray, in one thread."""
        with self._building:
            if not self._built:
                self._run(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32))
                self._built = True

    def _run(self, origins: Float32, directions: Float32) -> Found:
        found = self._scene.run(origins, directions, output=True)
        return found["primID"].astype(np.int32, copy=False), found["tfar"]


def _shared(work: Callable[[Float32, Float32], T], origins: Float32, directions: Float32) -> list[T]:
    """Results of `work` on all rays at once, or on one piece per core."""
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
    """The backend of that name; `auto`: the first installed in `ORDER`."""
    if name != "auto" and name not in BACKENDS:
        raise UsageError(f"there is no ray caster '{name}'", where="backend", todo=f"use auto, {' or '.join(BACKENDS)}")
    for choice in ORDER if name == "auto" else (name,):
        try:
            return BACKENDS[choice](vertices, faces)
        except ImportError:
            continue
    missing = "embreex or open3d" if name == "auto" else {"embree": "embreex"}.get(name, name)
    raise UsageError(f"the ray caster '{name}' is not installed", where="backend", todo=f"pip install {missing}")
