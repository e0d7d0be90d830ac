# SPDX-License-Identifier: Apache-2.0
"""The closed loop: ideal views through a fitted camera, diagnosed with the same camera known, whole and less one effect."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks.figure import Figure, at_least
from benchmarks.ideal import ideal_bag
from benchmarks.recorded import recorded

if TYPE_CHECKING:
    from tof_core.options import BagOptions
    from tof_gap.tell.diagnosis import Diagnosis
    from tof_scene.scene import Scene
    from tof_sensor.model import SensorModel

LONG = True
SCENE, STRENGTHS = "body_section", {"wiggling": 1.0, "amplitude_bias": 1.0, "lens_scatter": 1.0}
VIEWS = {"plan.views": 16, "plan.captures": 3, "plan.stations": 2, "camera.width": 224, "camera.height": 171}
OUT = Path("out/bench/sensor")


def run() -> list[Figure]:
    """Of the verdicts, how many are right: `none` with the whole model known, the missing effect with one deleted."""
    shutil.rmtree(OUT, ignore_errors=True)
    OUT.mkdir(parents=True)
    fitted, verdict = _fitted()
    measured = _measured(fitted)
    rows = [("", _verdict(measured, fitted)), *((name, _verdict(measured, fitted.without(name))) for name in _biases(fitted))]
    right = 0
    for name, found in rows:
        right += found == ((name,) if name else ("none",))
        print(f"known: {'whole model' if not name else f'all but {name}'}: {', '.join(found)}", flush=True)
    remark = f"model fitted to a session with {', '.join(STRENGTHS)}: {', '.join(verdict)}"
    return [
        at_least(
            f"simulated camera, diagnosed with its own model known: verdicts right, of {len(rows)}", right, len(rows), "", remark=remark
        )
    ]


def _biases(model: SensorModel) -> list[str]:
    """Names of the effects that a diagnosis may give."""
    from tof_sensor.registry import VOCABULARY

    return [n for n in model.names if n in VOCABULARY]


def _fitted() -> tuple[SensorModel, tuple[str, ...]]:
    """A camera as the diagnosis of a virtual session has it."""
    from tof_core.options import BagOptions
    from tof_gap.tell.report.files import sensor_model

    session = recorded(SCENE, VIEWS, STRENGTHS)
    found = _diagnosed(session.bag, session.scene, BagOptions(), None)
    return sensor_model(found), found.verdict


def _measured(model: SensorModel) -> Path:
    """Ideal views of another session through the camera."""
    from tof_core.bag import open_bag
    from tof_core.options import BagOptions
    from tof_scene.raycast import Raycaster
    from tof_sensor.model import save_model
    from tof_sensor.simulator import SimulatorConfig
    from toftwin.sensing import sense_bag

    session = recorded(SCENE, VIEWS | {"seed": 1})
    ideal = ideal_bag(session, OUT / "ideal", captures=3)
    save_model(model, OUT / "sensor.yaml")
    with open_bag(ideal, BagOptions(), cell_frame=session.scene.frame) as reader:
        sense_bag(reader, OUT / "measured", SimulatorConfig(model=str(OUT / "sensor.yaml")), Raycaster(session.scene))
    return OUT / "measured"


def _verdict(bag: Path, known: SensorModel) -> tuple[str, ...]:
    from tof_core.options import BagOptions
    from tof_scene.builtin import make_builtin

    return _diagnosed(bag, make_builtin(SCENE), BagOptions(), known).verdict


def _diagnosed(bag: Path, scene: Scene, options: BagOptions, known: SensorModel | None) -> Diagnosis:
    from tof_core.bag import open_bag
    from toftwin.diagnosis import GapPipelineConfig, diagnose_bag

    with open_bag(bag, options, cell_frame=scene.frame) as reader:
        return diagnose_bag(reader, scene, GapPipelineConfig(), known=known)[0]
