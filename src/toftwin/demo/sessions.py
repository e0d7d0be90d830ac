# SPDX-License-Identifier: Apache-2.0
"""Recorded sessions of the demonstration: a first day, the day after with a part gone and one displaced, and that day by the fitted sensor."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from tof_core.config import from_mapping
from tof_scene.scene_file import load_scene
from tof_virtual.calibrate import resize
from tof_virtual.config import VirtualConfig
from tof_virtual.record import record, record_session
from tof_virtual.session import Session
from tof_virtual.truth import load_truth
from toftwin.commands.simulate import bodies_of, parse_effects

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from tof_scene.scene import Scene
    from tof_virtual.body import Body
    from toftwin.demo.config import DemoConfig

TODAY, LATER, FITTED = "bag", "later/bag", "fitted/bag"
"""Bags of the first day, of the day after, and of the day after by the fitted sensor; the truth is beside them."""
DAY_S = 86_400


@dataclass(frozen=True, slots=True)
class Changed:
    """Changes of the second day: an absent part, and a part displaced by `shift_m` (3,) in the cell; "" for none."""

    gone: str
    moved: str
    shift_m: tuple[float, float, float]


def today(folder: Path, config: DemoConfig) -> Path:
    """Record the first day and write the scene; returns scene.yaml."""
    from tof_scene.builtin import write_builtin

    scene = write_builtin(config.scene, folder / "scene")
    record(bodies_of(load_scene(scene)), folder / TODAY, virtual(config), effects=effects_of(config), truth_path=folder / "truth")
    return scene


def later(folder: Path, scene: Scene, config: DemoConfig, change: Changed) -> None:
    """Record the day after: the same plan and camera, other errors of the robot, one part gone and one displaced."""
    session = Session(bodies_of(scene), virtual(config, day=1), effects_of(config), standing(scene, change))
    resize(session, sizes(folder))
    record_session(session, folder / LATER, truth_path=folder / "later" / "truth")


def fitted(folder: Path, scene: Scene, config: DemoConfig) -> None:
    """Simulate the same day: an ideal camera, the effects that the diagnosis fitted, and the unchanged CAD."""
    from tof_sensor.model import load_model
    from toftwin.sensed import modelled

    session = Session(bodies_of(scene), virtual(config, day=1), {})
    session.config = replace(session.config, day=2)  # the robot's errors are drawn; photons are others than the camera's
    sensor = modelled(load_model(folder / "gap" / "sensor.yaml"), scene)
    record_session(session, folder / FITTED, truth_path=folder / "fitted" / "truth", sensor=sensor)


def virtual(config: DemoConfig, day: int = 0) -> VirtualConfig:
    """Settings of the virtual robot on a day."""
    values: dict[str, Any] = {
        "camera.width": config.width,
        "camera.height": config.height,
        "plan.views": config.views,
        "plan.stations": config.stations,
        "plan.captures": config.captures if day == 0 else config.later_captures,
        "output.colour": day == 0,
        "output.start_s": VirtualConfig().output.start_s + day * DAY_S,
        "seed": config.seed,
        "day": day,
    }
    return from_mapping(VirtualConfig, values)


def effects_of(config: DemoConfig) -> dict[str, float]:
    """Effects of the camera by name, with their strengths."""
    return parse_effects([e for e in config.effects.split(",") if e])


def sizes(folder: Path) -> Mapping[str, float]:
    """Physical sizes of the camera's effects, from the truth of the first day."""
    _, meta = load_truth(folder / "truth")
    return {name: effect["size"] for name, effect in meta["effects"].items()}


def changed(scene: Scene, config: DemoConfig) -> Changed:
    """Displace the largest inspected part along the wall, and take away the one of median size."""
    parts = sorted((p for p in scene.parts if p.inspect), key=lambda p: float(np.linalg.norm(np.ptp(p.vertices, axis=0))))
    gone = parts[len(parts) // 2].name if len(parts) > 1 else ""
    return Changed(gone, parts[-1].name if parts else "", (0.0, 1e-3 * config.moved_mm, 0.0))


def standing(scene: Scene, change: Changed) -> list[Body]:
    """The bodies of the second day."""
    bodies = [b for b in bodies_of(scene) if b.name != change.gone]
    return [replace(b, vertices=b.vertices + change.shift_m) if b.name == change.moved else b for b in bodies]
