# SPDX-License-Identifier: Apache-2.0
"""Third question of the demonstration: is every part in its place? On the day after one is gone and one is displaced."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from toftwin.demo.sessions import LATER, changed
from toftwin.inputs import opened

if TYPE_CHECKING:
    from pathlib import Path

    from tof_inspect.judge import PartVerdict
    from tof_scene.scene import Scene
    from toftwin.demo.config import DemoConfig
    from toftwin.demo.sessions import Changed


@dataclass(frozen=True, slots=True, eq=False)
class Inspected:
    """The truth, the verdicts in words and by part, and pictures of the parts that are absent or displaced."""

    truth: Changed
    sentence: str
    verdicts: tuple[PartVerdict, ...]
    pictures: dict[str, str]

    @property
    def judged(self) -> int:
        """Number of parts with a verdict; the others are not observable."""
        return sum(v.state != "not_observable" for v in self.verdicts)

    @property
    def right(self) -> int:
        """Number of correct verdicts."""
        true = {self.truth.gone: "absent", self.truth.moved: "displaced"}
        return sum(v.state == true.get(v.name, "present") for v in self.verdicts)


def inspect(folder: Path, scene_path: Path, scene: Scene, config: DemoConfig) -> Inspected:
    """Inspect the day after as `toftwin inspect --sensor` does, into `inspection/`."""
    from tof_inspect.judge import Inspector
    from tof_inspect.report import picture, sentence, write
    from tof_scene.raycast import Raycaster
    from tof_sensor.known import known_bias
    from toftwin.inspection import InspectionConfig, inspect_bag

    settings = InspectionConfig()
    inspector = Inspector(Raycaster(scene), settings.inspect, settings.align, bias=known_bias(folder / "gap" / "sensor.yaml"))
    with opened(folder / LATER, scene_path, settings) as (reader, _):
        found = inspect_bag(reader, inspector, settings)
    write(inspector, found, folder / "inspection", "the day after")
    wrong = [v for v in found.verdicts if v.state in ("absent", "displaced")]
    pictures = {v.name: picture(inspector, v, found.views, found.posed) for v in wrong}
    return Inspected(changed(scene, config), sentence(found.verdicts), found.verdicts, pictures)
