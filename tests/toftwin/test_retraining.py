# SPDX-License-Identifier: Apache-2.0
"""`toftwin gap --retrain`: what the diagnosis found, learned from, repairs the real session better than learning without it."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest

from tests.toftwin.once import once
from tof_core.errors import UsageError
from tof_sensor.effects.photon_law import PhotonLaw
from tof_sensor.model import SensorModel
from toftwin import diagnosis
from toftwin.cli import main
from toftwin.retraining import RetrainConfig, retrain

if TYPE_CHECKING:
    from pathlib import Path

SMALL = ["retrain.views=18", "retrain.train.net.base=8", "retrain.train.net.levels=3", "retrain.train.epochs=8", "retrain.train.threads=1"]


def session(folder: Path, effects: dict[str, float]) -> list[str]:
    """A small session of the virtual robot; the call that diagnoses it and learns from the diagnosis."""
    from tof_core.config import from_mapping
    from tof_scene.builtin import write_builtin
    from tof_scene.scene_file import load_scene
    from tof_virtual.config import VirtualConfig
    from tof_virtual.record import record
    from toftwin.commands.simulate import bodies_of

    scene = write_builtin("body_section", folder / "scene")
    config = from_mapping(VirtualConfig, {"seed": 5, "camera.width": 112, "camera.height": 86, "plan.views": 8})
    record(bodies_of(load_scene(scene)), folder / "bag", config, effects=effects)
    settings = [word for s in SMALL for word in ("--set", s)]
    return ["gap", str(folder / "bag"), "--scene", str(scene), "--out", str(folder / "gap"), "--retrain", *settings]


@pytest.mark.slow
@pytest.mark.usefixtures("no_page")
def test_learning_from_the_fitted_sensor_lowers_the_real_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("torch", reason="training needs the extra `train`")
    monkeypatch.setattr(diagnosis, "diagnose_bag", once(diagnosis.diagnose_bag))
    call = session(tmp_path, {"wiggling": 3.0})
    assert main(call) == 0
    made = tmp_path / "gap" / "retrain"
    result = json.loads((made / "retrain.json").read_text())
    assert "wiggling" in result["effects"]
    assert result["with_mm"] < 0.7 * result["without_mm"]
    assert result["with_mm"] < 0.7 * result["raw_mm"]
    # Again, after the last result was lost: what is there is not made again.
    (made / "retrain.json").unlink()
    before = {p: p.stat().st_mtime_ns for p in made.glob("*.onnx")}
    assert main(call) == 0
    assert json.loads((made / "retrain.json").read_text()) == result
    assert {p: p.stat().st_mtime_ns for p in made.glob("*.onnx")} == before


def test_without_a_cause_there_is_nothing_to_learn(tmp_path: Path) -> None:
    photons = SensorModel((PhotonLaw(),))
    with pytest.raises(UsageError, match="named no effect that training could use"):
        retrain(None, photons, None, tmp_path, RetrainConfig())  # type: ignore[arg-type]
