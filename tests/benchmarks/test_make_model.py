# SPDX-License-Identifier: Apache-2.0
"""`make model` in small: recorded, labelled and trained twice it is the same file."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from benchmarks import make_model
from benchmarks.infer_data import EXACT_ROBOT

pytest.importorskip("torch", reason="training needs the extra `train`")

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.train
SMALL = ["--scenes", "3", "--unseen", "1", "--views", "2", "--epochs", "2", "--set", "net.base=4"]


def made(work: Path) -> bytes:
    """A model and its card."""
    out = work / "m.onnx"
    assert make_model.main(["--work", str(work), "--out", str(out), *SMALL]) == 0
    return out.read_bytes() + out.with_suffix(".json").read_bytes()


@pytest.mark.slow
def test_made_twice_it_is_the_same_to_the_bit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(EXACT_ROBOT, "camera.width", 48)
    monkeypatch.setitem(EXACT_ROBOT, "camera.height", 36)
    assert made(tmp_path / "one") == made(tmp_path / "other")
