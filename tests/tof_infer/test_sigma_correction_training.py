# SPDX-License-Identifier: Apache-2.0
"""Frame-level correction of sigma: learnt where the frame predicts errors, zero where it does not."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from tests.tof_infer.made import measured, write_dataset
from tof_infer.config import InferConfig
from tof_infer.session import Session

torch = pytest.importorskip("torch", reason="training needs the extra `train`")

from benchmarks.make_model import recalibrate_sigma  # noqa: E402
from tof_infer import sigma_correction_training as correction_module  # noqa: E402
from tof_infer import unseen as unseen_module  # noqa: E402
from tof_infer.sigma_correction_training import TrainingFrame, fit_correction  # noqa: E402

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.train
CELLS, PIXELS = (4, 6), 400


def training_frame(number: int, louder: float) -> TrainingFrame:
    """A frame, bright or not; errors of bright frames are `louder` times their scale, with a Laplace distribution."""
    rng = np.random.default_rng(number)
    cells = torch.from_numpy(rng.normal(0, 0.3, (3, *CELLS)).astype(np.float32))
    bright = number % 2
    cells[1] += bright
    scale = rng.normal(-6, 0.5, PIXELS)
    error = scale + np.log(np.abs(rng.laplace(0, 0.7, PIXELS)) + 1e-4) + bright * np.log(louder)
    cell = torch.from_numpy(rng.integers(0, CELLS[0] * CELLS[1], PIXELS))
    return TrainingFrame(
        cells, torch.ones(1, *CELLS), cell, torch.from_numpy(error.astype(np.float32)), torch.from_numpy(scale.astype(np.float32))
    )


def shares(frames: list[TrainingFrame], correction: Any) -> list[float]:
    """Errors within one and two sigma."""
    with torch.no_grad():
        ratio = torch.cat([x.error - x.scale - correction(x.cells[None], x.share[None]).flatten()[x.cell] for x in frames]).exp()
    return [float((ratio <= k).float().mean()) for k in (1, 2)]


@pytest.mark.parametrize("louder", [1.0, 4.0])
def test_frames_of_different_brightness_get_different_sigmas(louder: float) -> None:
    correction = fit_correction([training_frame(k, louder) for k in range(60)], 0, steps=250)
    for start in (1000, 1001):  # dark ones, bright ones
        one, two = shares([training_frame(k, louder) for k in range(start, start + 40, 2)], correction)
        # Of a Laplace law the nearest to both is 71.7 and 92.0 %.
        assert one == pytest.approx(0.717, abs=0.03)
        assert two == pytest.approx(0.92, abs=0.02)


def test_a_new_sigma_leaves_the_depth_as_it_was(model: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(unseen_module, "MIN_TRAINING", 4)
    monkeypatch.setattr(correction_module.fit_correction, "__defaults__", (20,))
    unseen = [write_dataset(tmp_path / f"{k}.zarr", views=4, stations=3, first=100 * k) for k in range(1, 4)]
    card = recalibrate_sigma(model, unseen, tmp_path / "again.onnx")
    old, new = (Session(InferConfig(model=str(p), max_sigma_mm=1000.0)) for p in (model, tmp_path / "again.onnx"))
    a, b = old.repair(measured(900)), new.repair(measured(900))
    np.testing.assert_allclose(a.depth, b.depth, atol=1e-6)
    assert np.nanmax(np.abs(np.log(a.sigma / b.sigma))) > 0.01
    assert card == new.card
    assert card.split["unseen_taught_captures"] == 8
    assert card.split["unseen_checked_captures"] == 4
    assert len(card.split["unseen_data"]) == 3
    assert card.figures["val_mae_mm"] == old.card.figures["val_mae_mm"]
    assert "val_within_1_sigma" not in card.figures
