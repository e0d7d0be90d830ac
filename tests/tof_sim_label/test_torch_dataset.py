# SPDX-License-Identifier: Apache-2.0
"""What a training loop gets: the raw capture with the label of its view."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from tests.tof_sim_label.made import ATTRIBUTES, CAMERA, capture, label, view
from tof_sim_label.dataset import DatasetWriter, open_dataset
from tof_sim_label.torch_dataset import CaptureDataset

if TYPE_CHECKING:
    from pathlib import Path

torch = pytest.importorskip("torch", reason="needs the extra `train`")
pytestmark = pytest.mark.train


@pytest.fixture
def data(tmp_path: Path) -> CaptureDataset:
    """Six captures: two each of views 0 and 1, one whose view never came, one of none."""
    with DatasetWriter(tmp_path / "d", CAMERA, ATTRIBUTES) as writer:
        for i, v in enumerate([0, 0, 1, 1, 7, -1]):
            writer.append_capture(capture(i), view=v)
        for v in range(2):
            writer.append_view(view(v, station=v), label(v))
    return CaptureDataset(open_dataset(tmp_path / "d"), cached=1)


def test_an_item_is_a_capture_with_the_label_of_its_view(data: CaptureDataset) -> None:
    assert len(data) == 4
    item = data[3]
    h, w = CAMERA.shape
    assert {k: tuple(v.shape) for k, v in item.items() if hasattr(v, "shape")} == {
        "raw": (1, h, w),
        "amplitude": (1, h, w),
        "ray": (3, h, w),
        "temperature": (),
        "label": (1, h, w),
        "label_sigma": (1, h, w),
        "mask": (1, h, w),
    }
    assert (item["capture"], item["view"]) == (3, 1)
    np.testing.assert_array_equal(item["raw"][0].numpy(), capture(3).depth)
    np.testing.assert_array_equal(item["label"][0].numpy(), label(1).depth)
    np.testing.assert_array_equal(item["mask"][0].numpy(), label(1).mask.astype(bool))
    assert float(item["temperature"]) == 23.0


def test_rays_are_unit_directions_of_the_camera(data: CaptureDataset) -> None:
    ray = data[0]["ray"].numpy()
    np.testing.assert_allclose(np.linalg.norm(ray, axis=0), 1.0, atol=1e-6)
    np.testing.assert_allclose(ray[:, 2, 7] / ray[2, 2, 7], [(7 - 5.5) / 10, (2 - 3.5) / 10, 1.0], atol=1e-6)


def test_views_of_a_split_select_their_captures(data: CaptureDataset) -> None:
    chosen = CaptureDataset(data.dataset, [1])
    assert [chosen[i]["capture"] for i in range(len(chosen))] == [2, 3]


def test_a_loader_with_workers_gives_the_same_batches(data: CaptureDataset) -> None:
    loader = torch.utils.data.DataLoader(data, batch_size=2, num_workers=1, multiprocessing_context="spawn")
    batches = list(loader)
    np.testing.assert_array_equal(batches[1]["label"][:, 0].numpy(), np.stack([label(1).depth] * 2))
    assert batches[0]["capture"].tolist() == [0, 1]
