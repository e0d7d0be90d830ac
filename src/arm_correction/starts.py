# SPDX-License-Identifier: Apache-2.0
"""A fixed set of motions that fills a ball of translations times a ball of rotations evenly."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from tof_core import se3

if TYPE_CHECKING:
    from tof_core.arrays import Float


@lru_cache(maxsize=4)
def spread_starts(count: int, reach: float, turn: float) -> Float:
    """(count + 1, 4, 4) motions within `reach` metres and `turn` radians, the identity first; read-only."""
    from scipy.stats import qmc  # a second to import, and only a search from afar needs it

    cube = qmc.Sobol(6, scramble=True, seed=3).random(1 << (4 * count - 1).bit_length()) * 2.0 - 1.0
    inside = (np.linalg.norm(cube[:, :3], axis=1) < 1.0) & (np.linalg.norm(cube[:, 3:], axis=1) < 1.0)
    twists = cube[inside][:count] * np.repeat([reach, turn], 3)
    out = np.array([np.eye(4), *(se3.exp(x) for x in twists)])
    out.setflags(write=False)
    return out
