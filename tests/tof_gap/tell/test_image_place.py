# SPDX-License-Identifier: Apache-2.0
"""Where in the image an error lies: quarter, half, nowhere."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tof_gap.tell.image_place import image_place

SHAPE, NOISE_M, BLOCK_PX = (96, 128), 2e-3, 8
UPPER, LOWER, LEFT, RIGHT, ALL = slice(None, 48), slice(48, None), slice(None, 64), slice(64, None), slice(None)
VIEWS: Any = [SimpleNamespace(correlation=SimpleNamespace(area=1.0))] * 6


def place(rows: slice, columns: slice, size_m: float = 2e-3) -> str:
    """Six views of white noise, with an error of changing sign in a part of the image."""
    rng = np.random.default_rng(3)
    left = []
    for v in range(len(VIEWS)):
        image = rng.normal(0.0, NOISE_M, SHAPE)
        image[rows, columns] += size_m * (-1) ** v
        image[:, 100:104] = np.nan
        left.append(image)
    return image_place(VIEWS, left, [np.full(SHAPE, NOISE_M**2)] * len(VIEWS), BLOCK_PX)


@pytest.mark.parametrize(
    ("rows", "columns", "words"),
    [
        (UPPER, RIGHT, "the upper right quarter of the image"),
        (LOWER, LEFT, "the lower left quarter of the image"),
        (LOWER, ALL, "the lower half of the image"),
        (ALL, LEFT, "the left half of the image"),
        (ALL, ALL, ""),
        (slice(32, 64), slice(32, 96), ""),
    ],
)
def test_an_error_is_placed_where_most_of_it_is(rows: slice, columns: slice, words: str) -> None:
    assert place(rows, columns) == words


def test_noise_has_no_place() -> None:
    assert place(UPPER, LEFT, 0.0) == ""
