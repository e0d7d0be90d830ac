# SPDX-License-Identifier: Apache-2.0
"""Training batches: whole captures, or the surroundings of the labels alone."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import pytest

from tests.tof_infer.made import CAMERA, TINY, labelled, measured
from tof_infer.samples import Sample, Samples

torch = pytest.importorskip("torch", reason="training needs the extra `train`")

from tof_infer.batches import Batcher  # noqa: E402

if TYPE_CHECKING:
    from tof_infer.config import TrainConfig

pytestmark = pytest.mark.train
ROWS, COLUMNS = (slice(4, 9), slice(20, 24)), (slice(30, 37), slice(2, 12))
"""Where two captures have their labels."""


def batcher(config: TrainConfig) -> Batcher:
    samples = []
    for number, (rows, columns) in enumerate(zip(ROWS, COLUMNS, strict=True)):
        capture, label = measured(number), labelled(number)
        assert capture.amplitude is not None
        mask = np.zeros(CAMERA.shape, bool)
        mask[rows, columns] = True
        none = np.full(CAMERA.shape, np.nan, np.float32)
        samples.append(Sample(capture.depth, capture.amplitude, 30.0, label.depth, label.sigma, mask, none, none))

    class Few(list[Sample]):
        pool = SimpleNamespace(camera=CAMERA)

    return Batcher(cast("Samples", cast("Any", Few(samples))), config)


def test_a_margin_cuts_training_captures_to_their_labels() -> None:
    made = batcher(replace(TINY, margin_px=3, flip=False, drop=0.0))
    ((images, target),) = made.epoch(0)
    multiple = TINY.net.multiple
    assert images["depth"].shape[2:] == (-(-11 // multiple) * multiple, -(-16 // multiple) * multiple)
    assert int(target["mask"].sum()) == sum((r.stop - r.start) * (c.stop - c.start) for r, c in zip(ROWS, COLUMNS, strict=True))
    for k in range(2):
        which = int(np.argmin([abs(int(made.samples[i].mask.sum()) - int(target["mask"][k].sum())) for i in range(2)]))
        whole = made.samples[which]
        there = target["mask"][k, 0].numpy()
        np.testing.assert_array_equal(images["depth"][k, 0].numpy()[there], whole.depth[whole.mask])
        np.testing.assert_array_equal(images["ray"][k].numpy()[:, there], made.ray[:, : CAMERA.height, : CAMERA.width][:, whole.mask])


def test_without_a_margin_and_in_validation_captures_are_whole() -> None:
    for made in (batcher(TINY), batcher(replace(TINY, margin_px=3))):
        assert all(images["depth"].shape[2:] == made.size for images, _ in made.plain())
    ((images, _),) = batcher(replace(TINY, flip=False)).epoch(0)
    assert images["depth"].shape[2:] == batcher(TINY).size
