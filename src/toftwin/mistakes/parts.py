# SPDX-License-Identifier: Apache-2.0
"""Parts of the wrong size or in the wrong place, by their numbers alone and by the views."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import yaml

from tof_scene.raycast import Raycaster
from toftwin.mistakes.fit import loose
from toftwin.mistakes.hypotheses import Mistake

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path
    from typing import Any

    from tof_core.arrays import Float
    from tof_scene.scene import Part, Scene
    from toftwin.mistakes.fit import Taken

TINY_M = 0.003
"""Longest side in metres below which no camera of an arm sees a part."""
MANY = 0.3
"""Share of parts that are too small, from which the whole scene has the wrong unit."""
FAR = 10.0
"""Distance of a part from the others' middle, over the others' extent, from which the part is too far away."""
LEAST_FAR_M = 5.0
"""Parts nearer than this to the others' middle are never too far away."""
IN_METRES = (".step", ".stp", ".glb", ".gltf")
"""Mesh files that state their unit: they are read in metres."""
MOST_PARTS = 40
"""Largest number of parts for which each is left out in turn."""
SCALES = (1e-3, 1e3, 0.0254, 1 / 0.0254, 0.1, 10.0)
"""Factors by which the scale of a mesh is usually wrong."""
GAINED, REST = 0.1, 0.8
"""A part is wrong if without it this share of pixels more fits, and at least this share in all: the rest of the scene is right then."""


def suspicious(scene: Scene, path: Path) -> Iterator[tuple[bool, str, str]]:
    """Parts whose size or place is implausible: whether it must be fixed, what, and the line to change."""
    entries = _entries(path)
    tiny = [p.name for p in scene.parts if np.ptp(p.vertices, axis=0).max() < TINY_M]
    if len(tiny) > max(1.0, MANY * len(scene.parts)):
        yield (
            True,
            f"{len(tiny)} of {len(scene.parts)} parts are smaller than {1e3 * TINY_M:g} mm: {', '.join(tiny[:3])}, ...",
            f"{path.name}: check the scale of the meshes",
        )
        return
    middles = np.array([part.vertices.mean(axis=0) for part in scene.parts])
    for k, part in enumerate(scene.parts):
        size, entry = np.ptp(part.vertices, axis=0), entries.get(part.name, {})
        scale, mesh = entry.get("scale"), str(entry.get("mesh", "")).lower()
        stated = f"part '{part.name}' is {_size(size)}"
        if size.max() < TINY_M:
            todo = (
                "remove its scale: STEP and GLB are read in metres"
                if mesh.endswith(IN_METRES) and scale
                else "check its scale (1 for a mesh in metres)"
            )
            yield True, f"{stated}: too small to be seen", f"{path.name}: {todo}"
        elif mesh.endswith(IN_METRES) and scale not in (None, 1, 1.0):
            yield (
                False,
                f"{stated}, with scale {scale}",
                f"{path.name}: STEP and GLB are read in metres; without a scale it is {_size(size / float(scale))}",
            )
        others = np.delete(middles, k, axis=0)
        if len(others) > 1:
            away = float(np.linalg.norm(middles[k] - np.median(others, axis=0)))
            extent = float(np.linalg.norm(np.ptp(others, axis=0)))
            if away > max(LEAST_FAR_M, FAR * extent):
                yield True, f"part '{part.name}' is {away:.0f} m from the others", f"{path.name}: give its pose in metres"


def sizes(scene: Scene) -> str:
    """Size of the cell and of its largest and smallest part, in words."""
    low, high = scene.bounds()
    by_size = sorted(scene.parts, key=lambda p: float(np.ptp(p.vertices, axis=0).max()))
    small, large = by_size[0], by_size[-1]
    named = f"{_size(high - low)} in all; largest '{large.name}' {_size(np.ptp(large.vertices, axis=0))}"
    return named + (f", smallest '{small.name}' {_size(np.ptp(small.vertices, axis=0))}" if small is not large else "")


def wrong_part(taken: Taken, caster: Raycaster) -> tuple[float, Mistake] | None:
    """The part without which the views fit best, and the fitting share with a common mistake in it undone, if one does."""
    scene = caster.scene
    if not 1 < len(scene.parts) <= MOST_PARTS:
        return None
    bare = [(loose(taken, Raycaster(scene.without(p.name))), p) for p in scene.parts]
    share, part = max(bare, key=lambda b: b[0])
    before = loose(taken, caster)
    if share < max(before + GAINED, REST):
        return None
    size = _size(np.ptp(part.vertices, axis=0))
    stands = f"part '{part.name}' ({size}) stands where the camera sees through"
    repaired = [(loose(taken, _with(caster.scene, part, fixed)), todo) for fixed, todo in _repairs(scene, part)]
    better, todo = max(repaired, key=lambda r: r[0], default=(0.0, ""))
    if better > share + 0.01:
        return better, Mistake(stands, f"scene.yaml, part '{part.name}': {todo}", lambda view: view)
    return share, Mistake(stands, f"scene.yaml, part '{part.name}': check its scale and its pose", lambda view: view)


def _repairs(scene: Scene, part: Part) -> Iterator[tuple[Float, str]]:
    """Vertices of the part with a common mistake undone, and the line to change."""
    entry = _entries(scene.folder / "scene.yaml").get(part.name, {})
    pose = entry.get("pose")
    origin = np.array(pose[:3], float) if isinstance(pose, list) and len(pose) == 7 else np.zeros(3)
    now = float(entry.get("scale") or 1.0)
    for factor in SCALES:
        yield origin + factor * (part.vertices - origin), f"scale should be {now * factor:.4g}, not {now:g}"
    for factor in (1e-3, 1e3, 0.0254):
        yield part.vertices + (factor - 1) * origin, f"its position is in another unit: multiply it by {factor:g}"


def _with(scene: Scene, part: Part, vertices: Float) -> Raycaster:
    parts = tuple(replace(p, vertices=vertices) if p is part else p for p in scene.parts)
    return Raycaster(replace(scene, parts=parts, digest=""))


def _entries(path: Path) -> dict[str, dict[str, Any]]:
    """The entries of scene.yaml's parts by name; none where the scene came from elsewhere."""
    path = path / "scene.yaml" if path.is_dir() else path
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
        return {str(p["name"]): p for p in content["parts"]}
    except (OSError, KeyError, TypeError, yaml.YAMLError):
        return {}


def _size(metres: Float) -> str:
    unit, name = (1e3, "mm") if metres.max() < 0.1 else (1.0, "m")
    return " x ".join(f"{unit * m:.3g}" for m in metres) + f" {name}"
