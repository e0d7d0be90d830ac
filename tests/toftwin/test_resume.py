# SPDX-License-Identifier: Apache-2.0
"""A labelling that is cut off goes on where it stopped, and ends as if it had never been."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from tof_align.config import AlignConfig, VerdictConfig, WeightConfig
from tof_core.bag import open_bag
from tof_core.errors import RefusedError
from tof_scene.builtin import make_builtin
from tof_sim_label.dataset import DatasetWriter, open_dataset
from toftwin.labelling import LabelResult, label_bag
from toftwin.pipeline import PipelineConfig

if TYPE_CHECKING:
    from collections.abc import Callable

    from tof_scene.scene import Scene

GOLDEN = Path(__file__).parents[1] / "data" / "golden" / "bag"
FEW = AlignConfig(weights=WeightConfig(pixels=500, last_pixels=500, coarse_pixels=200, live_pixels=500))
"""Solved in a second: what is asked here is what becomes of poses, not how good they are."""


@pytest.fixture(scope="module")
def scene() -> Scene:
    return make_builtin("body_section")


@pytest.fixture(scope="module")
def whole(scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What a run that nothing stops leaves (at the robot's poses, which takes no solving)."""
    out = tmp_path_factory.mktemp("whole")
    labelled(scene, out)
    return out


def labelled(scene: Scene, out: Path, mode: str = "robot") -> LabelResult:
    with open_bag(GOLDEN) as reader:
        return label_bag(reader, scene, PipelineConfig(align=FEW), out, mode=mode)


def stop_at(monkeypatch: pytest.MonkeyPatch, method: str, count: int) -> None:
    """Ctrl-C when the dataset is given its `count`th frame."""
    append: Callable[..., int] = getattr(DatasetWriter, method)

    def stopping(self: DatasetWriter, *args: Any, **kwargs: Any) -> int:
        if {"append_view": self.views, "append_capture": self.captures}[method] == count:
            raise KeyboardInterrupt
        return append(self, *args, **kwargs)

    monkeypatch.setattr(DatasetWriter, method, stopping)


def same(a: Path, b: Path) -> None:
    one, two = open_dataset(a / "dataset.zarr"), open_dataset(b / "dataset.zarr")
    assert (one.captures, one.views, one.verdicts) == (two.captures, two.views, two.verdicts) == (12, 4, one.verdicts)
    for name in ("captures/view", "captures/stamp_ns", "views/T_cell_camera", "views/pose_cov", "views/station"):
        np.testing.assert_array_equal(one.column(name), two.column(name))
    for v in range(4):
        for name in ("label", "label_sigma", "depth", "mask"):
            np.testing.assert_array_equal(one.frame(f"views/{name}", v), two.frame(f"views/{name}", v))
    metrics = [json.loads((p / "metrics.json").read_text()) | {"note": ""} for p in (a, b)]
    assert metrics[0] == metrics[1]
    assert (a / "poses.json").read_text() == (b / "poses.json").read_text()
    assert sorted(p.name for p in a.iterdir()) == ["config.yaml", "dataset.zarr", "metrics.json", "poses.json"]


@pytest.mark.parametrize(
    ("method", "count", "kept"), [("append_capture", 5, (5, 0)), ("append_view", 0, (12, 0)), ("append_view", 3, (12, 3))]
)
def test_stored_results_are_not_computed_again(
    monkeypatch: pytest.MonkeyPatch, scene: Scene, whole: Path, tmp_path: Path, method: str, count: int, kept: tuple[int, int]
) -> None:
    stop_at(monkeypatch, method, count)
    with pytest.raises(KeyboardInterrupt):
        labelled(scene, tmp_path)
    monkeypatch.undo()
    left = open_dataset(tmp_path / "dataset.zarr.part")
    assert (left.captures, left.views) == kept
    assert not (tmp_path / "dataset.zarr").exists()
    if method == "append_view":
        monkeypatch.setattr("tof_align.session.solve_session", lambda *_: pytest.fail("the session is solved again"))
    monkeypatch.setattr("tof_sim_label.label.label_view", counted := Counted(sys.modules["tof_sim_label.label"].label_view))
    result = labelled(scene, tmp_path)
    assert counted.calls == 4 - kept[1]
    assert f"{kept[0]} captures and {kept[1]} labels" in result.note
    same(tmp_path, whole)


