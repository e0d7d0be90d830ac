# SPDX-License-Identifier: Apache-2.0
"""The generator's side of the foreign gap check: what is drawn, what counts as separable, how verdicts are judged."""

from __future__ import annotations

import json
import subprocess
import sys
from collections import Counter
from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from benchmarks.emerging.causes import CAUSES
from benchmarks.gap_check.foreign.cases import NAMED, ROBOTS, SCENES, draw_foreign
from benchmarks.gap_check.foreign.record import planned, record_foreign, shown
from benchmarks.gap_check.foreign.score import ForeignRow, _below, as_meant, judge, shrink_of, wrong_ones
from benchmarks.gap_check.foreign.second import Promised
from benchmarks.gap_check.foreign.second import table as table_of_promises
from benchmarks.gap_check.foreign.separable import correlation, poses, separability
from benchmarks.gap_check.foreign.table import _bounded, figures, misses
from benchmarks.gap_check.record import SEAL, digest
from tof_core.config import to_mapping
from tof_core.errors import ConfigError
from tof_virtual.config import VirtualConfig

if TYPE_CHECKING:
    from pathlib import Path

SHAPE = (60, 80)
VIEWS = 6


# what is drawn ------------------------------------------------------------------------------------
def test_the_draw_is_its_seeds_and_more_cases_leave_the_first_as_they_are() -> None:
    assert draw_foreign(40, 5)[:20] == draw_foreign(20, 5)
    assert draw_foreign(20, 5) != draw_foreign(20, 6)


def test_every_kind_scene_robot_and_cause_is_drawn() -> None:
    cases = draw_foreign(160, 1)
    kinds = Counter(c.kind for c in cases)
    assert kinds == {"single": 70, "null": 30, "pair": 30, "triple": 10, "outside": 10, "left-out": 10}
    assert {c.scene for c in cases} == set(SCENES)
    assert {c.robot for c in cases} == set(ROBOTS)
    assert {next(iter(c.causes)) for c in cases if c.kind == "single"} == set(NAMED)
    assert all(0.5 <= s <= 2 for c in cases for s in c.causes.values())
    assert all(len(c.effects) == {"pair": 2, "triple": 3}[c.kind] for c in cases if c.kind in ("pair", "triple"))


@pytest.mark.parametrize("scene", SCENES)
def test_every_scene_is_written_and_seen(scene: str, tmp_path: Path) -> None:
    case = next(c for c in draw_foreign(5, 3) if c.scene == scene)
    session = planned(case, tmp_path, (80, 60))
    frame = session.exposed(0, session.device(), noise=True)
    assert np.isfinite(frame.depth).mean() > 0.5
    assert (session.shares() > 0.005).sum() >= 2


# what is separable --------------------------------------------------------------------------------
def flat_session(add: Any) -> tuple[dict[str, Any], dict[str, Any]]:
    """Six views of a slanted plane each, with a map that `add(v, u, view)` gives in metres, noise of 1 mm."""
    rng = np.random.default_rng(0)
    v, u = np.mgrid[0 : SHAPE[0], 0 : SHAPE[1]]
    config = to_mapping(VirtualConfig())
    config["camera"] |= {"width": SHAPE[1], "height": SHAPE[0]}
    f = 0.5 * SHAPE[1] / np.tan(np.radians(config["camera"]["fov_deg"]) / 2)
    ray = np.stack([(u - 39.5) / f, (v - 29.5) / f, np.ones(SHAPE)], axis=-1)
    depth, normal = [], []
    for k in range(VIEWS):
        n = np.array([0.5 * np.sin(k), 0.5 * np.cos(k), -1.0])
        n /= np.linalg.norm(n)
        depth.append(0.9 * n[2] / (ray @ n))
        normal.append(np.broadcast_to(n, (*SHAPE, 3)))
    arrays = {
        "depth": np.stack(depth),
        "normal": np.stack(normal),
        "station": np.zeros(VIEWS, int),
        "T_cell_camera": np.broadcast_to(np.eye(4), (VIEWS, 4, 4)),
        "T_robot": np.broadcast_to(np.eye(4), (VIEWS, 4, 4)),
        "noise": rng.normal(0, 1e-3, (VIEWS, *SHAPE)),
        "bias_x": np.stack([add(v, u, k) for k in range(VIEWS)]).astype(float),
    }
    return arrays, {"config": config, "causes": {"c": {"effect": "x"}}}


