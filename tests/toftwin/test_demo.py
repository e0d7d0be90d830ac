# SPDX-License-Identifier: Apache-2.0
"""The demonstration, small: everything it leaves, and that its figures say what they should."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from typing import TYPE_CHECKING

import pytest

from toftwin import cli

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = [pytest.mark.dds, pytest.mark.slow]
SMALL = ["width=160", "height=120", "views=4", "stations=1", "captures=3", "effects=wiggling=1", "sweep_views=3", "later_captures=3"]


@pytest.fixture(scope="module")
def demo(ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("demo") / "out"
    assert cli.main(["demo", "--out", str(out), *(a for pair in SMALL for a in ("--set", pair))]) == 0
    return out


def test_all_files_of_the_demonstration_exist_and_no_partial_one(demo: Path) -> None:
    names = {p.name for p in demo.iterdir()}
    assert {"gap", "inspection", "first.json", "later", "fitted"} <= names
    assert (demo / "gap/sensor.yaml").exists()
    assert {"bag", "graph", "dataset.zarr", "report.html", "scene", "truth.npz", "poses.json", "metrics.json", "config.yaml"} <= names
    assert not [name for name in names if name.endswith(".part")]
    assert not demo.with_name("out.part").exists()


def test_labels_are_nearer_to_the_truth_than_what_was_measured(demo: Path) -> None:
    from tof_eval.sessions import session_errors
    from tof_virtual.truth import load_truth
    from toftwin.demo.run import live_poses

    truth, _ = load_truth(demo / "truth")
    found = session_errors(demo / "dataset.zarr", truth, live_poses(demo / "graph", truth["stamp_ns"]))
    mae = {name: error.mae for name, error in found.rows}
    assert mae["label against truth"] < 0.6 * mae["filtered against truth"]
    assert mae["filtered against truth"] < mae["raw against truth"]
    errors = {p.name: p for p in found.poses}
    assert errors["robot"].millimetres.min() > 15.0
    assert errors["session solution"].millimetres.max() < 5.0
    assert errors["graph, live"].millimetres.max() < 8.0
    assert found.honest > 0.9


def test_poses_and_metrics_are_written_beside(demo: Path) -> None:
    poses, metrics = json.loads((demo / "poses.json").read_text()), json.loads((demo / "metrics.json").read_text())
    assert [p["captures"] for p in poses] == [3, 3, 3, 3]
    assert (metrics["captures"], metrics["views"], metrics["skipped"]) == (12, 4, {})


def test_the_report_needs_no_network_and_shows_every_picture(demo: Path) -> None:
    html = (demo / "report.html").read_text(encoding="utf-8")
    links = re.findall(r"(?:src|href)=\"(?!data:)([^\"]*)", html)
    assert links
    assert all((demo / link).exists() for link in links)
    assert html.count('src="data:image/png;base64,') >= 11
    assert len(html) < 5_000_000


def test_the_page_leads_with_the_four_questions(demo: Path) -> None:
    html = (demo / "report.html").read_text(encoding="utf-8")
    places = [html.index(f"<h2>{k} ") for k in (1, 2, 3, 4)]
    assert places == sorted(places)
    assert places[-1] < html.index("<h2>Labels: one view")


def test_the_fitted_sensor_is_nearer_to_the_camera_than_an_ideal_one(demo: Path) -> None:
    from tof_core.config import from_mapping
    from toftwin.demo.config import DemoConfig
    from toftwin.demo.replace import compared

    values = dict(pair.split("=", 1) for pair in SMALL)
    found = compared(
        demo, demo / "scene/scene.yaml", from_mapping(DemoConfig, {k: v if k == "effects" else int(v) for k, v in values.items()})
    )
    assert found.fitted_mm < 0.7 * found.ideal_mm
    assert 0.0 < found.noise_mm < found.ideal_mm


def test_what_was_taken_away_and_moved_is_not_called_present(demo: Path) -> None:
    found = json.loads((demo / "inspection/inspection.json").read_text())
    parts = {p["name"]: p["state"] for p in found["parts"]}
    gone, moved = "clip_1", "connector"
    assert parts[gone] != "present"
    assert parts[moved] != "absent"
    others = [state for name, state in parts.items() if name not in (gone, moved)]
    assert not {"absent", "displaced"} & set(others)


@pytest.mark.browser
def test_the_report_opens_in_a_browser(demo: Path, tmp_path: Path) -> None:
    browser = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if browser is None:
        pytest.skip("no Chromium on this machine")
    flags = ["--headless", "--no-sandbox", "--disable-gpu", "--dump-dom", f"--user-data-dir={tmp_path}"]
    shown = subprocess.run([browser, *flags, f"file://{demo}/report.html"], capture_output=True, text=True, timeout=120, check=True)
    assert "a camera and its twin" in shown.stdout


def test_a_folder_that_is_no_demo_is_not_replaced(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "thesis.tex").write_text("years of work")
    assert cli.main(["demo", "--out", str(tmp_path)]) == 2
    assert "is not a demo's folder" in capsys.readouterr().err
    assert (tmp_path / "thesis.tex").exists()
