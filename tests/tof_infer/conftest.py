# SPDX-License-Identifier: Apache-2.0
"""One small trained model for all tests of the room."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

from tests.tof_infer.made import TINY, write_dataset

if TYPE_CHECKING:
    from pathlib import Path


@pytest.fixture(scope="session")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Twenty-four walls at eight stations."""
    return write_dataset(tmp_path_factory.mktemp("walls") / "walls.zarr", views=24, stations=8)


@pytest.fixture(scope="session")
def model(dataset: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A network that learnt the walls' 20 mm offset."""
    pytest.importorskip("torch", reason="training needs the extra `train`")
    from tof_infer.train import train

    out = tmp_path_factory.mktemp("model") / "walls.onnx"
    train([dataset], out, replace(TINY, epochs=25, rate=5e-3))
    return out
