# SPDX-License-Identifier: Apache-2.0
"""Split by station, never by frame."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.tof_sim_label.made import ATTRIBUTES, CAMERA, label, view
from tof_core.errors import DatasetError
from tof_sim_label.dataset import DatasetWriter, open_dataset
from tof_sim_label.split import split_stations

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray


class Stations:
    """Stands for a dataset of which the split reads the stations alone."""

    path = "made"

    def __init__(self, stations: list[int]) -> None:
        self._stations = np.array(stations)

    def column(self, name: str) -> NDArray[np.int64]:
        assert name == "views/station"
        return self._stations


@given(st.lists(st.integers(0, 9), min_size=12, max_size=80).filter(lambda s: len(set(s)) >= 3), st.integers(0, 5))
def test_every_view_is_in_one_set_and_no_station_in_two(stations: list[int], seed: int) -> None:
    split = split_stations(Stations(stations), (0.6, 0.2, 0.2), seed)  # type: ignore[arg-type]
    sets = [split.train, split.val, split.test]
    assert sorted(np.concatenate(sets)) == list(range(len(stations)))
    assert all(len(s) for s in sets)
    owners = [{stations[i] for i in s} for s in sets]
    assert not owners[0] & owners[1] | owners[0] & owners[2] | owners[1] & owners[2]


def test_the_shares_are_kept_and_the_seed_decides(tmp_path: Path) -> None:
    with DatasetWriter(tmp_path / "d", CAMERA, ATTRIBUTES) as writer:
        for i in range(40):
            writer.append_view(view(i, station=i // 2), label(i))
    data = open_dataset(tmp_path / "d")
    split = split_stations(data, (0.7, 0.15, 0.15), seed=3)
    assert [len(split.train), len(split.val), len(split.test)] == [28, 6, 6]
    again, other = split_stations(data, (0.7, 0.15, 0.15), seed=3), split_stations(data, (0.7, 0.15, 0.15), seed=4)
    np.testing.assert_array_equal(split.test, again.test)
    assert list(split.test) != list(other.test)


def test_a_set_may_be_left_out_but_not_starved() -> None:
    split = split_stations(Stations([0, 0, 1, 1]), (0.5, 0.0, 0.5))  # type: ignore[arg-type]
    assert [len(split.train), len(split.val), len(split.test)] == [2, 0, 2]
    with pytest.raises(DatasetError, match=r"2 station.*too few for 3 sets"):
        split_stations(Stations([0, 0, 1, 1]))  # type: ignore[arg-type]


@pytest.mark.parametrize("share", [(0.0, 0.0, 0.0), (1.2, -0.1, 0.1), (-1.0, -1.0, -1.0)])
def test_shares_are_positive(share: tuple[float, float, float]) -> None:
    with pytest.raises(DatasetError, match="must be positive"):
        split_stations(Stations([0, 1, 2, 3]), share)  # type: ignore[arg-type]


def test_shares_count_by_their_ratio() -> None:
    stations = Stations(np.repeat(np.arange(20), 2).tolist())
    small, large = (split_stations(stations, share) for share in ((0.7, 0.15, 0.15), (70.0, 15.0, 15.0)))  # type: ignore[arg-type]
    assert [len(large.train), len(large.val), len(large.test)] == [28, 6, 6]
    np.testing.assert_array_equal(small.train, large.train)


def test_a_large_station_fills_its_set() -> None:
    """Stations of 60, 10 and 10 views for two sets of one half each: where the large one comes first, both others are in the other set."""
    seed = next(s for s in range(20) if np.random.default_rng(s).permutation(3)[0] == 0)
    split = split_stations(Stations([0] * 60 + [1] * 10 + [2] * 10), (0.5, 0.5, 0.0), seed)  # type: ignore[arg-type]
    assert [len(split.train), len(split.val)] == [60, 20]
