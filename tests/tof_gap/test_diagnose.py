# SPDX-License-Identifier: Apache-2.0
"""The diagnosis on small sessions of the virtual robot, whose truth it does not see."""

from __future__ import annotations

import json
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import pytest

from tof_core.config import from_mapping
from tof_core.errors import RefusedError
from tof_gap import diagnose as room
from tof_gap.diagnose import believed, check, unconfirmed
from tof_gap.tell.contradicted import TakenOut
from toftwin.cli import main

if TYPE_CHECKING:
    from pathlib import Path

EFFECTS: dict[str, dict[str, float]] = {"null": {}, "wiggling": {"wiggling": 1.0}, "offset": {"temperature_drift": 1.0}}


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    from tof_scene.builtin import write_builtin

    return write_builtin("body_section", tmp_path_factory.mktemp("scene"))


@pytest.fixture(scope="module", params=sorted(EFFECTS))
def session(request: pytest.FixtureRequest, scene: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Path, dict[str, Any]]:
    """A session with one effect or none, its report, and the report's folder."""
    from tof_scene.scene_file import load_scene
    from tof_virtual.config import VirtualConfig
    from tof_virtual.record import record
    from toftwin.commands.simulate import bodies_of

    folder = tmp_path_factory.mktemp(request.param)
    config = from_mapping(VirtualConfig, {"seed": 5, "camera.width": 112, "camera.height": 86, "plan.views": 9, "plan.pause_s": 30.0})
    record(bodies_of(load_scene(scene)), folder / "bag", config, effects=EFFECTS[request.param])
    assert main(["gap", str(folder / "bag"), "--scene", str(scene), "--out", str(folder / "gap"), "--json"]) == 0
    return request.param, folder / "gap", json.loads((folder / "gap" / "gap.json").read_text())


@pytest.mark.slow
def test_it_names_what_was_added_and_nothing_else(session: tuple[str, Path, dict[str, Any]]) -> None:
    name, _, report = session
    assert report["verdict"] == (sorted(EFFECTS[name]) or ["none"])


def test_the_gap_shrinks_to_the_floor(session: tuple[str, Path, dict[str, Any]]) -> None:
    name, _, report = session
    gap = report["gap"]
    assert gap["after_mm"]["rmse"] < 1.1 * gap["floor_mm"]
    if EFFECTS[name]:
        assert gap["shrink"] > 0.85
        assert gap["before_mm"]["rmse"] > 1.1 * gap["floor_mm"]


def test_the_files_hold_what_the_design_says(session: tuple[str, Path, dict[str, Any]]) -> None:
    name, folder, report = session
    assert report["schema"] == "toftwin.gap/1"
    assert not set(report["split"]["fit_views"]) & set(report["split"]["held_out_views"])
    maps = np.load(folder / "gap_maps.npz")
    assert maps["residual_m"].shape == maps["region"].shape == (9, 86, 112)
    assert set(EFFECTS[name]) <= set(maps.files)
    page = (folder / "report.html").read_text()
    assert "://" not in page  # base64 has no colon
    assert "Where it lies" in page
    assert ("gap once the named effects are simulated" in page) is bool(EFFECTS[name]), "without an effect there is no after"
    assert ("How far it shrinks" in page) is bool(EFFECTS[name])


def test_motion_is_not_absent_but_untestable(session: tuple[str, Path, dict[str, Any]]) -> None:
    assert "motion" in session[2]["not_testable"]


def test_too_few_views_are_refused() -> None:
    with pytest.raises(RefusedError, match="too few to diagnose"):
        check([], 4)


def test_a_suspected_effect_that_held_out_views_do_not_confirm_is_taken_out_and_the_rest_is_fitted_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Its map is no error of a healthy camera: an offset that was fitted beside it would be wrong without it."""
    candidates = [SimpleNamespace(name=name) for name in ("amplitude_bias", "wiggling")]

    def joint(*suspected: int) -> Any:
        return SimpleNamespace(design=SimpleNamespace(candidates=candidates), selection=SimpleNamespace(suspected=suspected))

    def found(*small: str) -> Any:
        return SimpleNamespace(solved=SimpleNamespace(small=small))

    assert unconfirmed(joint(1), found("wiggling")) == TakenOut("wiggling", contradicted=False)
    assert unconfirmed(joint(1), found("amplitude_bias")) is None
    assert unconfirmed(joint(), found("wiggling")) is None
    refitted, config = joint(), cast("Any", None)
    monkeypatch.setattr(room, "taken_out", lambda *_: None)
    monkeypatch.setattr(room, "without", lambda *_: refitted)
    accounts = {False: found("wiggling"), True: found()}
    assert believed(joint(1), lambda chosen: accounts[chosen is refitted], config) == (accounts[True], [])
