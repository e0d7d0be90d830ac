# SPDX-License-Identifier: Apache-2.0
"""The table of halved and doubled numbers: which values are tried, which numbers are read, what a row says."""

from __future__ import annotations

import json
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from benchmarks.limits import results
from benchmarks.limits.names import Reads, numbers, value_at
from benchmarks.limits.trial import Trials, _points
from tof_core.calibration import Calibration, LensLimits
from tof_core.errors import RefusedError
from tof_gap.config import GapConfig

if TYPE_CHECKING:
    from pathlib import Path

INFOS = {info.name: info for info in numbers("gap")}


@pytest.mark.parametrize(
    ("name", "factor", "value"),
    [
        ("noise.extra_mm", 0.5, 0.2),
        ("noise.burst", 0.5, 1.02),  # its lower bound
        ("evidence.edge_px", 0.5, 1),
        ("evidence.edge_px", 2.0, 4),
        ("evidence.grazing_deg", 2.0, 90.0),  # its upper bound
        ("solve.joint.mixed_px", 0.5, 0),
    ],
)
def test_a_number_is_halved_and_doubled_within_its_bounds(name: str, factor: float, value: float) -> None:
    assert value_at(INFOS[name], factor) == value


def test_a_seed_is_no_number() -> None:
    assert "evidence.seed" not in INFOS


def test_reads_are_noted_by_stage_through_sections_and_properties() -> None:
    notes: dict[str, set[str]] = {}
    stage = ["poses"]
    config = Reads(GapConfig(), notes, stage)
    assert config.noise.beat.chi2 == 25.0
    stage[0] = "report"
    np.testing.assert_array_equal(config.hand_sd, GapConfig().hand_sd)
    calibration = {"calibration.hand_eye.translation_mm", "calibration.hand_eye.rotation_deg"}
    assert notes == {"poses": {"noise.beat.chi2"}, "report": {"hand_mm", "hand_deg", *calibration}}


def line(session: str, factor: float, code: str = "abc", **found: Any) -> dict[str, Any]:
    """One trial of one number."""
    return {
        "code": code,
        "session": session,
        "name": "gap.noise.burst",
        "factor": factor,
        "value": 2.0 * factor,
        "read": bool(found),
    } | found


def test_a_row_counts_changed_verdicts_and_takes_the_largest_change() -> None:
    lines = [
        line("a", 0.5, changed=True, points=3.0),
        line("b", 0.5, changed=False, points=7.0),
        line("c", 0.5),
        line("a", 2.0, changed=False, points=None),
    ]
    (row,) = results.rows(lines)
    assert (row["name"], row["sessions"], row["read"]) == ("gap.noise.burst", 3, 2)
    assert row["halved"] == {"value": 1.0, "changed": 1, "most": 7.0, "sessions": ["a"]}
    assert row["doubled"] == {"value": 4.0, "changed": 0, "most": 0.0, "sessions": []}
    assert "halved: 1 of 3 change, at most 7 points" in results.text(row)


def test_the_last_commit_counts() -> None:
    (row,) = results.rows([line("a", 0.5, "old", changed=True, points=9.0), line("a", 0.5, "new", changed=False, points=1.0)])
    assert (row["code"], row["halved"]["changed"], row["halved"]["most"]) == ("new", 0, 1.0)


def test_a_row_that_is_measured_again_replaces_the_one_before_and_others_stay() -> None:
    def row(name: str, sessions: int) -> dict[str, Any]:
        return {"name": name, "sessions": sessions}

    before = [row("gap.noise.burst", 4), row("gap.noise.extra_mm", 4), row("gap.noise.gone", 4)]
    rows = results.renewed(before, [row("align.iterations", 2), row("gap.noise.burst", 2)])
    assert [(r["name"], r["sessions"]) for r in rows] == [("gap.noise.extra_mm", 4), ("gap.noise.burst", 2), ("align.iterations", 2)]


def test_a_line_that_was_cut_off_is_left_out(tmp_path: Path) -> None:
    path = tmp_path / "trials.jsonl"
    path.write_text(json.dumps(line("a", 0.5)) + "\n" + json.dumps(line("b", 0.5))[:20])
    assert [results.key(one) for one in results.read(path)] == [("abc", "a", "gap.noise.burst", 0.5)]


def test_points_are_the_largest_difference_of_figures_that_both_state() -> None:
    assert _points([0.5, 0.4, None, 0.6], [0.52, None, 0.1, 0.5]) == pytest.approx(10.0)
    assert _points([None], [0.3]) is None
    assert _points([], [0.3]) is None


def test_a_trial_replaces_steps_that_the_diagnosis_has(monkeypatch: pytest.MonkeyPatch) -> None:
    """The number is changed beside the calibration that the session states."""
    tried: list[GapConfig] = []

    def diagnose(_views: Any, _caster: Any, config: GapConfig, *_: Any, **__: Any) -> None:
        tried.append(config)
        raise RefusedError("refused", where="session", todo="")

    monkeypatch.setattr("tof_gap.diagnose.diagnose", diagnose)
    stated = Calibration(lens=LensLimits(principal_point_px=0.3))
    trials = Trials(SimpleNamespace(views=[], caster=None, left_out=frozenset(), law=None, calibration=stated))  # type: ignore[arg-type]
    assert trials.run("gap", "noise.burst", 2.0) == {"verdict": ["refused: session: refused"], "figures": []}
    assert [(config.noise.burst, config.calibration) for config in tried] == [(2.0, stated)]
