# SPDX-License-Identifier: Apache-2.0
"""`infer` and `evaluate` on a small virtual session, with the network that the package carries."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tof_core.bag import BagOptions, open_bag
from toftwin import cli

if TYPE_CHECKING:
    from pathlib import Path


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two views of the built-in body section with wiggling."""
    out = tmp_path_factory.mktemp("session") / "bag"
    assert (
        cli.main(
            [
                "simulate",
                "--scene",
                "body_section",
                "--out",
                str(out),
                "--views",
                "2",
                "--stations",
                "1",
                "--captures",
                "2",
                "--effect",
                "wiggling",
                "--quiet",
            ]
        )
        == 0
    )
    return out


def test_infer_writes_a_bag_that_holds_both(session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "repaired"
    assert cli.main(["infer", str(session), "--out", str(out), "--json"]) == 0
    tally = json.loads(capsys.readouterr().out)
    assert tally["frames"] == 4
    assert tally["repaired"] + tally["raw_kept"] + tally["invalid"] == pytest.approx(1)
    options = BagOptions(depth_topic="/infer/depth", info_topic="/infer/camera_info")
    with open_bag(session) as before, open_bag(out, options) as after:
        raw, repaired = list(before.captures()), list(after.captures())
        assert [c.stamp_ns for c in raw] == [c.stamp_ns for c in repaired]
        assert {"/depth/hand/image", "/infer/sigma"} <= {m.topic for m in after.messages()}
    both = np.isfinite(raw[0].depth)
    np.testing.assert_array_equal(np.isfinite(repaired[0].depth), both)
    assert 0 < np.abs(repaired[0].depth - raw[0].depth)[both].mean() < 0.05


def test_infer_overwrites_no_file(session: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["infer", str(session), "--out", str(session)]) == 2
    assert "exists already" in capsys.readouterr().err


def test_a_model_for_another_camera_leaves_no_bag(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag, out = tmp_path / "bag", tmp_path / "out"
    assert (
        cli.main(
            ["simulate", "--scene", "body_section", "--out", str(bag), "--views", "1", "--stations", "1", "--size", "64x48", "--quiet"]
        )
        == 0
    )
    assert cli.main(["infer", str(bag), "--out", str(out)]) == 1
    assert "the model was made for another camera: it is 64x48, the model's 224x171" in capsys.readouterr().err
    assert not out.exists()
    assert cli.main(["infer", str(bag), "--out", str(out), "--force"]) == 0


def test_evaluate_against_the_truth(session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    truth = session.with_name("bag.truth.npz")
    assert (
        cli.main(
            ["evaluate", str(session), "--scene", "body_section", "--truth", str(truth), "--frames", "2", "--out", str(tmp_path), "--json"]
        )
        == 0
    )
    result = json.loads(capsys.readouterr().out)
    assert result["schema"] == "toftwin.evaluation/1"
    assert result["reference"] == "the truth beside the bag"
    assert list(result["methods"]) == ["raw", "rules", "rules2", "model"]
    with open_bag(session) as reader, np.load(truth) as file:
        last = [c for c in reader.captures() if c.stamp_ns in file["stamp_ns"]]
        error = np.abs(np.stack([c.depth for c in last]) - file["depth"])
    assert result["methods"]["raw"]["all"]["mae_mm"] == pytest.approx(1e3 * np.nanmean(error), rel=1e-6)
    assert len(result["methods"]["model"]["captures"]) == 2
    html = (tmp_path / "report.html").read_text()
    assert "figure 9 of the paper" in html
    assert "http" not in html.replace("http-equiv", "")
    assert json.loads((tmp_path / "evaluation.json").read_text()) == result


def test_evaluate_prints_a_table(session: Path, capsys: pytest.CaptureFixture[str]) -> None:
    truth = session.with_name("bag.truth.npz")
    assert cli.main(["evaluate", str(session), "--scene", "body_section", "--truth", str(truth), "--methods", "raw,rules"]) == 0
    out = capsys.readouterr().out
    assert "2 views, compared with the truth" in out
    assert "the paper's figure 9" in out


def test_a_truth_of_another_session_is_no_reference(session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    other = tmp_path / "other.npz"
    with np.load(session.with_name("bag.truth.npz")) as file:
        np.savez(other, **{**file, "stamp_ns": file["stamp_ns"] + 1})
    assert cli.main(["evaluate", str(session), "--scene", "body_section", "--truth", str(other), "--methods", "raw"]) == 1
    assert "no view has a reference" in capsys.readouterr().err
    other.write_bytes(b"nothing")
    assert cli.main(["evaluate", str(session), "--scene", "body_section", "--truth", str(other), "--methods", "raw"]) == 1
    assert "is no truth file" in capsys.readouterr().err


def test_train_refuses_wrong_arguments_with_the_reason(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["train", str(tmp_path / "none.zarr"), "--out", str(tmp_path / "m.onnx")]) == 2
    assert "none.zarr" in capsys.readouterr().err
    assert cli.main(["train", str(tmp_path), "--out", str(tmp_path / "m.pt")]) == 2
    assert "must end in .onnx" in capsys.readouterr().err


def test_adapt_refuses_flags_that_it_does_not_read(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    call = ["train", str(tmp_path), "--adapt", "default", "--out", str(tmp_path / "m.onnx")]
    assert cli.main([*call, "--epochs", "3"]) == 2
    assert "--epochs: is not used with --adapt; see train.adapt in --settings" in " ".join(capsys.readouterr().err.split())
    assert cli.main([*call, "--unseen", str(tmp_path)]) == 2
    assert "--unseen: is not used with --adapt" in " ".join(capsys.readouterr().err.split())