def test_a_shift_that_a_small_motion_makes_is_not_separable_and_a_bump_is() -> None:
    shift = separability(*flat_session(lambda v, u, k: np.full(SHAPE, 3e-3)))["x"]
    bump = separability(*flat_session(lambda v, u, k: 8e-3 * np.exp(-((v - 30) ** 2 + (u - 40) ** 2) / 50)))["x"]
    assert not shift["separable"]
    assert shift["share"] < 0.05
    assert shift["pose_chi2"] < 40
    assert bump["separable"]
    assert bump["share"] > 0.5


def test_a_map_below_what_healthy_cameras_do_is_not_separable() -> None:
    small = separability(*flat_session(lambda v, u, k: 1e-4 * np.sin(0.5 * u)))["x"]
    assert small["left_mm"] < 0.3
    assert not small["separable"]


def test_a_shift_beyond_the_robots_priors_is_separable() -> None:
    far = separability(*flat_session(lambda v, u, k: np.full(SHAPE, 0.09 * (-1) ** k)))["x"]
    assert far["pose_chi2"] > 1000
    assert far["separable"]


def test_two_effects_of_one_map_are_rivals() -> None:
    arrays, meta = flat_session(lambda v, u, k: 8e-3 * np.sin(0.3 * u))
    arrays["bias_y"] = 0.5 * arrays["bias_x"]
    meta["causes"]["d"] = {"effect": "y"}
    both = separability(arrays, meta)
    assert both["x"]["rivals"] == ["y"]
    assert not both["x"]["separable"]
    assert both["x"]["gap_share"] == pytest.approx(0.8, abs=0.02)


def test_correlation_is_one_for_equal_maps_whatever_the_pose_adds() -> None:
    arrays, meta = flat_session(lambda v, u, k: 4e-3 * np.sin(0.3 * u))
    free = poses(arrays, meta)
    shifted = arrays["bias_x"] + 2e-3
    assert correlation(free, shifted, arrays["bias_x"]) > 0.98
    assert correlation(free, np.roll(arrays["bias_x"], 10, axis=2), arrays["bias_x"]) < 0.2


def test_a_map_that_is_a_motion_is_compared_as_it_is() -> None:
    """Views 4 mm nearer and farther, with 0.4 mm of a wave that no motion makes, which the named map lacks."""
    arrays, meta = flat_session(lambda v, u, k: 4e-3 * (-1) ** k + 0.4e-3 * np.sin(0.3 * u))
    free = poses(arrays, meta)
    named = arrays["bias_x"] - 0.4e-3 * np.sin(0.3 * np.arange(SHAPE[1]))
    assert correlation(free, named, arrays["bias_x"], as_is=True) == pytest.approx(4 / np.sqrt(4**2 + 0.4**2 / 2), abs=2e-3)
    assert correlation(free, named, arrays["bias_x"]) < 0.5


# how far the gap shrinks --------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("found", "true"),
    [({"x", "y"}, 1 - 1 / 26), ({"x"}, 1 - 10 / 26), ({"noise"}, 0.0), (set(), 0.0)],
    ids=["all effects", "the stronger one", "an effect without a map", "none of them"],
)
def test_the_true_shrink_is_that_of_the_named_effects(found: set[str], true: float) -> None:
    one = np.ones((2, 4, 4))
    x, y, healthy = one * [4, 4, -4, -4], one * [3, -3, 3, -3], one * [[1], [-1], [1], [-1]]
    arrays = {"bias_x": 1e-3 * x, "bias_y": 1e-3 * y, "bias_all": 1e-3 * (x + y), "error_healthy": 1e-3 * healthy}
    assert shrink_of(arrays, found, [1], seen=np.ones((1, 4, 4), bool)) == pytest.approx(true)


def test_wrongly_unwrapped_pixels_count_where_they_are_named() -> None:
    healthy, wraps = np.full((1, 4, 4), 1e-3), np.zeros((1, 4, 4))
    wraps[0, 0, 0] = 1.5
    arrays = {"bias_phase_wrap": wraps, "bias_all": np.zeros((1, 4, 4)), "error_healthy": healthy}
    seen = np.ones((1, 4, 4), bool)
    assert shrink_of(arrays, {"phase_wrap"}, [0], seen=seen) == pytest.approx(1.0, abs=1e-4)
    assert shrink_of(arrays, set(), [0], seen=seen) == 0


