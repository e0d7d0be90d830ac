# SPDX-License-Identifier: Apache-2.0
"""The report of a comparison: its figures as JSON, its page with escaped names and every picture inside."""

from __future__ import annotations

import json
import re
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.tof_eval.made import CAMERA, capture, rendering
from tof_eval.comparison import compare
from tof_eval.methods import Raw, Rules
from tof_eval.reference import Judged
from tof_eval.report import write
from tof_eval.tables import captures_table, methods_table
from tof_preproc.config import PreprocConfig

if TYPE_CHECKING:
    from pathlib import Path


def test_the_page_has_the_figures_and_needs_no_network(tmp_path: Path) -> None:
    true = np.full(CAMERA.shape, 1.0, np.float32)
    views = [Judged((capture(true + 0.004),), true, rendering(true), 0)]
    found = compare(views, [Raw(), Rules(PreprocConfig())], ("left", "right"))
    result = {**found.result, "bag": "<b>monday</b>", "scene": "cell", "reference": "the truth beside the bag"}
    html = write(tmp_path / "out", result, found.shown).read_text(encoding="utf-8")
    written = json.loads((tmp_path / "out" / "evaluation.json").read_text())
    assert written["methods"]["raw"]["all"]["mae_mm"] == pytest.approx(4.0, rel=1e-4)
    assert "&lt;b&gt;monday&lt;/b&gt;" in html
    assert "<b>monday" not in html
    assert html.count('src="data:image/png;base64,') == 3
    assert not re.search(r'(?:src|href)="(?!data:)', html)


def test_the_tables_are_in_millimetres_with_a_dash_where_nothing_is_known() -> None:
    true = np.full(CAMERA.shape, 1.0, np.float32)
    found = compare([Judged((capture(true + 0.004),), true, rendering(true), 0)], [Raw()], ("left", "right"))
    row = methods_table(found.result["methods"]).splitlines()[1].split()
    assert row[:6] == ["raw", "4.00", "4.00", "4.00", "100.0", "99.600"]
    assert row[7] == "-", "no flying pixel was there"
    assert captures_table(found.result["methods"]).splitlines()[-1].split() == ["1", "99.600"]
