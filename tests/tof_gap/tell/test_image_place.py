# SPDX-License-Identifier: Apache-2.0
"""Where in the image an error lies: quarter, half, the same spots in all views, nowhere."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tof_gap.tell.image_place import SPOTS_WORDS, image_place

SHAPE, NOISE_M, BLOCK_PX = (96, 128), 2e-3, 8
UPPER, LOWER, LEFT, RIGHT, ALL = slice(None, 48), slice(48, None), slice(None, 64), slice(64, None), slice(None)
VALVE = (slice(32, 64), slice(32, 96))


def views(*, valve: bool = False) -> Any:
    """Six views of one wall, or of one with a valve in the middle of the image."""
    part = np.zeros(SHAPE, int)
    part[VALVE] = valve
    return [SimpleNamespace(correlation=SimpleNamespace(area=1.0), rendering=SimpleNamespace(part=part))] * 6


VIEWS = views()


def place(rows: slice, columns: slice, size_m: float = 2e-3, seen: Any = VIEWS) -> str:
    """Six views of white noise, with an error of changing sign in a part of the image."""
    rng = np.random.default_rng(3)
    left = []
    for v in range(len(VIEWS)):
        image = rng.normal(0.0, NOISE_M, SHAPE)
        image[rows, columns] += size_m * (-1) ** v
        image[:, 100:104] = np.nan
        left.append(image)
    return image_place(seen, left, [np.full(SHAPE, NOISE_M**2)] * len(VIEWS), BLOCK_PX)


@pytest.mark.parametrize(
    ("rows", "columns", "words"),
    [
        (UPPER, RIGHT, "the upper right quarter of the image"),
        (LOWER, LEFT, "the lower left quarter of the image"),
        (LOWER, ALL, "the lower half of the image"),
        (ALL, LEFT, "the left half of the image"),
        (ALL, ALL, ""),
        (*VALVE, SPOTS_WORDS),
    ],
)
def test_an_error_is_placed_where_most_of_it_is(rows: slice, columns: slice, words: str) -> None:
    assert place(rows, columns) == words


def test_an_error_on_a_part_that_every_view_shows_in_one_place_is_the_part_s() -> None:
    assert place(*VALVE, seen=views(valve=True)) == ""


def test_noise_has_no_place() -> None:
    assert place(UPPER, LEFT, 0.0) == ""


def spotted(*, stay: bool) -> str:
    """Views with an error in six spots of 24 by 16 pixels over both halves of the image, at the same places in each view or elsewhere in each."""
    rng = np.random.default_rng(4)
    left = []
    for v in range(len(VIEWS)):
        image = rng.normal(0.0, NOISE_M, SHAPE)
        for k in range(6):
            row, column = 48 * (k % 2) + 8, 40 * (k // 2) + 8
            image[row : row + 16, column : column + 24] += 3e-3
        left.append(image if stay else np.roll(image, (16 * v, 20 * v), (0, 1)))
    return image_place(VIEWS, left, [np.full(SHAPE, NOISE_M**2)] * len(VIEWS), BLOCK_PX)


def test_an_error_that_keeps_to_spots_of_the_image_is_placed_there() -> None:
    assert spotted(stay=True) == SPOTS_WORDS


def test_spots_that_move_from_view_to_view_are_no_place() -> None:
    assert spotted(stay=False) == ""
