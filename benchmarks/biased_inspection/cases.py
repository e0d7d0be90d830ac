# SPDX-License-Identifier: Apache-2.0
"""Sessions in which parts are in their place, gone or displaced, before a camera with wiggling and amplitude bias that nobody modelled."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.gap_check.foreign.scenes import write_foreign
from benchmarks.parts import Fate, as_built, furnished
from tof_core.config import from_mapping
from tof_scene.scene_file import load_scene, save_scene
from tof_virtual.config import VirtualConfig
from toftwin.commands.simulate import bodies_of

if TYPE_CHECKING:
    from pathlib import Path

    from tof_scene.scene import Scene

SIZE, VIEWS = (160, 122), 10
STRENGTH = 0.5
"""Of each effect; 1 is 3 mm RMS over the affected pixels."""
CAMERAS = {
    "virtual": {"wiggling": STRENGTH, "amplitude_bias": STRENGTH},
    "emerging": {"slow_driver": STRENGTH, "charge_traps": STRENGTH},
}
"""Wiggling and amplitude bias: by formula in the project's virtual camera, by their physical causes in the emerging one."""
MOVED_MM = 5.0, 10.0
"""Bounds of a displacement."""
GONE, MOVED = 0.15, 0.25
"""Shares of parts."""


FOREIGN = ("cabinet", "press_tool", "gearbox")
"""Scenes whose own parts are inspected, 5 to 60 cm; in the others, parts of 5 to 60 mm stand on built-in scenes."""


@dataclass(frozen=True, slots=True)
class Case:
    """One session: its number, which is its seed too, its camera, its scene ("" for small parts) and the effects with their strengths."""

    number: int
    camera: str
    scene: str
    effects: dict[str, float]


def draw(count: int, seed: int, *, effects: bool = True) -> list[Case]:
    """`count` sessions: the two cameras in turn, two sessions of small parts and two of large ones in turn."""
    cases = []
    for k in range(count):
        camera = list(CAMERAS)[k % 2]
        cases.append(Case(seed + k, camera, FOREIGN[k // 4 % 3] if k % 4 >= 2 else "", CAMERAS[camera] if effects else {}))
    return cases


def record_case(case: Case, folder: Path) -> dict[str, Fate]:
    """Record `folder`/bag with `folder`/scene, the CAD in which every part stands in its place; returns what became of each part."""
    if case.scene:
        scene = load_scene(write_foreign(case.scene, folder / "scene", case.number))
    else:
        scene = furnished(case.number)
        save_scene(scene, folder / "scene")
    fate = fates(scene, case.number)
    bodies = bodies_of(as_built(scene, fate))
    values: dict[str, Any] = {
        "seed": 5000 + case.number,
        "camera.width": SIZE[0],
        "camera.height": SIZE[1],
        "plan.views": VIEWS,
        "plan.stations": 2,
        "plan.range_max_m": 0.9,
    }
    config = from_mapping(VirtualConfig, values)
    if case.camera == "virtual":
        from tof_virtual.record import record

        record(bodies, folder / "bag", config, effects=case.effects, truth_path=folder / "truth")
        return fate
    from benchmarks.emerging.healthy import draw as healthy
    from benchmarks.emerging.record import record as record_emerging
    from benchmarks.emerging.session import EmergingSession
    from benchmarks.emerging.strength import calibrate

    session = EmergingSession(bodies, config, healthy(np.random.default_rng([case.number, 9]), case.number), {})
    record_emerging(session, folder / "bag", folder / "truth", case.effects, calibrate(session, case.effects))
    return fate


def fates(scene: Scene, number: int) -> dict[str, Fate]:
    """What became of each inspected part: gone, displaced (slid along what it stands on, or lifted off it), or in its place."""
    rng, out = np.random.default_rng([number, 6]), {}
    for part in scene.parts:
        if part.inspect:
            share = rng.uniform()
            out[part.name] = Fate("absent") if share < GONE else _displaced(rng) if share < GONE + MOVED else Fate("present")
    return out


def _displaced(rng: np.random.Generator) -> Fate:
    """In a random direction of the cell, outwards (+x) and upwards (+z), so that it is not driven into what it stands on."""
    direction = rng.normal(size=3)
    direction[[0, 2]] = np.abs(direction[[0, 2]])
    x, y, z = direction / np.linalg.norm(direction) * rng.uniform(*MOVED_MM) * 1e-3
    return Fate("displaced", (float(x), float(y), float(z)))
