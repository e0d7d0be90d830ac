# SPDX-License-Identifier: Apache-2.0
"""`toftwin view` without a display: what is logged, where, how often, in which colour."""

from __future__ import annotations

import json
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from tests.tof_sim_label import made
from tof_scene.builtin import open_scene
from tof_sim_label.dataset import DatasetWriter, open_dataset
from tof_sim_label.schema import Attributes
from toftwin import cli, viewing

GOLDEN = Path(__file__).parents[1] / "data" / "golden" / "bag"
FRAMES = 12


def logged(path: Path) -> Counter[str]:
    """Rows of each entity in a recording."""
    reader = pytest.importorskip("rerun.chunk", reason="needs the extra `view`").RrdReader(str(path))
    rows: Counter[str] = Counter()
    for chunk in reader.stream():
        rows[chunk.entity_path] += chunk.num_rows
    return rows


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three views of two parts; measured 1 mm short of the label on the first part, which is all that the rays hit."""
    path = tmp_path_factory.mktemp("label") / "dataset.zarr"
    with DatasetWriter(path, made.CAMERA, Attributes("cad", "config", "session, final", ("sill", "clip"))) as writer:
        for k in range(3):
            view, label = made.view(k), made.label(k)
            view.depth[:] = label.depth - np.float32(1e-3)
            writer.append_capture(made.capture(k), k)
            writer.append_view(view, label)
    return path


def test_a_bag_shows_scene_camera_path_cloud_and_images_over_time(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("rerun", reason="needs the extra `view`")
    out = tmp_path / "x.rrd"
    assert cli.main(["view", str(GOLDEN), "--scene", "body_section", "--save", str(out)]) == 0
    assert str(out) in capsys.readouterr().out
    rows = logged(out)
    for entity in ("/cell/camera", "/cell/camera/pinhole", "/cell/measured", "/images/measured", "/images/amplitude"):
        assert rows[entity] == FRAMES, entity
    assert rows["/cell/path"] == 1
    assert {f"/cell/parts/{name}" for name in open_scene("body_section").names} <= rows.keys()


def test_a_labelled_folder_shows_both_clouds_and_the_gap_of_its_parts(dataset: Path, tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="needs the extra `view`")
    assert cli.main(["view", str(dataset.parent), "--every", "2", "--save", str(tmp_path / "x.rrd")]) == 0
    rows = logged(tmp_path / "x.rrd")
    assert all(rows[f"/{entity}"] == 2 for entity in ("cell/measured", "cell/labelled", "images/label", "images/residual", "plots/rms_mm"))
    scribe = viewing.Scribe(tmp_path / "y.rrd")
    gaps = viewing.draw_dataset(scribe, open_dataset(dataset))
    scribe.close()
    assert gaps["sill"] == pytest.approx(1e-3, rel=1e-3)
    assert np.isnan(gaps["clip"])


def gap_report(folder: Path) -> Path:
    """A report of one view that sees the regions of the first two parts: 2 mm on one, 6 mm on the other."""
    scene = open_scene("body_section")
    _, _, part = scene.triangles()
    of_face = scene.surface_regions()
    region = np.full((1, 4, 6), -1, np.int32)
    region[0, :2], region[0, 2:3] = of_face[part == 0][0], of_face[part == 1][0]
    residual = np.full((1, 4, 6), np.nan, np.float32)
    residual[0, :2], residual[0, 2:3] = 2e-3, -6e-3
    folder.mkdir()
    (folder / "gap.json").write_text(json.dumps({"verdict": ["wiggling"]}))
    np.savez(
        folder / "gap_maps.npz",
        view_stamp_ns=np.array([10**18]),
        station=np.zeros(1, np.int32),
        residual_m=residual,
        region=region,
        wiggling=residual / 2,
    )
    return folder


def test_a_gap_report_colours_the_parts(tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="needs the extra `view`")
    folder, scene = gap_report(tmp_path / "gap"), open_scene("body_section")
    assert cli.main(["view", str(folder), "--scene", "body_section", "--save", str(tmp_path / "x.rrd")]) == 0
    rows = logged(tmp_path / "x.rrd")
    assert rows["/images/gap/residual"] == rows["/images/gap/wiggling"] == rows["/gap/verdict"] == 1
    assert {e for e in rows if e.startswith("/gap/parts/")} == {f"/gap/parts/{name}" for name in scene.names[:2]}
    with np.load(folder / "gap_maps.npz") as maps:
        gaps = viewing.part_gaps(scene, maps["residual_m"], maps["region"])
    assert [1e3 * gaps[name] for name in scene.names[:2]] == pytest.approx([2.0, 6.0], rel=1e-5)
    assert np.isnan(gaps[scene.names[2]])


def test_colours_say_sign_and_size() -> None:
    assert viewing.signed(np.array([[0.0, 0.02, -0.02, np.nan, 0.005]], np.float32)).tolist() == [
        [[255, 255, 255], [255, 0, 0], [0, 0, 255], [0, 0, 0], [255, 127, 127]]
    ]
    green, red = viewing.heat(np.array([0.0, 1.0]))
    assert green[1] > green[0]
    assert red[0] > red[1]


def test_without_the_extra_the_error_is_one_line(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    assert cli.main(["view", str(GOLDEN)]) == 2
    error = capsys.readouterr().err
    assert error.startswith("toftwin: toftwin view: rerun is not installed; ")
    assert "-m pip install 'rerun-sdk>=" in error


def test_without_a_display_it_says_what_to_do(dataset: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("rerun", reason="needs the extra `view`")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    assert cli.main(["view", str(dataset)]) == 2
    assert "pass --save FILE.rrd" in capsys.readouterr().err


def test_a_folder_that_is_no_report_is_refused(dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("rerun", reason="needs the extra `view`")
    (tmp_path / "gap").mkdir()
    assert cli.main(["view", str(dataset), "--gap", str(tmp_path / "gap"), "--save", str(tmp_path / "x.rrd")]) == 1
    assert "is no gap report" in capsys.readouterr().err
