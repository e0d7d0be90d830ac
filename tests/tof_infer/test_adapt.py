# SPDX-License-Identifier: Apache-2.0
"""Adaptation: a network of one camera learns the error of another from five views, and its card says where it comes from."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.tof_infer.made import CAMERA, TINY, measured, wall, write_dataset
from tof_core.camera import Camera
from tof_core.errors import RefusedError
from tof_core.hashing import digest_file
from tof_infer.card import Card, parse_card
from tof_infer.config import AdaptConfig, InferConfig
from tof_infer.samples import own_sigma
from tof_infer.session import Session

pytest.importorskip("torch", reason="training needs the extra `train`")

from tof_infer.adapt import adapt
from tof_infer.report import sentence, write
from tof_infer.validate import Validation

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.train
OTHER = Camera(width=52, height=38, fx=46.0, fy=46.0, cx=25.5, cy=18.5, frame_id="hand_depth")
ERROR_M = -0.03
SHORT = replace(TINY, adapt=AdaptConfig(steps=200, check_steps=100, rate=5e-3))


@pytest.fixture(scope="module")
def five_views(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Five walls from one station, by another camera: it measures 30 mm too near where the first one measures 20 mm too far."""
    return write_dataset(tmp_path_factory.mktemp("five") / "five.zarr", views=5, stations=1, camera=OTHER, offset_m=ERROR_M, first=100)


@pytest.fixture(scope="module")
def adapted(model: Path, five_views: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Card]:
    """The network of the first camera, adapted to the other."""
    out = tmp_path_factory.mktemp("adapted") / "other.onnx"
    return out, adapt([five_views], model, out, SHORT)


def test_repairs_views_of_the_other_camera_that_it_has_not_seen(adapted: tuple[Path, Card]) -> None:
    session, errors = Session(InferConfig(model=str(adapted[0]))), []
    for number in range(200, 204):
        repaired = session.repair(measured(number, OTHER, ERROR_M))
        errors.append((repaired.depth - wall(number, OTHER))[repaired.known])
    assert 1e3 * np.abs(np.concatenate(errors)).mean() < 6  # raw: 30 mm; the first camera's network: 50 mm


def test_figures_are_those_of_held_out_halves(adapted: tuple[Path, Card]) -> None:
    figures = adapted[1].figures
    assert figures["val_raw_mae_mm"] == pytest.approx(30, abs=1)
    assert figures["val_mae_mm"] < 8
    # One calibration for two networks of a hundred steps each balances both shares but meets neither.
    assert 0.55 < figures["val_within_1_sigma"] < 0.85
    assert figures["val_within_2_sigma"] > 0.8
    assert adapted[1].split | {"seed": 0} == {
        "by": "view", "seed": 0, "train_views": 5, "val_views": 5, "test_views": 0, "train_captures": 5
    }  # fmt: skip


def test_the_card_names_the_network_and_the_camera_that_it_comes_from(adapted: tuple[Path, Card], model: Path) -> None:
    card = parse_card(adapted[0].with_suffix(".json").read_text(), "card")
    assert card.camera == OTHER
    assert (card.base["name"], card.base["digest"]) == (model.name, digest_file(model))
    assert (card.base["camera"]["width"], card.base["camera"]["fx"]) == (CAMERA.width, CAMERA.fx)
    assert card.config["net"] == parse_card(model.with_suffix(".json").read_text(), "card").config["net"]


def test_an_adapted_network_applies_to_the_new_camera_alone(adapted: tuple[Path, Card]) -> None:
    with pytest.raises(RefusedError, match="it is 44x30, the model's 52x38"):
        Session(InferConfig(model=str(adapted[0]))).repair(measured(1))


def test_the_same_call_gives_the_same_file(five_views: Path, model: Path, tmp_path: Path) -> None:
    few = replace(SHORT, adapt=AdaptConfig(steps=10, check_steps=10))
    for name in ("one.onnx", "two.onnx"):
        adapt([five_views], model, tmp_path / name, few)
    assert digest_file(tmp_path / "one.onnx") == digest_file(tmp_path / "two.onnx")


def test_one_view_is_refused_since_sigma_needs_another(model: Path, tmp_path: Path) -> None:
    data = write_dataset(tmp_path / "five.zarr", views=5, stations=1, damage="nan", damaged=4)
    with pytest.raises(RefusedError, match=r"1 view\(s\) with usable labels are too few .*'no label': 4"):
        adapt([data], model, tmp_path / "out.onnx", SHORT)


def test_the_page_names_the_validation_data(adapted: tuple[Path, Card], tmp_path: Path) -> None:
    page = write(adapted[1], tmp_path / "other.onnx").read_text()
    assert "on 5 views of the other half" in page
    assert "Adapted from walls.onnx, a network of a camera of 44 × 30." in page
    assert sentence(adapted[1].figures).startswith("The network brings the mean error from 30")


def test_what_all_labels_of_a_view_have_in_common_is_not_their_own_sigma() -> None:
    mask = np.ones((3, 40), bool)
    sigma = np.hypot(2e-3, np.linspace(0, 3e-3, 120)).reshape(3, 40).astype(np.float32)
    sigma[0, :2], mask[1, 0], sigma[1, 0] = np.nan, False, 1e-6
    found = own_sigma(sigma, mask)
    assert found[0, 0] == 0.0
    assert found[2, 39] == pytest.approx(3e-3, rel=0.01)
    assert found[1, 20] == pytest.approx(np.sqrt((60 / 119 * 3e-3) ** 2), rel=0.01)
    np.testing.assert_array_equal(own_sigma(np.full((3, 4), 2e-3, np.float32), np.ones((3, 4), bool)), 0.0)


def test_several_validations_are_one() -> None:
    def verdict(n: int, mae: float) -> Validation:
        return Validation(1.0, mae, 2 * mae, *(np.full(n, mae + k) for k in range(4)))

    found = Validation.of_all([verdict(10, 1e-3), verdict(30, 3e-3)])
    assert (found.mae, found.raw_mae) == pytest.approx((2.5e-3, 5e-3))
    assert found.error.shape == found.own.shape == (40,)
    assert found.own[-1] == pytest.approx(3.003)