class Counted:
    """A function that counts its calls."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self.function, self.calls = function, 0

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        self.calls += 1
        return self.function(*args, **kwargs)


def test_a_killed_process_leaves_a_readable_dataset_that_is_gone_on_with(scene: Scene, whole: Path, tmp_path: Path) -> None:
    code = (
        "import os, signal, sys; from tof_sim_label.dataset import DatasetWriter; append = DatasetWriter.append_view\n"
        "DatasetWriter.append_view = lambda s, *a: os.kill(os.getpid(), signal.SIGKILL) if s.views == 2 else append(s, *a)\n"
        "from toftwin import cli; cli.main(sys.argv[1:])"
    )
    few = [
        f
        for name in ("pixels", "last_pixels", "coarse_pixels", "live_pixels")
        for f in ("--set", f"align.weights.{name}={getattr(FEW.weights, name)}")
    ]
    call = ["label", str(GOLDEN), "--scene", "body_section", "--out", str(tmp_path), "--mode", "robot", *few]
    assert subprocess.run([sys.executable, "-c", code, *call], check=False, timeout=120).returncode == -signal.SIGKILL
    left = open_dataset(tmp_path / "dataset.zarr.part")
    assert (left.captures, left.views) == (12, 2)
    assert np.isfinite(left.frame("views/label", 1)).any()
    labelled(scene, tmp_path)
    same(tmp_path, whole)


def test_live_labels_go_on_too(monkeypatch: pytest.MonkeyPatch, scene: Scene, tmp_path: Path) -> None:
    labelled(scene, tmp_path / "a", "causal")
    stop_at(monkeypatch, "append_view", 2)
    with pytest.raises(KeyboardInterrupt):
        labelled(scene, tmp_path / "b", "causal")
    monkeypatch.undo()
    assert "continued an interrupted run" in labelled(scene, tmp_path / "b", "causal").note
    same(tmp_path / "b", tmp_path / "a")


def test_what_was_made_otherwise_is_begun_anew(monkeypatch: pytest.MonkeyPatch, scene: Scene, whole: Path, tmp_path: Path) -> None:
    stop_at(monkeypatch, "append_view", 1)
    with pytest.raises(KeyboardInterrupt):
        labelled(scene, tmp_path, "causal")
    monkeypatch.undo()
    assert labelled(scene, tmp_path).note == ""
    same(tmp_path, whole)


def test_the_leavings_of_another_bag_are_begun_anew(monkeypatch: pytest.MonkeyPatch, scene: Scene, whole: Path, tmp_path: Path) -> None:
    with monkeypatch.context() as patch:
        stop_at(patch, "append_view", 1)
        append = DatasetWriter.append_capture
        patch.setattr(
            DatasetWriter, "append_capture", lambda s, c, v: append(s, c.__class__(c.stamp_ns, c.camera, c.depth + 1, c.reason), v)
        )
        with pytest.raises(KeyboardInterrupt):
            labelled(scene, tmp_path)
    assert labelled(scene, tmp_path).note == ""
    same(tmp_path, whole)


def test_a_refusal_leaves_nothing(scene: Scene, tmp_path: Path) -> None:
    never = replace(FEW, verdict=VerdictConfig(min_pixels=10**6))
    with open_bag(GOLDEN) as reader, pytest.raises(RefusedError, match="pixels see the CAD"):
        label_bag(reader, scene, PipelineConfig(align=never), tmp_path)
    assert list(tmp_path.iterdir()) == []
