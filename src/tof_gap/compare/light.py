# SPDX-License-Identifier: Apache-2.0
"""Light of another camera in two sessions: errors that differ from view to view, which neither a map nor the noise of pixels shows."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tof_gap.compare.levels import Level
from tof_gap.seen.foreign.light import ALONG, explained_m, field, in_most_views
from tof_sensor.effects.interference import Interference

if TYPE_CHECKING:
    from tof_core.arrays import Float
    from tof_gap.tell.diagnosis import Diagnosis


SHOWN = 1.0 / 3.0
"""Share of the other session's field that nearly every view must show where the diagnosis does not name the light: half of the light shows half."""


def light_apart(real: Diagnosis, simulated: Diagnosis, factor: float) -> Level | None:
    """Foreign light in both, in mm; None where neither diagnosis names it, or both have as much.

    Its size is that of the smooth fields and of the steps along the view by which views differ. Other effects leave fields too. So it is
    listed only where the diagnosis of the session with more of it names it, if the sizes differ by `factor` and by more than a healthy
    camera's errors.
    """
    sides = real, simulated
    named = [any(f.name == Interference.NAME and f.common is not None for f in d.findings) for d in sides]
    if not any(named):
        return None
    limits, views = real.config.noise.foreign_light, [d.account.solved.bare for d in sides]
    fields = [[field(v, limits) for v in of_one] for of_one in views]
    sizes = [_rms(explained_m(v, f)) for v, f in zip(views, fields, strict=True)]
    has = [named[i] or in_most_views(views[i], fields[i], limits, SHOWN * sizes[1 - i]) for i in range(len(sides))]
    one, other = (1e3 * float(np.hypot(s, _rms(d.account.solved.arms[:, ALONG]))) for d, s in zip(sides, sizes, strict=True))
    level = Level(Interference.NAME, one, other, {}, (has[0], has[1]))
    differ = not level.within(factor) and np.sqrt(abs(one**2 - other**2)) > real.config.select.least_mm
    return level if differ and named[0 if one > other else 1] else None


def _rms(values: Float) -> float:
    return float(np.sqrt(np.mean(values**2)))
