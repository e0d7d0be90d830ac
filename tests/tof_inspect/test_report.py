# SPDX-License-Identifier: Apache-2.0
"""The page and its JSON say the same, and nothing a part is called runs as a script."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING

from tests.tof_inspect.made import SURE, as_built, plate, seen
from tof_inspect.config import InspectConfig
from tof_inspect.judge import Inspector
from tof_inspect.report import write
from tof_scene.raycast import Raycaster

if TYPE_CHECKING:
    from pathlib import Path


def test_page_and_json(tmp_path: Path) -> None:
    scene = plate()
    named = replace(scene, parts=tuple(replace(p, name="<b>clip</b>") if p.name == "clip" else p for p in scene.parts), digest="")
    inspector = Inspector(Raycaster(named), InspectConfig())
    view = seen(as_built(scene, gone=("clip",)))
    page = write(inspector, inspector.inspect([view], [SURE]), tmp_path / "out", "a & b").read_text()
    told = json.loads((tmp_path / "out" / "inspection.json").read_text())
    assert told["schema"] == "toftwin.inspection/1"
    assert {p["name"]: p["state"] for p in told["parts"]}["<b>clip</b>"] == "absent"
    assert told["counts"] == {"present": 1, "absent": 1, "displaced": 0, "not_observable": 4}
    assert "<b>" not in page
    assert "&lt;b&gt;clip" in page
    assert "a &amp; b" in page
    assert page.count("data:image/png;base64") >= 3
    assert "http" not in page
