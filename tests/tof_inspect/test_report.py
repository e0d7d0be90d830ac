# SPDX-License-Identifier: Apache-2.0
"""The page and its JSON agree, and a part's name never runs as a script."""

from __future__ import annotations

import json
import shutil
import subprocess
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

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
    data = json.loads((tmp_path / "out" / "inspection.json").read_text())
    assert data["schema"] == "toftwin.inspection/1"
    assert {p["name"]: p["state"] for p in data["parts"]}["<b>clip</b>"] == "absent"
    assert data["counts"] == {"present": 1, "absent": 1, "displaced": 0, "not_observable": 4}
    assert "<b>" not in page
    assert "&lt;b&gt;clip" in page
    assert "a &amp; b" in page
    assert page.count("data:image/png;base64") >= 3
    assert "http" not in page
    assert data["evidence"] == "depth alone: no reference image in colour is given"
    assert "<span>measured depth</span><span>CAD with the part</span>" in page
    assert "probability that it is there 0.0003" in page
    assert "probability that it is there above 0.9999" in page


@pytest.mark.browser
def test_the_page_shows_each_part_in_a_browser(tmp_path: Path) -> None:
    browser = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if browser is None:
        pytest.skip("no Chromium on this machine")
    inspector = Inspector(Raycaster(plate()), InspectConfig())
    page = write(inspector, inspector.inspect([seen(plate())], [SURE]), tmp_path / "out", "plate")
    flags = ["--headless", "--no-sandbox", "--disable-gpu", "--dump-dom", f"--user-data-dir={tmp_path / 'profile'}"]
    shown = subprocess.run([browser, *flags, page.resolve().as_uri()], capture_output=True, text=True, timeout=120, check=True).stdout
    assert shown.count("<img") == 4  # all but the parts that no view sees
    assert shown.count('class="state present"') == 2
