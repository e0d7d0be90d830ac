# SPDX-License-Identifier: Apache-2.0
"""The page of a network: verdict and advice by its figures."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from tof_infer.card import Card, parse_card
from tof_infer.report import sentence, todo, write

MODEL = Path(__file__).parents[2] / "src/tof_infer/models/default.json"
GOOD = {"val_mae_known_mm": 1.0, "val_raw_mae_mm": 4.0, "val_known": 0.8, "val_within_1_sigma": 0.68, "val_within_2_sigma": 0.95}


def card(**figures: Any) -> Card:
    base = parse_card(MODEL.read_text(), MODEL)
    return replace(base, figures={**GOOD, **figures}, curves=[])


def test_the_verdict_is_of_the_pixels_that_are_repaired() -> None:
    assert sentence(GOOD) == "The network brings the mean error from 4.00 to 1.00 mm, on the 80 % of the pixels that it repairs."
    assert sentence({**GOOD, "val_mae_known_mm": 4.5}).startswith("The network repairs nothing")
    assert sentence({**GOOD, "val_mae_known_mm": None}).startswith("The network repairs no pixel")


def test_advice_follows_the_figures() -> None:
    assert any("--unseen" in line for line in todo(card()))
    assert any("Do not rely on sigma" in line for line in todo(card(val_within_1_sigma=0.4)))
    assert not any("Do not rely on sigma" in line for line in todo(card()))
    worse = {"unseen_mae_mm": 6.0, "unseen_mae_known_mm": 6.0, "unseen_raw_mae_mm": 5.0}
    assert any("trained scenes alone" in line for line in todo(card(**worse)))
    falling = [{"epoch": float(k), "val_mae_mm": 10.0 - k} for k in range(9)]
    assert any("Train longer" in line for line in todo(replace(card(), curves=falling)))
    assert not any(
        "Train longer" in line for line in todo(replace(card(), curves=[{"epoch": float(k), "val_mae_mm": 2.0} for k in range(9)]))
    )


def test_the_page_is_small_and_complete(tmp_path: Path) -> None:
    every = {f"val_{k}": 0.5 for k in ("mae_mm", "wrong_10mm", "raw_wrong_10mm")}
    curves = [{"epoch": float(k + 1), "loss": 1.0, "val_mae_mm": 3.0 - 0.1 * k} for k in range(5)]
    page = write(replace(card(**every), curves=[{"epoch": 0.0, "loss": 2.0}, *curves]), tmp_path / "camera.onnx")
    text = page.read_text()
    assert page.name == "camera.html"
    assert "brings the mean error from 4.00 to 1.00 mm" in text
    assert text.count('src="data:image/png;base64,') == 2
    assert len(text) < 1_000_000
