# SPDX-License-Identifier: Apache-2.0
"""The diagnosis on small sessions of the virtual robot, whose truth it does not see."""

from __future__ import annotations

import json
from functools import cache
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
    from collections.abc import Callable
    from pathlib import Path

EFFECTS: dict[str, dict[str, float]] = {"null": {}, "wiggling": {"wiggling": 1.0}, "offset": {"temperature_drift": 1.0}}


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    from tof_scene.builtin import write_builtin

    return write_builtin("body_section", tmp_path_factory.mktemp("scene"))


@pytest.fixture(scope="module")
def sessions(scene: Path, tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """The folder of a session with one effect or none, by name: `bag`, and its report under `gap`; each is made once."""
    from tof_scene.scene_file import load_scene
    from tof_virtual.config import VirtualConfig
    from tof_virtual.record import record
    from toftwin.commands.simulate import bodies_of

    @cache
    def made(name: str) -> Path:
        folder = tmp_path_factory.mktemp(name)
        config = from_mapping(VirtualConfig, {"seed": 5, "camera.width": 112, "camera.height": 86, "plan.views": 9, "plan.pause_s": 30.0})
        record(bodies_of(load_scene(scene)), folder / "bag", config, effects=EFFECTS[name])
        assert main(["gap", str(folder / "bag"), "--scene", str(scene), "--out", str(folder / "gap"), "--json"]) == 0
        return folder

    return made


@pytest.fixture(scope="module", params=sorted(EFFECTS))
def session(request: pytest.FixtureRequest, sessions: Callable[[str], Path]) -> tuple[str, Path, dict[str, Any]]:
    """A session's effect, the folder of its report, and the report."""
    out = sessions(request.param) / "gap"
    return request.param, out, json.loads((out / "gap.json").read_text())


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


@pytest.mark.slow
@pytest.mark.usefixtures("no_page")
def test_with_the_fitted_sensor_as_known_no_effect_is_left(
    sessions: Callable[[str], Path], scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first, second = sessions("wiggling") / "gap", tmp_path / "second"
    call = ["gap", str(first.with_name("bag")), "--scene", str(scene), "--out", str(second), "--sensor"]
    assert main([*call, str(first / "sensor.yaml")]) == 0
    before, after = (json.loads((out / "gap.json").read_text()) for out in (first, second))
    assert (before["verdict"], after["verdict"]) == (["wiggling"], ["none"])
    assert after["gap"]["before_mm"]["rmse"] < 1.1 * after["gap"]["floor_mm"]
    # On the session of its own fit a model keeps what it promised.
    promise = after["promise"]
    assert promise["promised"]["shrink"] == pytest.approx(before["gap"]["shrink"], abs=1e-9)
    assert promise["kept"]["shrink"] == pytest.approx(promise["promised"]["shrink"], abs=0.1)
    assert promise["without_mm"] == pytest.approx(
        np.sqrt(before["gap"]["before_mm"]["rmse"] ** 2 - before["gap"]["floor_mm"] ** 2), rel=0.2
    )
    assert "promise" not in before
    assert "shrink by --sensor: promised" in capsys.readouterr().out
    (tmp_path / "other.yaml").write_text((first / "sensor.yaml").read_text().replace("width: 112", "width: 224"))
    assert main([*call, str(tmp_path / "other.yaml")]) != 0
    assert "fitted to another camera (width 224 against 112)" in capsys.readouterr().err


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
        return SimpleNamespace(design=SimpleNamespace(candidates=candidates), selection=SimpleNamespace(suspected=suspected, fullest=()))

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


@pytest.mark.parametrize(
    ("named", "named_with_small", "contradicted", "expected"),
    [
        ([], [], [], "with small effects"),  # all of them are errors of a healthy camera
        ([], ["wiggling"], [], "chosen"),  # several small effects fit almost any error: none of them is asserted
        (["wiggling"], [], [], "chosen"),
        ([], [], ["lens_scatter"], "chosen"),  # what resembles an effect and contradicts its map is no error of a healthy camera
    ],
)
def test_small_effects_are_taken_off_where_nothing_is_named(
    monkeypatch: pytest.MonkeyPatch, named: list[str], named_with_small: list[str], contradicted: list[str], expected: str
) -> None:
    out = iter([*(TakenOut(name, contradicted=True) for name in contradicted), None])
    monkeypatch.setattr(room, "taken_out", lambda *_: next(out))
    monkeypatch.setattr(room, "without", lambda joint, *_: joint)
    monkeypatch.setattr(room, "with_small", lambda *_: "with small effects")
    chosen = SimpleNamespace(selection=SimpleNamespace(suspected=(), fullest=(0, 1, 2)))

    def read(joint: Any) -> Any:
        small = joint == "with small effects"
        return SimpleNamespace(
            solved=SimpleNamespace(small=(), named=named_with_small if small else named), of="with small effects" if small else "chosen"
        )

    account, resembled = believed(cast("Any", chosen), read, cast("Any", None))
    assert cast("Any", account).of == expected
    assert resembled == contradicted
