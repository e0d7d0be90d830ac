# SPDX-License-Identifier: Apache-2.0
"""Training, validation and test sets that share no station, hence no base pose and no dwell."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tof_core.errors import DatasetError

if TYPE_CHECKING:
    from tof_core.arrays import Float, Ints
    from tof_sim_label.dataset import Dataset


@dataclass(frozen=True, slots=True, eq=False)
class Split:
    """Numbers of views, ascending, of each set; no station is in two sets."""

    train: Ints
    val: Ints
    test: Ints


def split_stations(dataset: Dataset, share: tuple[float, float, float] = (0.7, 0.15, 0.15), seed: int = 0) -> Split:
    """Assign whole stations to train, val and test by their share of the views.

    Every set with a share above zero gets a station; the same seed gives the same split.

    Raises:
        DatasetError: fewer stations than sets.
    """
    stations = dataset.column("views/station")
    names = np.unique(stations)
    wanted = np.asarray(share, float)
    if wanted.min() < 0 or wanted.sum() <= 0:
        msg = f"shares {share} must be positive"
        raise DatasetError(msg, where="split")
    used = np.flatnonzero(wanted > 0)
    if len(names) < len(used):
        msg = f"has {len(names)} station(s), too few for {len(used)} sets"
        raise DatasetError(msg, where=dataset.path, todo="record more stations, or give a set the share 0")
    order = np.random.default_rng(seed).permutation(names)
    sizes = np.array([(stations == s).sum() for s in order], float)
    owner = _deal(sizes, wanted / wanted.sum())
    sets = [np.flatnonzero(np.isin(stations, order[owner == i])) for i in range(3)]
    return Split(*sets)


def _deal(sizes: Float, share: Float) -> Ints:
    """The set of each station: first one for every set, then always the set that is furthest below its share."""
    used = np.flatnonzero(share > 0)
    owner = np.zeros(len(sizes), int)
    got = np.zeros(len(share))
    for i, size in enumerate(sizes):
        lack = share * sizes.sum() - got
        owner[i] = used[i] if i < len(used) else used[np.argmax(lack[used])]
        got[owner[i]] += size
    return owner
