# SPDX-License-Identifier: Apache-2.0
"""The scene without one of its inspected parts, from two search trees: the fixed parts and the inspected parts."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from tof_core.errors import SceneError
from tof_scene.raycast import Raycaster

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tof_core.arrays import Float
    from tof_scene.scene import Scene

STEP_M = 1e-6
"""Distance behind a face of the removed part at which a ray continues, metres."""
MOST = 32
"""Most faces of one part that a ray crosses."""


def inspected(scene: Scene) -> tuple[str, ...]:
    """Names of the parts that are inspected, at least one.

    Raises:
        SceneError: the scene marks none.
    """
    names = tuple(part.name for part in scene.parts if part.inspect)
    if not names:
        raise SceneError("no part has `inspect: true`", where=scene.folder, todo="mark the parts to inspect in scene.yaml")
    return names


@dataclass(frozen=True, slots=True, eq=False)
class Behind:
    """First hits of N rays in the remaining scene.

    t (N,) in lengths of the direction, NaN for a miss; part (N,) its number in the whole scene, -1 for a miss;
    normal (N, 3) unit, cell frame, toward the origin.
    """

    t: Float
    part: NDArray[np.int64]
    normal: Float


@dataclass(frozen=True, slots=True, eq=False)
class _Tree:
    """A subset of the scene's parts, and their numbers in the scene (-1 last, for a miss)."""

    caster: Raycaster
    numbers: NDArray[np.int64]

    @classmethod
    def of(cls, scene: Scene, numbers: list[int]) -> _Tree | None:
        if not numbers:
            return None
        some = replace(scene, parts=tuple(scene.parts[i] for i in numbers), digest="")
        return cls(Raycaster(some), np.array([*numbers, -1]))

    def cast(self, origin: Float, directions: Float, part: int) -> Behind:
        """First hits without part number `part` of the scene: a ray continues behind this part."""
        hits = self.caster.cast(origin, directions)
        t, number, normal = hits.t.copy(), self.numbers[hits.part], hits.normal.copy()
        length = np.linalg.norm(directions, axis=1)
        for _ in range(MOST):
            on = np.flatnonzero(number == part)
            if not len(on):
                break
            start = t[on] + STEP_M / length[on]
            further = self.caster.cast(origin + directions[on] * start[:, None], directions[on])
            t[on], number[on], normal[on] = start + further.t, self.numbers[further.part], further.normal
        gone = number == part
        t[gone], number[gone] = np.nan, -1
        return Behind(t, number, normal)


class Split:
    """A scene as two search trees, so that a part left out does not hide another part that touches it face to face."""

    def __init__(self, scene: Scene) -> None:
        """Build both trees."""
        marked = [part.inspect for part in scene.parts]
        self._trees = [tree for want in (False, True) if (tree := _Tree.of(scene, [i for i, m in enumerate(marked) if m is want]))]

    def without(self, part: int) -> Without:
        """The scene without part number `part`, an inspected part."""
        return Without(self._trees, part)


@dataclass(frozen=True, slots=True, eq=False)
class Without:
    """Ray casting against the scene without one part."""

    trees: list[_Tree]
    part: int

    def cast(self, origin: Float, directions: Float) -> Behind:
        """First hits of rays from origin (3,) along directions (N, 3), cell frame, any length."""
        first, *others = [tree.cast(origin, directions, self.part) for tree in self.trees]
        t, part, normal = first.t, first.part, first.normal
        for other in others:
            nearer = np.isfinite(other.t) & ~(t <= other.t)
            t, part = np.where(nearer, other.t, t), np.where(nearer, other.part, part)
            normal = np.where(nearer[:, None], other.normal, normal)
        return Behind(t, part, normal)