def test_mixed_pixels_that_the_healthy_filter_removes_count_as_recorded() -> None:
    """15 pixels of 1 mm, healthy or not; one that lies 0.2 m off and that the healthy camera does not give."""
    healthy = np.full((1, 4, 4), 1e-3)
    healthy[0, 0, 0] = np.nan
    depth = np.ones((1, 4, 4))
    arrays = {"bias_all": 0.0 * healthy, "bias_flying_pixels": 0.0 * healthy, "error_healthy": healthy, "depth": depth}
    seen = np.ones((1, 4, 4), bool)
    measured = depth + np.where(np.isfinite(healthy), 1e-3, 0.2)
    true = 1 - 15e-6 / (15e-6 + 0.04)
    assert shrink_of(arrays | {"measured": measured}, {"flying_pixels"}, [0], seen=seen) == pytest.approx(true)


def test_the_size_of_an_effect_that_was_not_found_is_compared_with_its_bound() -> None:
    part = np.zeros((1, 4, 4), int)
    part[0, :, 2:] = 1
    drift, skin = np.full((1, 4, 4), 2e-3), np.where(part == 1, 3e-3, 0.0)
    drift[0, 0, 0] = np.nan
    truth: Any = SimpleNamespace(arrays={"part": part}, bias={"temperature_drift": drift, "subsurface": skin, "noise": None}.get)
    report = {
        "absent": {
            "temperature_drift": {"below_mm": 2.5, "part": None},
            "subsurface": {"below_mm": 2.0, "part": "wall"},
            "noise": None,
        }
    }
    below = _below(report, truth, ("noise", "subsurface", "temperature_drift", "wiggling"))
    assert [(name, mm) for name, mm, _ in below] == [("subsurface", 2.0), ("temperature_drift", 2.5)]
    assert [true for _, _, true in below] == pytest.approx([3.0, 2.0])
    row = ForeignRow("a", "pair", "s", "r", (), {}, (), False, "", (), True, 1.0, 1.0, below=below)
    assert _bounded([row])[0].startswith("50 % (1 of 2;")


# how verdicts are judged --------------------------------------------------------------------------
def case(kind: str, *effects: str, left_out: str = "") -> dict[str, Any]:
    shares = {e: {"separable": True, "gap_share": 1 / len(effects), "rivals": []} for e in effects}
    return {"kind": kind, "effects": list(effects), "left_out": left_out, "separable": shares}


@pytest.mark.parametrize(
    ("sealed", "verdict", "miss", "wrong"),
    [
        (case("null"), ("none",), "", ()),
        (case("null"), ("hand_eye",), "false alarm", ("hand_eye",)),
        (case("null"), ("unknown",), "false alarm", ()),
        (case("single", "wiggling"), ("wiggling",), "", ()),
        (case("single", "wiggling"), ("wiggling", "noise"), "also named noise", ("noise",)),
        (case("single", "wiggling"), ("unknown", "wiggling"), "unknown beside a sufficient answer", ()),
        (case("single", "wiggling"), ("depth_scale|wiggling",), "tied: depth_scale|wiggling", ()),
        (case("single", "wiggling"), ("unknown",), "wiggling not named", ()),
        (case("pair", "noise", "wiggling"), ("wiggling",), "noise not named", ()),
        (case("left-out", "wiggling", left_out="wiggling"), ("unknown",), "", ()),
        (case("left-out", "wiggling", left_out="wiggling"), ("amplitude_bias",), "taken for another", ("amplitude_bias",)),
        (case("left-out", "wiggling", left_out="wiggling"), ("none",), "overlooked", ()),
        (case("outside"), ("unknown", "wiggling"), "also named wiggling", ("wiggling",)),
    ],
)
def test_verdicts(sealed: dict[str, Any], verdict: tuple[str, ...], miss: str, wrong: tuple[str, ...]) -> None:
    named = wrong_ones(verdict, tuple(sealed["effects"]), sealed["left_out"])
    assert named == wrong
    assert judge(sealed, verdict, named) == miss


