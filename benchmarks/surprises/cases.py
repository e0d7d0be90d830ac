# SPDX-License-Identifier: Apache-2.0
"""Sessions with surprises: what is drawn, and how it is recorded."""

from __future__ import annotations

import json
import shutil
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.emerging.record import record
from benchmarks.emerging.strength import calibrate
from benchmarks.gap_check.foreign.cases import ROBOTS, SCENES, ForeignCase
from benchmarks.gap_check.foreign.record import planned
from tof_core.config import updated

if TYPE_CHECKING:
    from pathlib import Path

    from benchmarks.emerging.session import EmergingSession
    from tof_core.arrays import Float

KINDS = ("none", "foreign", "missing", "displaced", "arm", "foreign", "missing", "arm and foreign")
"""Kinds of eight sessions."""
USUAL = ("slow_driver", "charge_traps", "flood_light", "cold_start", "long_pulse")
"""Causes of the camera's usual effects: wiggling, amplitude bias, multipath, drift."""
USUAL_STRENGTH = (0.4, 1.2)
"""Bounds of each cause's strength; 1 is 3 mm RMS over the affected pixels."""
FOREIGN_M = (0.09, 0.25)
"""Bounds of the foreign box's mean edge; each side is 0.6 to 1.4 times that, so that none is below 5 cm."""
DISPLACED_MM = (20.0, 60.0)
"""Bounds of the displacement of parts."""
ARM_SHARE = 0.5
"""Share of the views into which a person's arm reaches."""
AS_CAD = {"world.foreign_m": 0.0, "world.missing": False, "world.moved_mm": 0.0, "world.arm_share": 0.0}
"""The world without any surprise."""


@dataclass(frozen=True, slots=True)
class Case:
    """One session: its kind, the session of the emerging camera, and how the world is."""

    name: str
    kind: str
    session: ForeignCase
    world: dict[str, Any] = field(default_factory=dict)


def draw(count: int, seed: int, views: int = 12, *, effects: bool = True) -> list[Case]:
    """`count` sessions, each by its own number; `effects`: with two of the camera's usual effects."""
    return [_case(number, seed, views, effects=effects) for number in range(count)]


def _case(number: int, seed: int, views: int, *, effects: bool) -> Case:
    rng = np.random.default_rng([seed, number])
    kind = KINDS[number % len(KINDS)]
    low, high = USUAL_STRENGTH
    causes = {str(c): float(rng.uniform(low, high)) for c in rng.choice(USUAL, 2, replace=False)} if effects else {}
    foreign, moved = float(rng.uniform(*FOREIGN_M)), float(rng.uniform(*DISPLACED_MM))
    world = {
        "world.foreign_m": foreign if "foreign" in kind else 0.0,
        "world.missing": "missing" in kind,
        "world.moved_mm": moved if "displaced" in kind else 0.0,
        "world.moved_parts": 1,
        "world.arm_share": ARM_SHARE if "arm" in kind else 0.0,
    }
    session = ForeignCase(
        name=f"case{number:04d}",
        kind=kind,
        scene=SCENES[(number + number // len(KINDS)) % len(SCENES)],
        robot=list(ROBOTS)[(number // 3) % len(ROBOTS)],
        causes=causes,
        left_out="",
        seed=int(rng.integers(1, 2**31)),
        settings={"plan.views": views, "plan.pause_s": 5.0},
    )
    return Case(session.name, kind, session, world)


def record_case(case: Case, folder: Path, size: tuple[int, int]) -> None:
    """`folder`: bag, scene, truth.npz, truth.json and case.json of a case; kept where they are complete."""
    if (folder / "case.json").exists():
        return
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    session = planned(case.session, folder / "scene", size)
    session.healthy = updated(session.healthy, case.world)
    reached = calibrate(session, case.session.causes)
    record(session, folder / "bag", folder / "truth", case.session.causes, reached)
    np.savez_compressed(folder / "cad.npz", depth=as_cad(session))
    (folder / "case.json").write_text(json.dumps({"kind": case.kind, "world": case.world, **case.session.to_dict()}, indent=1))


def as_cad(session: EmergingSession) -> Float:
    """(V, H, W) true depth, metres, that the same camera would see from the same poses if the world were as its CAD; a view is a stop.

    With the camera's true lens, which differs from the published one: what differs from the truth is the world's doing alone.
    """
    device = updated(session.device(), AS_CAD)
    first = {shutter.stop: shutter for shutter in reversed(session.shutters)}
    return np.stack([session.view(first[stop], device).z.reshape(session.camera.shape) for stop in sorted(first)])
