# SPDX-License-Identifier: Apache-2.0
"""A reference session of the complete cell: where each part seemed to stand when it stood in its place."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from tof_core.arrays import Float
    from tof_inspect.config import InspectConfig
    from tof_inspect.displaced import Fit

NEAR_M = 0.15
"""Distance of two cameras that see a part from about the same place: three times the stopping accuracy of a base."""
SHARE = 0.5
"""Share of the views of a part that have such a neighbour in the reference session."""


@dataclass(frozen=True, slots=True, eq=False)
class Standing:
    """A part in a session: its fit, and where the cameras stood that saw it (n, 3)."""

    fit: Fit
    cameras: Float


@dataclass(frozen=True, slots=True, eq=False)
class ReferenceSession:
    """Parts by name, as the reference session has them; digest of its scene."""

    parts: Mapping[str, Standing]

    def relative(self, name: str, fit: Fit, cameras: Sequence[Float], config: InspectConfig) -> Fit:
        """The part's motion since the reference session, where that saw it from about the same places; else the fit as it is."""
        then = self.parts.get(name)
        if then is None or not len(cameras):
            return fit
        apart = np.linalg.norm(np.asarray(cameras)[:, None] - then.cameras[None], axis=2).min(axis=1)
        return fit.relative_to(then.fit, config) if (apart < NEAR_M).mean() >= SHARE else fit
