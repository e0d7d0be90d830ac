# SPDX-License-Identifier: Apache-2.0
"""Sessions of the virtual robot for benches, recorded once and kept in out/bench."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tof_core.bag import open_bag
from tof_core.capture import View
from tof_core.config import from_mapping
from tof_core.hashing import digest_config
from tof_core.motion import StationTracker
from tof_scene.builtin import make_builtin
from tof_virtual.body import Body
from tof_virtual.config import VirtualConfig
from tof_virtual.record import record
from tof_virtual.truth import load_truth

if TYPE_CHECKING:
    from collections.abc import Mapping

    from tof_scene.scene import Scene

FOLDER = Path(__file__).resolve().parent.parent / "out" / "bench"


@dataclass(frozen=True, slots=True, eq=False)
class Recorded:
    """A recorded session: its scene, its bag, and the truth of its views."""

    scene: Scene
    bag: Path
    truth: dict[str, Any]

    def views(self) -> list[View]:
        """One view per capture, unfiltered, with its station."""
        tracker = StationTracker()
        with open_bag(self.bag, cell_frame=self.scene.frame) as reader:
            return [View.of_capture(c, tracker.push(c.robot.T_cell_body)) for c in reader.captures() if c.robot is not None]


def recorded(name: str, config: Mapping[str, Any], effects: Mapping[str, float] | None = None, *, astray: bool = False) -> Recorded:
    """A session in a built-in scene with these values of `VirtualConfig` and these effects."""
    return recorded_in(name, make_builtin(name), config, effects, astray=astray)


def recorded_in(
    name: str, scene: Scene, config: Mapping[str, Any], effects: Mapping[str, float] | None = None, *, astray: bool = False
) -> Recorded:
    """The same in any scene.

    As in `toftwin simulate`, the robot comes to look at the parts to be inspected; `astray` it looks at anything in the cell.
    """
    bodies = [Body(p.name, p.vertices, p.faces, p.material.albedo, p.material.roughness, p.inspect and not astray) for p in scene.parts]
    subjects = [b.name for b in bodies if b.subject]
    key = digest_config({"scene": scene.digest, "subjects": subjects, "config": dict(config), "effects": dict(effects or {})})
    bag = FOLDER / f"{name}-{key}"
    truth = bag.with_name(f"{bag.name}.truth")
    if not truth.with_name(f"{truth.name}.json").exists():
        _remove(bag)
        record(bodies, bag, from_mapping(VirtualConfig, config), effects=dict(effects or {}), truth_path=truth)
    return Recorded(scene, bag, load_truth(truth)[0])


def _remove(bag: Path) -> None:
    """Take away what a run that was broken off has left."""
    import shutil

    shutil.rmtree(bag, ignore_errors=True)
    bag.parent.mkdir(parents=True, exist_ok=True)