@pytest.mark.parametrize(
    ("causes", "verdict", "meant"),
    [
        (["short_second_exposure"], ("dropout",), ("phase_wrap",)),
        (["short_second_exposure", "hazy_lens"], ("dropout", "lens_scatter", "phase_wrap"), ("lens_scatter", "phase_wrap")),
        (["short_second_exposure", "strict_threshold"], ("dropout",), ("dropout",)),  # the threshold's own
        (["hazy_lens"], ("dropout", "lens_scatter"), ("dropout", "lens_scatter")),
    ],
)
def test_pixels_that_firmware_drops_for_wrong_unwrapping_are_named_either_way(
    causes: list[str], verdict: tuple[str, ...], meant: tuple[str, ...]
) -> None:
    assert as_meant(verdict, causes) == meant


def test_of_three_effects_those_that_hardly_matter_need_not_be_named() -> None:
    sealed = case("triple", "wiggling", "noise", "multipath")
    sealed["separable"]["noise"]["gap_share"] = 0.05
    assert judge(sealed, ("multipath", "wiggling"), ()) == ""
    assert judge(sealed, ("multipath", "noise"), ()) == "wiggling not named"


def test_the_table_counts_all_sessions_first_and_separable_ones_second() -> None:
    rows = [
        ForeignRow("a", "single", "s", "r", ("noise",), {"c": 1.0}, ("noise",), True, "", (), True, 1.0, 1.0),
        ForeignRow(
            "b", "single", "s", "r", ("noise",), {"c": 1.0}, ("wiggling",), False, "noise not named", ("wiggling",), False, 1.0, 1.0
        ),
    ]
    table = {what: (whole, part) for what, whole, part, _ in figures(rows)}
    whole, part = table["one effect, strengths 0.5 to 2: named, nothing else"]
    assert whole.startswith("50 % (1 of 2")
    assert part.startswith("100 % (1 of 1")
    assert table["a wrong effect asserted, any session"][0].startswith("50 % (1 of 2")
    assert misses(rows) == ["b single s r: c 1 (noise, not separable) -> wiggling: noise not named"]


# the generator knows nothing of the diagnosis ------------------------------------------------------
def test_no_module_of_the_generators_side_loads_the_diagnosis() -> None:
    code = (
        "import sys; import benchmarks.gap_check.foreign.record, benchmarks.gap_check.foreign.separable, benchmarks.gap_check.foreign.score;"
        "import benchmarks.emerging.record, benchmarks.emerging.strength, benchmarks.emerging.healthy;"
        "print([m for m in sys.modules if m.split('.')[0] in ('tof_gap', 'tof_align', 'tof_sensor')])"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip() == "[]"


def test_a_case_is_recorded_sealed_and_kept(tmp_path: Path) -> None:
    one = next(c for c in draw_foreign(64, 4) if c.kind == "single" and set(c.causes) == {"late_pulse"})
    record_foreign([one], tmp_path, (80, 60))
    sealed = tmp_path / "sealed" / one.name
    assert json.loads((tmp_path / SEAL).read_text()) == {one.name: digest(sealed)}
    answer = json.loads((sealed / "case.json").read_text())
    assert answer["effects"] == ["range_offset"]
    assert set(answer["separable"]) == {"range_offset"}
    prior = (tmp_path / "bags" / one.name / "scene" / "calibration.yaml").read_text()
    assert "translation_mm: 2.0" in prior
    shown = "".join(p.name for p in (tmp_path / "bags" / one.name).rglob("*"))
    assert "truth" not in shown
    assert CAUSES["late_pulse"].effect == "range_offset"


def test_a_session_whose_cause_is_absent_is_drawn_again_and_refused_where_no_draw_shows_it(tmp_path: Path) -> None:
    mild = replace(next(c for c in draw_foreign(64, 4) if set(c.causes) == {"late_pulse"}), settings={"plan.views": 4})
    drawn, session, reached = shown(mild, tmp_path, (40, 30))
    assert drawn == mild
    assert session.sizes.keys() == reached.keys() == {"late_pulse"}
    with pytest.raises(ConfigError, match="late_pulse makes less than half of the asked error in 6 draws"):
        shown(replace(mild, causes={"late_pulse": 1e3}), tmp_path, (40, 30))


def test_second_sessions_are_told_by_what_they_keep() -> None:
    rows = [Promised("case0001", ("wiggling",), 0.95, 0.92, ("none",)), Promised("case0002", ("multipath",), 0.9, 0.6, ("unknown",))]
    lines = table_of_promises(rows).splitlines()
    assert "promised   95%  kept   92%" in lines[0]
    assert lines[-1] == "2 second sessions: off the promise by 16 points (median), 27 (90 %)"
    assert table_of_promises([]) == "no report states a shrink"
