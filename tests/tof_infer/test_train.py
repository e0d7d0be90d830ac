# SPDX-License-Identifier: Apache-2.0
"""Training: learns a known error, continues identically after an interruption, refuses unusable data."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.tof_infer.made import CAMERA, TINY, write_dataset
from tof_core.camera import Camera
from tof_core.errors import DatasetError, ModelError, RefusedError
from tof_infer.card import parse_card
from tof_infer.config import NetConfig, TrainConfig
from tof_sim_label.store import chunk_path

torch = pytest.importorskip("torch", reason="training needs the extra `train`")

from tof_infer.passes import learning_rate  # noqa: E402
from tof_infer.train import thinned, train  # noqa: E402

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.train


def weights(path: Path) -> list[np.ndarray]:
    import onnx
    from onnx import numpy_helper

    return [numpy_helper.to_array(t) for t in onnx.load(path).graph.initializer]


def test_learns_an_offset_and_reports_it_in_its_card(model: Path) -> None:
    card = parse_card(model.with_suffix(".json").read_text(), "card")
    assert card.figures["val_raw_mae_mm"] == pytest.approx(20, abs=1)
    assert card.figures["val_mae_mm"] < 5
    assert card.curves[-1]["loss"] < card.curves[0]["loss"]
    assert card.camera == CAMERA
    assert card.split["by"] == "station"
    assert card.split["train_views"] + card.split["val_views"] == 24
    assert 0.3 < card.range_m[0] < card.range_m[1] < 2.5
    assert card.data[0]["views"] == 24
    assert card.data[0]["pose_source"] == "robot"


def test_the_same_seed_gives_the_same_weights_also_after_a_kill(dataset: Path, tmp_path: Path) -> None:
    straight, killed = tmp_path / "straight.onnx", tmp_path / "killed.onnx"
    train([dataset], straight, replace(TINY, epochs=3))

    class Killed(Exception):  # noqa: N818
        pass

    def say(line: str) -> None:
        if line.startswith("epoch 2/"):
            raise Killed

    with pytest.raises(Killed):
        train([dataset], killed, replace(TINY, epochs=3), say=say)
    lines: list[str] = []
    train([dataset], killed, replace(TINY, epochs=3), say=lines.append)
    assert "resuming after epoch 2" in lines
    assert sum(line.startswith("epoch ") for line in lines) == 1
    for a, b in zip(weights(straight), weights(killed), strict=True):
        np.testing.assert_array_equal(a, b)


class Stopped(Exception):  # noqa: N818 (not an error)
    """Training is interrupted."""


def continued(dataset: Path, out: Path, first: TrainConfig, then: TrainConfig) -> list[str]:
    """Lines of a training that was interrupted after epoch 2 and goes on with other settings."""

    def say(line: str) -> None:
        if line.startswith("epoch 2/"):
            raise Stopped

    with pytest.raises(Stopped):
        train([dataset], out, first, say=say)
    lines: list[str] = []
    train([dataset], out, then, say=lines.append)
    return lines


def test_a_checkpoint_is_continued_on_another_device_and_with_other_threads(dataset: Path, tmp_path: Path) -> None:
    config = replace(TINY, epochs=3, threads=1)
    lines = continued(dataset, tmp_path / "m.onnx", replace(config, device="auto"), replace(config, device="cpu", threads=2))
    assert "resuming after epoch 2" in lines
    assert not (tmp_path / "m.onnx.ckpt").exists()


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device here")
def test_a_checkpoint_of_the_gpu_is_continued_on_the_cpu(dataset: Path, tmp_path: Path) -> None:
    config = replace(TINY, epochs=25, rate=5e-3)
    lines = continued(dataset, tmp_path / "m.onnx", replace(config, device="cuda"), replace(config, device="cpu"))
    assert "resuming after epoch 2" in lines
    figures = json.loads((tmp_path / "m.json").read_text())["figures"]
    assert figures["val_mae_mm"] < 0.25 * figures["val_raw_mae_mm"]


def test_a_checkpoint_of_other_settings_is_not_continued(dataset: Path, tmp_path: Path) -> None:
    out = tmp_path / "m.onnx"
    (tmp_path / "m.onnx.ckpt").write_bytes(b"not a checkpoint")
    with pytest.raises(ModelError, match=r"m\.onnx\.ckpt: the checkpoint is damaged"):
        train([dataset], out, TINY)
    torch.save({"digest": "other"}, tmp_path / "m.onnx.ckpt")
    with pytest.raises(ModelError, match="of other data or settings; pass --fresh"):
        train([dataset], out, TINY)
    train([dataset], out, replace(TINY, epochs=1), fresh=True)
    assert out.exists()
    assert not (tmp_path / "m.onnx.ckpt").exists()


def test_one_station_is_refused(tmp_path: Path) -> None:
    path = write_dataset(tmp_path / "one.zarr", stations=1)
    with pytest.raises(RefusedError, match=r"1 station\(s\) .* too few .*record at least 3"):
        train([path], tmp_path / "m.onnx", TINY)


def test_stations_of_several_datasets_add_up(tmp_path: Path) -> None:
    paths = [write_dataset(tmp_path / f"{k}.zarr", views=4, stations=1, first=10 * k) for k in range(3)]
    card = train(paths, tmp_path / "m.onnx", replace(TINY, epochs=1, val=0.3))
    assert [d["stations"] for d in card.data] == [1, 1, 1]
    assert card.split["train_views"] == 8


def test_mixed_cameras_are_refused(tmp_path: Path) -> None:
    one = write_dataset(tmp_path / "one.zarr")
    other = write_dataset(tmp_path / "other.zarr", camera=Camera(44, 30, 41.0, 41.0, 21.5, 14.5, frame_id="hand_depth"))
    with pytest.raises(DatasetError, match=r"other\.zarr: is of another camera .* than one\.zarr .*train one model per camera"):
        train([one, other], tmp_path / "m.onnx", TINY)


@pytest.mark.parametrize(("damage", "reason"), [("nan", "no label"), ("mask", "label masked"), ("raw", "no depth where the label is")])
def test_a_bad_frame_is_left_out_and_counted(tmp_path: Path, damage: str, reason: str) -> None:
    path = write_dataset(tmp_path / "d.zarr", damage=damage)
    lines: list[str] = []
    train([path], tmp_path / "m.onnx", replace(TINY, epochs=1), say=lines.append)
    assert f"{{'{reason}': 1}}" in lines[0]


def test_labels_that_are_all_nan_are_refused(tmp_path: Path) -> None:
    path = write_dataset(tmp_path / "d.zarr", views=3, stations=3, damage="nan", damaged=3)
    with pytest.raises(RefusedError, match=r"nothing to learn from in the training views .*no label"):
        train([path], tmp_path / "m.onnx", TINY)


def test_a_missing_chunk_is_an_error(tmp_path: Path) -> None:
    path = write_dataset(tmp_path / "d.zarr")
    chunk_path(path, "captures", "raw", 3).unlink()
    with pytest.raises(DatasetError, match="committed chunk is missing"):
        train([path], tmp_path / "m.onnx", TINY)


def test_the_papers_recipe_is_a_plain_unet_on_depth() -> None:
    config = TrainConfig(recipe="paper").resolved
    assert config.net.names == ("depth",)
    assert (config.loss, config.rate, config.epochs, config.net.unshuffle, config.net.residual) == ("mse", 1e-3, 100, 1, False)


def test_the_fast_recipe_changes_the_network_alone() -> None:
    config = TrainConfig(recipe="fast").resolved
    assert config.net.separable
    assert replace(config, recipe="default", net=NetConfig()) == TrainConfig()


def test_the_fast_recipe_learns_the_offset_of_the_walls(dataset: Path, tmp_path: Path) -> None:
    card = train([dataset], tmp_path / "f.onnx", replace(TINY, recipe="fast", epochs=25, rate=5e-3))
    assert card.figures["val_raw_mae_mm"] == pytest.approx(20, abs=1)
    assert card.figures["val_mae_mm"] < 5
    assert card.config["net"]["separable"]


def test_the_papers_recipe_trains(dataset: Path, tmp_path: Path) -> None:
    card = train([dataset], tmp_path / "p.onnx", replace(TINY, recipe="paper", epochs=1))
    assert card.inputs == ("depth",)
    assert json.loads((tmp_path / "p.json").read_text())["config"]["loss"] == "mse"


def test_the_rate_warms_up_stays_and_falls() -> None:
    rates = [learning_rate(k, 1000, TINY) for k in range(1000)]
    assert rates[0] < 0.1 * TINY.rate
    assert rates[300] == TINY.rate
    assert rates[-1] < 0.02 * TINY.rate
    assert (np.diff(rates[400:]) <= 0).all()


def test_a_limit_takes_views_evenly() -> None:
    np.testing.assert_array_equal(thinned(np.arange(100, 200), 3), [100, 149, 199])


def test_incidence_may_be_an_input_by_option(dataset: Path, tmp_path: Path) -> None:
    net = NetConfig(inputs="depth,ray,incidence", base=4, levels=2)
    assert train([dataset], tmp_path / "m.onnx", replace(TINY, net=net, epochs=1)).inputs == ("depth", "ray", "incidence")


def test_sigma_is_calibrated_on_scenes_never_seen_where_given(dataset: Path, tmp_path: Path) -> None:
    unseen = write_dataset(tmp_path / "unseen.zarr", views=4, stations=2, first=100)
    card = train([dataset], tmp_path / "m.onnx", replace(TINY, epochs=1), unseen=[unseen])
    plain = train([dataset], tmp_path / "p.onnx", replace(TINY, epochs=1))
    assert card.figures["unseen_raw_mae_mm"] == pytest.approx(20, abs=1)
    assert card.figures["val_mae_mm"] == plain.figures["val_mae_mm"]
    assert card.figures["calibration"] != plain.figures["calibration"]
    other = write_dataset(tmp_path / "other.zarr", camera=Camera(44, 30, 41.0, 41.0, 21.5, 14.5, frame_id="hand_depth"))
    with pytest.raises(DatasetError, match="is of another camera"):
        train([dataset], tmp_path / "o.onnx", replace(TINY, epochs=1), unseen=[other])
