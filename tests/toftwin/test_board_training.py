# SPDX-License-Identifier: Apache-2.0
"""`train --board`: captures of a board in, a network out."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest

from tof_infer.config import TrainConfig
from tof_sim_label.dataset import open_dataset
from toftwin.board_training import MARGIN_PX, labelled, near_labels
from toftwin.cli import main

from .test_board import folder  # noqa: F401 (a fixture)

if TYPE_CHECKING:
    from pathlib import Path

    from toftwin.label_call import LabelCall


def test_a_stated_margin_is_kept() -> None:
    assert near_labels(TrainConfig()).margin_px == MARGIN_PX
    assert near_labels(TrainConfig(margin_px=7)).margin_px == 7


def test_each_bag_has_a_folder_and_is_labelled_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    called = list[tuple[str, str, str]]()

    def run(call: LabelCall) -> None:
        called.append((call.bag, call.mode, call.board))
        (call.out / "dataset.zarr").mkdir(parents=True)

    monkeypatch.setattr("toftwin.label_call.LabelCall.run", run)
    bags = [tmp_path / "one", tmp_path / "two"]
    expected = [tmp_path / "model_board_0", tmp_path / "model_board_1"]
    assert labelled(bags, "5x7x0.030", tmp_path / "model.onnx") == expected
    assert labelled(bags, "5x7x0.030", tmp_path / "model.onnx") == expected
    assert called == [(str(bag), "robot", "5x7x0.030") for bag in bags]


@pytest.mark.train
def test_captures_of_a_board_become_a_network(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:  # noqa: F811
    pytest.importorskip("torch", reason="training needs the extra `train`")
    out = tmp_path / "model.onnx"
    small = ["--epochs", "1", "--threads", "1", "--set", "net.base=4", "--set", "net.levels=2"]
    assert main(["train", str(folder), "--board", "5x7x0.030", "--out", str(out), "--json", *small]) == 0
    assert json.loads(capsys.readouterr().out)["val_raw_mae_mm"] > 0
    assert out.exists()
    assert open_dataset(tmp_path / "model_board_0" / "dataset.zarr").views == 10
