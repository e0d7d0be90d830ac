# SPDX-License-Identifier: Apache-2.0
"""Every number that decides is a setting with bounds and a reason, something depends on it, and no other number decides."""

from __future__ import annotations

import ast
import json
from itertools import chain
from typing import TYPE_CHECKING, Any

import pytest

from benchmarks.limits.names import FACTORS, SECTIONS, STATED, numbers, value_at
from tof_align.config import AlignConfig
from tof_core.config import from_mapping, table, updated
from tof_gap.config import GapConfig
from tof_gap.watch import WatchConfig
from toftwin.diagnosis import GapPipelineConfig
from toftwin.options import parse_settings, settings_text

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from tof_core.config import ParamInfo

CLASSES: tuple[type[Any], ...] = (GapConfig, AlignConfig, WatchConfig)
ROOMS = ("tof_gap", "tof_align")
PLAIN = {0, 1, 2, 3, 6, 1e3, 1e-3, 0.5}
"""Numbers that a comparison may hold: signs, counts of points and dimensions, units, halves."""
NEGLIGIBLE = 1e-6
"""Smaller ones keep divisions finite."""


def all_numbers() -> list[ParamInfo]:
    """The numbers of all classes, without what a user states of the camera."""
    return [info for cls in CLASSES for info in table(cls) if info.kind in (int, float) and not info.name.startswith(STATED)]


def sources(repository: Path) -> Iterator[Path]:
    """Code of the rooms, without the limits themselves."""
    for path in chain.from_iterable(sorted((repository / "src" / room).rglob("*.py")) for room in ROOMS):
        if "limits" not in path.parts and path.name not in ("limits.py", "config.py"):
            yield path


def decides(node: ast.AST) -> bool:
    """Whether a node is a number that is neither plain nor negligible."""
    value = node.value if isinstance(node, ast.Constant) else None
    return isinstance(value, int | float) and value not in PLAIN and value > NEGLIGIBLE


def test_every_number_has_a_lower_bound_and_a_reason() -> None:
    assert [i.name for i in all_numbers() if not i.why or i.low is None] == []


def test_defaults_lie_within_their_bounds() -> None:
    assert [i.name for i in all_numbers() if i.low is not None and i.default < i.low] == []  # type: ignore[operator]
    assert [i.name for i in all_numbers() if i.high is not None and i.default > i.high] == []  # type: ignore[operator]


@pytest.mark.parametrize("of", ["gap", "align"])
def test_every_number_can_be_halved_and_doubled(of: str) -> None:
    cls = {"gap": GapConfig, "align": AlignConfig}[of]
    for info in numbers(of):
        values = [value_at(info, factor) for factor in FACTORS]
        assert any(v is not None for v in values), f"{info.name} has no other value"
        for value in values:
            if value is not None:
                changed = {i.name: i.default for i in table(type(updated(cls(), {info.name: value})))}
                assert changed.keys() == {i.name for i in table(cls)}


def test_every_number_of_the_diagnosis_is_a_setting_of_the_command() -> None:
    shown = settings_text(GapPipelineConfig)
    for prefix, cls in (("gap", GapConfig), ("align", AlignConfig)):
        for info in table(cls):
            name = f"{prefix}.{info.name}"
            assert f"{name} = " in shown
            if info.kind in (int, float):
                assert f"(reason: {info.why})" in shown
                assert parse_settings(GapPipelineConfig, [f"{name}={info.default}"]) == {name: info.default}


def test_a_setting_reaches_the_object_that_decides() -> None:
    values = {
        "gap.noise.beat.chi2": 30.0,
        "gap.report.unexplained.mm": 1.0,
        "align.approach.starts": 64,
        "gap.evidence.pattern.window_px": 11,
    }
    config = from_mapping(GapPipelineConfig, values)
    assert config.gap.noise.beat.chi2 == 30.0
    assert config.gap.report.unexplained.mm == 1.0
    assert config.align.approach.starts == 64
    assert config.gap.evidence.pattern.window_px == 11
    assert GapPipelineConfig().gap.noise.beat.chi2 == 25.0


def test_every_number_was_measured_halved_and_doubled(repository: Path) -> None:
    """The remedy: .venv/bin/python -m benchmarks.limits --missing --write, then scripts/make_docs.py."""
    rows = [row["name"] for row in json.loads((repository / "benchmarks" / "limits.json").read_text(encoding="utf-8"))["rows"]]
    every = [f"{of}.{info.name}" for of in SECTIONS for info in numbers(of)]
    assert sorted(set(every) - set(rows)) == [], "numbers without a row"
    assert sorted(set(rows) - set(every)) == [], "rows of numbers that no longer exist"
    assert len(rows) == len(set(rows))


def test_something_depends_on_every_number(repository: Path) -> None:
    texts = [p.read_text(encoding="utf-8") for room in (*ROOMS, "tof_scene") for p in (repository / "src" / room).rglob("*.py")]
    read = {node.attr for text in texts for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Attribute)}
    assert [i.name for i in all_numbers() if i.name.rpartition(".")[2] not in read] == []


def test_no_bare_number_decides(repository: Path) -> None:
    bare = [
        f"{path.name}:{node.lineno}: {ast.unparse(node)}"
        for path in sources(repository)
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Compare) and any(decides(part) for part in ast.walk(node))
    ]
    assert bare == []


def test_numbers_on_the_page_are_the_defaults(repository: Path) -> None:
    gap, watch = GapConfig(), WatchConfig()
    blur, evidence = gap.evidence.blur, gap.evidence
    text = " ".join((repository / "docs" / "gap.md").read_text(encoding="utf-8").split())
    assert f"bootstrap over blocks of {gap.report.block_px} pixels" in text
    assert gap.solve.joint.rounds == 3
    assert "linearised anew, at most three times" in text
    assert f"the other has under {100 * evidence.own_share:.0f} % of the footprint" in text
    assert f"what the image flows in {blur.exposure_s:g} s, at most {100 * blur.most_share:.0f} % of its width" in text
    assert f"Residuals of more than {evidence.gross_mm:g} mm" in text
    assert evidence.gross_sigma == 5.0
    assert f"up to five times the noise of the neighbours, at most {1e-3 * evidence.gross_most_mm:g} m" in text
    assert f"`views_per_alarm` ({watch.views_per_alarm})" in text
    assert f"With {watch.baseline} views of baseline" in text
