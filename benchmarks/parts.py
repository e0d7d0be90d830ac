# SPDX-License-Identifier: Apache-2.0
"""Scenes to inspect: a built-in scene with parts of 5 to 60 mm set on its surfaces anywhere, most of them in the colour of what they stand on."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from tof_scene.builtin import builtin_names, make_builtin
from tof_scene.builtin.shapes import box, cylinder, hexagon_bolt, lathe
from tof_scene.raycast import Raycaster
from tof_scene.scene import Material, Part, Scene

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_scene.builtin.shapes import Solid

SIZES_MM = 5.0, 60.0
COUNT = 24
OTHER_COLOUR = 0.25
"""Share of parts that have another colour than their background."""


@dataclass(frozen=True, slots=True)
class Fate:
    """What became of a part: present, absent or displaced (by `shift`, metres, cell)."""

    state: str
    shift: tuple[float, float, float] = (0.0, 0.0, 0.0)


def furnished(build: int) -> Scene:
    """A scene by number: one built-in scene after the other, its own inspected parts left as they are, `COUNT` more set on its surfaces."""
    rng, scene = np.random.default_rng([build, 4]), make_builtin(builtin_names()[build % 3])
    bare = Raycaster(Scene(scene.frame, tuple(p for p in scene.parts if not p.inspect), None, scene.folder))
    made: list[Part] = []
    taken: list[tuple[Float, float]] = []
    for _ in range(60 * COUNT):
        size = float(np.exp(rng.uniform(*np.log(SIZES_MM)))) / 1e3
        spot = _spot(bare, rng, size)
        if spot is None or any(np.linalg.norm(spot[0] - at) < 0.7 * (size + other) + 0.01 for at, other in taken):
            continue
        at, normal, albedo = spot
        taken.append((at, size))
        if rng.uniform() < OTHER_COLOUR:
            albedo = float(rng.uniform(0.05, 0.85))
        vertices, faces = _solid(rng, size)
        turn = _upright(normal, rng.uniform(0, 2 * np.pi))
        made.append(
            Part(
                f"p{len(made)}_{1e3 * size:.0f}mm",
                vertices @ turn.T + at,
                faces,
                Material(round(albedo, 3)),
                inspect=True,
                tolerance_mm=2.0,
            )
        )
        if len(made) == COUNT:
            break
    return replace(scene, parts=(*scene.parts, *made), digest="")


def fates(scene: Scene, build: int) -> dict[str, Fate]:
    """What became of each inspected part: gone with probability 0.3; of the others 0.3 lie 4 to 9 mm off, slid along what they stand on."""
    rng, out = np.random.default_rng([build, 5]), {}
    for part in scene.parts:
        if part.inspect:
            gone, off = rng.uniform() < 0.3, rng.uniform() < 0.3
            out[part.name] = Fate("absent") if gone else Fate("displaced", _slide(part, rng)) if off else Fate("present")
    return out


def as_built(scene: Scene, fate: dict[str, Fate]) -> Scene:
    """The scene as it really stands."""
    there = [p for p in scene.parts if p.name not in fate or fate[p.name].state != "absent"]
    moved = [replace(p, vertices=p.vertices + fate[p.name].shift) if p.name in fate else p for p in there]
    return replace(scene, parts=tuple(moved), digest="")


def _slide(part: Part, rng: np.random.Generator) -> tuple[float, float, float]:
    """Across the flattest extent of the part, which is along its surface for a part that lies; a lathe's is random."""
    _, _, axes = np.linalg.svd(part.vertices - part.vertices.mean(axis=0), full_matrices=False)
    direction = rng.normal(size=2) @ axes[:2]
    x, y, z = direction / np.linalg.norm(direction) * rng.uniform(4e-3, 9e-3)
    return float(x), float(y), float(z)


def _spot(bare: Raycaster, rng: np.random.Generator, size: float) -> tuple[Float, Float, float] | None:
    """A flat place that a robot before the scene may see: point, normal, albedo; None where a random look finds none."""
    eye = np.array([1.4, 0.0, 0.9]) + rng.uniform(-1, 1, 3) * (0.2, 0.9, 0.5)
    target = np.array([0.05, 0.0, 0.8]) + rng.uniform(-1, 1, 3) * (0.1, 0.45, 0.3)
    hit = bare.cast(eye, (target - eye)[None])
    part = int(hit.part[0])
    if part < 0 or bare.scene.parts[part].name in {"floor", "wall"}:
        return None
    point, normal = eye + (target - eye) * hit.t[0], hit.normal[0]
    turn = _upright(normal, 0.0)
    ring = np.array([[np.cos(a), np.sin(a)] for a in np.arange(12) * np.pi / 6]) * 0.55 * size
    around = bare.cast(point + normal * 0.2 + ring @ turn[:, :2].T, np.broadcast_to(-normal, (12, 3)))
    flat = (np.abs(around.t - 0.2) < 0.04 * size + 3e-4) & (around.part == part)
    return (point, normal, float(bare.albedo[part])) if flat.all() else None


def _solid(rng: np.random.Generator, size: float) -> Solid:
    """A part whose largest extent is `size` metres, standing on z = 0 and let in by 0.3 mm."""
    kind, flat = rng.integers(4), rng.uniform(0.35, 0.9)
    if kind == 0:
        vertices, faces = box((size, size * rng.uniform(0.5, 1), size * flat), (0, 0, 0.5 * size * flat), 2)
    elif kind == 1:
        vertices, faces = cylinder(0.5 * size, flat * size, 32)
    elif kind == 2:
        vertices, faces = hexagon_bolt(size / 2.1)
    else:
        h = flat * size
        vertices, faces = lathe([(0, 0), (0.5 * size, 0), (0.5 * size, 0.3 * h), (0.25 * size, 0.4 * h), (0.2 * size, h), (0, h)], 32)
    return vertices - [0, 0, 3e-4], faces


def _upright(normal: Float, angle: float) -> Float:
    """Rotation (3, 3) that brings z to `normal`."""
    x = np.cross([0.3, 0.5, 0.8], normal)
    x /= np.linalg.norm(x)
    y = np.cross(normal, x)
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * x + s * y, c * y - s * x, normal], axis=1)
